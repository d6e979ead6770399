"""Genetic search over builds as unordered choices, with pymoo.

It uses GA for one objective and NSGA-II for several, with uniform crossover and random mutation of builds. Setups are
evaluated in batches of one generation, so that all cores are busy; none is evaluated twice.

J. Blank, K. Deb, IEEE Access 8 (2020) 89497, doi:10.1109/ACCESS.2020.2990567; K. Deb et al., IEEE Transactions on
Evolutionary Computation 6 (2002) 182, doi:10.1109/4235.996017.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, prod
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, minimize
from scipy.stats import norm, qmc

from cosim.study.choice.posterior import DrawnCar
from cosim.study.choice.sensitivity import factors_of, indices_of, levels_of
from cosim.study.definition import Build, Constraint, SetupSpace, Study
from cosim.study.running.evaluator import Coupling
from cosim.study.running.sweep import Sweep, Trials
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError
from eightpost.extras import needs
from eightpost.progress import Progress

#: Constraint violation of a failed setup: larger than that of any setup that ran.
_FAILED = 1e12


class Scores(NamedTuple):
    """Objectives and constraint violations of a batch of K setups."""

    objectives: Array  #: Objectives (K, O); lower is better; NaN if the setup failed.
    #: Violation of each constraint (K, C), as a share of its limit; 0 or less if the constraint is met.
    violations: Array


def _evolve(
    run: Callable[[Integers], Scores], counts: tuple[int, ...], first: Integers, *, evaluations: int, seed: int
) -> str:
    """Generate and evaluate setups, generation by generation.

    Args:
        run: Function that evaluates setups by their levels (K, F).
        counts: Number of builds of each factor (F,).
        first: First generation (P, F); later ones have the same size.

    Returns:
        Reason why the search ended.

    Raises:
        InputError: pymoo is not installed.
    """
    scores, novelty = run(first), _Novelty()
    algorithm = _algorithm(scores, counts, first, novelty, seed)
    _tell(algorithm, algorithm.ask(), scores)
    novelty.learn(first)
    left = evaluations - first.shape[0]
    while left > 0:
        offspring = algorithm.ask()
        if offspring is None or len(offspring) == 0:
            return f"the search found no new setups after {evaluations - left} of {evaluations} evaluations"
        offspring = offspring[:left]
        levels = offspring.get("X").astype(np.int64)
        novelty.learn(levels)
        _tell(algorithm, offspring, run(levels))
        left -= len(offspring)
    return f"{evaluations} setups were evaluated"


class _Novelty:
    """Duplicate filter for pymoo that rejects all setups evaluated so far, not only those of the last generation."""

    def __init__(self) -> None:
        self._evaluated: set[tuple[int, ...]] = set()

    def learn(self, levels: Integers) -> None:
        """Add evaluated setups (K, F)."""
        self._evaluated.update(_keys(levels))

    def do(self, population: Any, *others: Any, **_: Any) -> Any:
        """Return the new setups of a pymoo population: not evaluated, not in `others`, and each once."""
        known = self._evaluated.union(*(_keys(other.get("X")) for other in others if len(other)))
        keys = _keys(population.get("X")) if len(population) else []
        return population[[n for n, key in enumerate(keys) if key not in known and key not in keys[:n]]]


def _keys(levels: Any) -> list[tuple[int, ...]]:
    return [tuple(int(level) for level in row) for row in levels]


def _algorithm(scores: Scores, counts: tuple[int, ...], first: Integers, novelty: _Novelty, seed: int) -> Any:
    """Return pymoo's algorithm, initialised with the first generation."""
    with needs("optimise", "the search of setups"):
        from pymoo.algorithms.moo.nsga2 import NSGA2  # noqa: PLC0415 - an extra
        from pymoo.algorithms.soo.nonconvex.ga import GA  # noqa: PLC0415
        from pymoo.core.problem import Problem  # noqa: PLC0415
        from pymoo.core.termination import NoTermination  # noqa: PLC0415
        from pymoo.core.variable import Choice  # noqa: PLC0415
        from pymoo.operators.crossover.ux import UX  # noqa: PLC0415
        from pymoo.operators.mutation.rm import ChoiceRandomMutation  # noqa: PLC0415
    objectives, constraints = scores.objectives.shape[1], scores.violations.shape[1] + 1
    choices = {f"factor {n}": Choice(options=list(range(count))) for n, count in enumerate(counts)}
    algorithm = (GA if objectives == 1 else NSGA2)(
        pop_size=first.shape[0],
        sampling=first.astype(object),
        crossover=UX(),
        mutation=ChoiceRandomMutation(),
        eliminate_duplicates=novelty,
    )
    problem = Problem(vars=choices, n_obj=objectives, n_ieq_constr=constraints)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    return algorithm


def _tell(algorithm: Any, population: Any, scores: Scores) -> None:
    """Pass scores to pymoo; the failure of a setup is one more constraint, violated by a large number."""
    from pymoo.core.evaluator import Evaluator  # noqa: PLC0415 - an extra
    from pymoo.problems.static import StaticProblem  # noqa: PLC0415

    failed = np.asarray(~np.isfinite(scores.objectives).all(axis=1))
    objectives = np.where(failed[:, None], 0.0, scores.objectives)
    constraints = np.column_stack([np.where(failed[:, None], 0.0, scores.violations), np.where(failed, _FAILED, 0.0)])
    Evaluator().eval(StaticProblem(algorithm.problem, F=objectives, G=constraints), population)
    algorithm.tell(infills=population)


# ==== Search for the best setups of a bank that is too large to run completely =======================================

# ---- Pareto front of setups: without pymoo, as small banks are evaluated completely without it ----------------------


def pareto_front(values: Array) -> Flags:
    """Return whether each row is on the Pareto front: no other row is as low in every column and lower in one.

    Args:
        values: Responses (N, M); lower is better; a row with NaN is never on the front.

    Returns:
        Flags (N,); equal rows have equal flags.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    left = known[np.lexsort(values[known].T[::-1])]  # a row that dominates another one precedes it
    front = np.zeros(values.shape[0], dtype=bool)
    while left.size:
        best = values[left[0]]
        equal = (values[left] == best).all(axis=1)
        front[left[equal]] = True
        left = left[(values[left] < best).any(axis=1)]
    return front


# ---- Integer optimisation -------------------------------------------------------------------------------------------


#: Number of setups in a generation; with 7 builds at 4 corners, 10 to 40 need the same number of evaluations.
POPULATION = 20


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """All setups that an optimisation evaluated. N setups, O objectives, C constraints."""

    indices: Integers  #: Numbers of the setups (N,) in the order of evaluation, each once.
    objectives: Array  #: Objectives (N, O); lower is better.
    violations: Array  #: Constraint violations (N, C), as shares of the limits.
    seed: int  #: Seed of the random number generator.
    status: str  #: Reason why the search ended.

    @property
    def allowed(self) -> Flags:
        """Whether each setup ran and meets every constraint (N,)."""
        ran, kept = np.isfinite(self.objectives).all(axis=1), (self.violations <= 0.0).all(axis=1)
        return np.asarray(ran & kept, dtype=np.bool_)

    @property
    def best(self) -> int | None:
        """Number of the feasible setup with the lowest first objective; None if no setup is feasible."""
        rows = np.flatnonzero(self.allowed)
        if rows.size == 0:
            return None
        return int(self.indices[rows[np.lexsort((self.indices[rows], self.objectives[rows, 0]))[0]]])

    @property
    def front(self) -> Integers:
        """Numbers of the setups on the Pareto front of the feasible ones, in increasing order."""
        values = np.where(self.allowed[:, None], self.objectives, np.nan)
        return np.sort(self.indices[pareto_front(values)])


def optimise(
    space: SetupSpace,
    evaluate: Callable[[Integers], Scores],
    *,
    evaluations: int,
    seed: int = 0,
    population: int = POPULATION,
    start: Sequence[int] = (),
) -> Optimum:
    """Search a space of setups for the lowest objectives; the same seed gives the same setups.

    Args:
        space: Space to search (Theta of Eq 2.3); it is evaluated completely if `evaluations` suffices.
        evaluate: Function that runs setups by number (K,).
        population: Number of setups in a generation, at most `evaluations`.
        start: Numbers of setups that the first generation contains, such as the baseline.

    Raises:
        InputError: `evaluations` or `population` is below 2, or the extra `optimise` is not installed.
    """
    population = min(population, evaluations)
    if population < 2:
        raise InputError(
            f"a search needs two setups or more per generation and two evaluations or more, not {population}"
        )
    factors = factors_of(space)
    counts = tuple(len(factor.builds) for factor in factors)
    indices, scores = list[Integers](), list[Scores]()

    def run(levels: Integers) -> Scores:
        indices.append(indices_of(space, levels))
        scores.append(evaluate(indices[-1]))
        return scores[-1]

    status = "every setup was evaluated"
    if prod(counts) <= evaluations:
        run(np.stack(np.unravel_index(np.arange(prod(counts)), counts), axis=-1))
    else:
        first = _first_generation(counts, population, levels_of(space, np.array(start, dtype=np.int64)), seed)
        status = _evolve(run, counts, first, evaluations=evaluations, seed=seed)
    objectives, violations = (np.concatenate(part) for part in zip(*scores, strict=True))
    return Optimum(np.concatenate(indices), objectives, violations, seed, status)


def _first_generation(counts: tuple[int, ...], population: int, start: Integers, seed: int) -> Integers:
    """Return different setups (P, F): `start`, then setups with every build equally frequent at every position."""
    generator = np.random.default_rng(seed)
    chosen = dict.fromkeys(tuple(row) for row in start.tolist())
    while len(chosen) < population:
        columns = [generator.permutation(np.arange(population) % count) for count in counts]
        chosen |= dict.fromkeys(tuple(row) for row in np.stack(columns, axis=-1).tolist())
    return np.array(list(chosen)[:population], dtype=np.int64)


# ---- Search of a study's setup space --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Search:
    """Objectives and settings of a search."""

    #: Measures to minimise, several for their trade-off; empty: the study's objective (Eq 2.6), or its first measure if
    #: it has none.
    objectives: tuple[str, ...] = ()
    evaluations: int = 400  #: Maximum number of setups to evaluate.
    seed: int = 0  #: Seed of the random number generator.


def search_study(
    requested: Sweep,
    workers: Workers,
    coupling: Coupling,
    search: Search,
    progress: Progress = lambda _evaluated, _maximum: None,
) -> tuple[StudyResult, Optimum]:
    """Search a study; a repeated search with the same seed evaluates the same setups and runs none of them again.

    Returns:
        Results of the evaluated setups, and the best of them.

    Raises:
        InputError: An objective is not a measure, a setting is invalid, or the extra `optimise` is not installed.
    """
    study, evaluated = requested.study, 0

    def evaluate(indices: Integers) -> Scores:
        nonlocal evaluated
        result = requested.request(workers, coupling, indices.tolist())
        evaluated += indices.size
        progress(evaluated, search.evaluations)
        return scores_of(result, indices, search.objectives)

    baseline = study.baseline_setup
    start = () if baseline is None else (baseline.index,)
    found = optimise(study.space, evaluate, evaluations=search.evaluations, seed=search.seed, start=start)
    return requested.request(workers, coupling, found.indices.tolist()), found


def scores_of(result: StudyResult, indices: Integers, objectives: Sequence[str] = ()) -> Scores:
    """Return the scores of setups: objectives (K, O), and violations (K, C) of the study's constraints.

    Args:
        indices: Numbers of the setups (K,).
        objectives: Measures to minimise, in SI; empty: the study's objective, or its first measure if it has none.

    Raises:
        InputError: An objective is not a measure of the study.
    """
    rows = np.searchsorted(result.setups, indices)
    own = result.objective
    if not objectives and own is not None:
        columns = [np.where(result.done, own, np.nan)]
    else:
        columns = [result.values(name) for name in objectives or (result.measures[0].name,)]
    kept = [violation(result.values(c.measure), c)[rows] for c in result.study.constraints]
    none = np.empty((indices.size, 0))
    return Scores(np.stack(columns, axis=-1)[rows], np.stack(kept, axis=-1) if kept else none)


def violation(values: Array, constraint: Constraint) -> Array:
    """Return the violation of a constraint by values (K,), as a share of the limit (per SI unit if the limit is 0).

    The constraint is met if the violation is 0 or less. The violation of NaN is infinite.
    """
    above = (values - constraint.at_most) / _scale(constraint.at_most)
    below = (constraint.at_least - values) / _scale(constraint.at_least)
    return np.nan_to_num(np.maximum(above, below), nan=inf, neginf=-1.0)


def _scale(limit: float) -> float:
    return abs(limit) if limit != 0.0 and isfinite(limit) else 1.0


def objectives_in_words(study: Study, search: Search) -> str:
    """Return a description of what a search minimises."""
    if search.objectives:
        return "the trade-off between " * (len(search.objectives) > 1) + ", ".join(search.objectives)
    terms = " + ".join(f"{term.weight:g} x {term.measure} [{term.unit}]" for term in study.objective)
    return terms or study.measures[0].name


# ==== Search over continuous numbers of the shocks at each corner, for the best mean plus scatter of the objective ===
# scipy's SLSQP minimises the study's objective under its constraints from several starts; gradients are differences of
# runs, a batch for each step, so that all cores are busy (D. Kraft, DFVLR-FB 88-28, 1988).

#: Difference of a gradient, as a share of a number's range.
_DIFFERENCE = 5e-3

#: Probability with which the true objective is below the assured one.
ASSURED = 0.95

#: Precision of the objective at which a search ends, as a share of its value at the start.
_PRECISION = 2e-5

#: Change of the objective that counts as 1 in a search, as a share of its value at the start. A search begins with a
#: step of the gradient's size: a few percent of the range per percent of the objective would end it at once.
_UNIT = 0.02


def groups_of(study: Study) -> tuple[tuple[str, ...], ...]:
    """Return the corners of a study; corners that are alike are one group."""
    return tuple(tuple(factor.name.split("+")) for factor in factors_of(study.space))


# ---- The space ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Range:
    """Range of one number of a shock.

    Raises:
        InputError: The range is empty, or the tolerance is negative.
    """

    name: str  #: Name of the number.
    low: float  #: Lower limit, in the number's own unit.
    high: float  #: Upper limit.
    tolerance: float = 0.0  #: Standard deviation from shock to shock, as a share of the value [1].

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"range of {self.name}: the lower limit {self.low:g} must be below {self.high:g}")
        if not 0.0 <= self.tolerance < 1.0:
            raise InputError(f"tolerance of {self.name} must be 0 or more and below 1, not {self.tolerance:g}")

    @property
    def by_factors(self) -> bool:
        """Whether equal steps are equal factors: the whole range is positive."""
        return self.low > 0.0

    def value(self, place: Array) -> Array:
        """Return values at places from 0 (lower limit) to 1 (upper limit)."""
        if self.by_factors:
            return np.asarray(self.low * (self.high / self.low) ** place)
        return np.asarray(self.low + (self.high - self.low) * place)

    def place(self, value: Array | float) -> Array:
        """Return the places of values; the inverse of `value`, limited to the range."""
        value = np.clip(value, self.low, self.high)
        if self.by_factors:
            return np.asarray(np.log(value / self.low) / np.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))


#: Function that returns the build of a shock for a group of corners with the given numbers, by name.
BuildOf = Callable[[tuple[str, ...], Mapping[str, float]], Build]


@dataclass(frozen=True, slots=True)
class ShockSpace:
    """Numbers of a shock at each corner, or group of corners with the same shock.

    A point is an array (n,) of places between 0 and 1, the numbers of the first group first.
    """

    groups: tuple[tuple[str, ...], ...]  #: Corners of each group that varies.
    ranges: tuple[Range, ...]  #: Ranges of the numbers, the same at each group.
    build: BuildOf  #: Function that returns the build of a shock with these numbers.
    fixed: Mapping[str, Build] = field(default_factory=dict)  #: Builds of the other corners.

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return len(self.groups) * len(self.ranges)

    def values(self, points: Array) -> Array:
        """Return the values (K, groups, numbers) at points (K, n)."""
        places = points.reshape(-1, len(self.groups), len(self.ranges))
        return np.stack([one.value(places[..., k]) for k, one in enumerate(self.ranges)], axis=-1)

    def point(self, values: Sequence[Mapping[str, float]]) -> Array:
        """Return the point (n,) nearest to the numbers of each group; values beyond the range are set to its limit."""
        return np.array([float(one.place(group[one.name])) for group in values for one in self.ranges])

    def numbers(self, values: Array) -> list[dict[str, float]]:
        """Return values (groups, numbers) as the numbers of each group by name."""
        return [dict(zip((one.name for one in self.ranges), row, strict=True)) for row in values.tolist()]

    def trial(self, values: Array) -> dict[str, Build]:
        """Return the build at each corner for values (groups, numbers)."""
        builds = [self.build(*pair) for pair in zip(self.groups, self.numbers(values), strict=True)]
        own = {corner: build for group, build in zip(self.groups, builds, strict=True) for corner in group}
        return {**self.fixed, **own}


# ---- The objective: mean and scatter over shocks that are not exactly as planned ----------------------------------


@dataclass(frozen=True, slots=True)
class Robustness:
    """Draws of the tolerances, the same for every point, and the weight of the scatter.

    Raises:
        InputError: There is a single draw, or the weight is negative.
    """

    draws: int = 0  #: Number of draws; 0: shocks are exactly as planned.
    weight: float = 1.0  #: Number of standard deviations that are added to the mean of objective and constraints.
    seed: int = 0  #: Seed of the draws.

    def __post_init__(self) -> None:
        if self.draws < 0 or self.draws == 1 or not self.weight >= 0.0:
            raise InputError(f"robust search: use no draws, or two or more, not {self.draws}, and a weight of 0 or "
                             f"more, not {self.weight:g}")  # fmt: skip

    def factors(self, space: ShockSpace) -> Array:
        """Return factors (1 + S, groups, numbers) on the values; the first row is 1."""
        shape = (len(space.groups), len(space.ranges))
        uniform = qmc.LatinHypercube(space.size, rng=self.seed).random(self.draws).reshape(-1, *shape)
        tolerances = np.array([one.tolerance for one in space.ranges])
        return np.concatenate([np.ones((1, *shape)), np.exp(tolerances * norm.ppf(uniform))])


class Evaluation(NamedTuple):
    """Values of K points."""

    objective: Array  #: Robust objective (K,): mean plus weighted scatter; NaN if a run failed.
    violations: Array  #: Robust violation of each constraint (K, C), as a share of the limit.
    nominal: Array  #: Predicted objective of the shocks exactly as planned (K,).
    scatter: Array  #: Standard deviation of the objective over the draws (K,); 0 without draws.
    assured: Array  #: Objective that is exceeded with a probability of 5 % over the draws (K,).

    @property
    def allowed(self) -> Flags:
        """Whether each point ran and meets all constraints (K,)."""
        return np.asarray(np.isfinite(self.objective) & (self.violations <= 0.0).all(axis=1), dtype=np.bool_)


class Problem:
    """Objective and constraints of a study over a space of shocks.

    Args:
        objective: Measure to minimise; empty: the study's objective.
        car: Cars that the true one may be; None: the vehicle is taken to be exact.
    """

    def __init__(
        self,
        trials: Trials,
        space: ShockSpace,
        robustness: Robustness = Robustness(),
        objective: str = "",
        car: DrawnCar | None = None,
    ) -> None:
        self.trials, self.space, self.robustness, self.car = trials, space, robustness, car
        self._objectives = (objective,) if objective else ()
        self._factors = robustness.factors(space)

    def scores(self, trials: Sequence[Mapping[str, Build]]) -> Scores:
        """Return predicted objective (K, 1) and violations (K, C) of builds by corner."""
        return self._scores(self.trials.run(trials))

    def evaluate(self, points: Array) -> Evaluation:
        """Evaluate points (K, n) in one batch, each with all draws of shocks and cars."""
        objectives, violations, nominal = self._drawn(points)
        if objectives.shape[1] == 1:
            return Evaluation(nominal, violations[:, 0], nominal, np.zeros_like(nominal), nominal)
        weight = self.robustness.weight
        mean, scatter = objectives.mean(axis=1), objectives.std(axis=1, ddof=1)
        with np.errstate(invalid="ignore"):  # a failed run violates its constraints infinitely
            robust = violations.mean(axis=1) + weight * np.nan_to_num(violations.std(axis=1, ddof=1))
            assured = np.quantile(objectives, ASSURED, axis=1)
        return Evaluation(mean + weight * scatter, robust, nominal, scatter, assured)

    def drawn(self, points: Array) -> Array:
        """Return the objective of points (K, n) with every draw of shocks and cars (K, N)."""
        return self._drawn(points)[0]

    def _drawn(self, points: Array) -> tuple[Array, Array, Array]:
        """Return objectives (K, N) and violations (K, N, C) with every draw, and the predicted objective (K,)."""
        values = self.space.values(points)
        drawn = values[:, None] * self._factors  # (K, 1 + S, groups, numbers)
        result = self.trials.run([self.space.trial(one) for rows in drawn for one in rows])
        scores, shape = self._scores(result), drawn.shape[:2]
        predicted = scores.objectives[:, 0].reshape(shape)
        if self.car is None:
            return predicted, scores.violations.reshape(*shape, -1), predicted[:, 0]
        levels = np.stack([result.values(name) for name in self.car.draws.names], axis=1)  # rows are the trials
        pairs = zip(self.trials.study.constraints, self.car.limited(levels), strict=True)
        kept = [violation(one, limit).reshape(shape[0], -1) for limit, one in pairs]
        objectives = self.car.objectives(levels).reshape(shape[0], -1)
        none = np.empty((*objectives.shape, 0))
        return objectives, np.stack(kept, axis=-1) if kept else none, predicted[:, 0]

    def _scores(self, result: StudyResult) -> Scores:
        return scores_of(result, result.setups, self._objectives)


# ---- The search with SLSQP ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ShapeOptimum:
    """Result of a continuous search."""

    point: Array  #: Best point (n,).
    objective: float  #: Robust objective there.
    nominal: float  #: Objective of the shocks exactly as planned.
    scatter: float  #: Standard deviation of the objective over the draws.
    assured: float  #: Objective that is exceeded with a probability of 5 % over the draws.
    allowed: bool  #: Whether the point meets all constraints.
    starts: tuple[tuple[float, float], ...]  #: Objective at each start, and at the end of its search.
    runs: int  #: Number of setups that were run.
    status: tuple[str, ...]  #: Reasons why the searches ended.


@dataclass(slots=True)
class _Descent:
    """One search with SLSQP: values and gradients of the last point, and the best point so far."""

    problem: Problem
    scale: float
    progress: Callable[[int], None]
    best: tuple[bool, float, Array] = field(init=False)
    _known: tuple[bytes, Any] = field(init=False, default=(b"", None))

    def run(self, start: Array, iterations: int) -> str:
        """Search from a point (n,)."""
        self.best = (False, np.inf, start)
        problem: Any = {
            "fun": lambda point: self._at(point)[0] / (_UNIT * self.scale),
            "jac": lambda point: self._at(point)[2] / (_UNIT * self.scale),
            "bounds": Bounds(np.zeros(start.size), np.ones(start.size)),
            "options": {"maxiter": iterations, "ftol": _PRECISION / _UNIT},
        }
        if self.problem.trials.study.constraints:
            limits = {
                "type": "ineq",
                "fun": lambda p: -self._at(p)[1][0] / _UNIT,  # its precision is that of the objective
                "jac": lambda p: -self._at(p)[3] / _UNIT,
            }
            problem["constraints"] = [limits]
        found = minimize(x0=start, method="SLSQP", **problem)
        return str(found.message)

    def _at(self, point: Array) -> tuple[float, Array, Array, Array]:
        """Return objective, violations (1, C) and their gradients (n,) and (C, n) by differences into the range."""
        key = point.tobytes()
        if self._known[0] != key:
            steps = np.where(point > 0.5, -_DIFFERENCE, _DIFFERENCE)
            found = self.problem.evaluate(np.clip(np.vstack([point, point + np.diag(steps)]), 0.0, 1.0))
            self.progress(self.problem.trials.count)
            objective = np.nan_to_num(found.objective, nan=10.0 * self.scale, posinf=10.0 * self.scale)
            violations = np.minimum(found.violations, 10.0)
            allowed = bool(found.allowed[0])
            if (not allowed, objective[0]) < (not self.best[0], self.best[1]):
                self.best = (allowed, float(objective[0]), point.copy())
            slopes = ((violations[1:] - violations[0]) / steps[:, None]).T
            self._known = key, (float(objective[0]), violations[:1], (objective[1:] - objective[0]) / steps, slopes)
        known: tuple[float, Array, Array, Array] = self._known[1]
        return known


def search(
    problem: Problem,
    starts: Sequence[Array],
    *,
    iterations: int = 30,
    progress: Callable[[int], None] = lambda _runs: None,
) -> ShapeOptimum:
    """Search from several points and return the best that meets the constraints, or else the smallest objective.

    Args:
        starts: Points (n,).

    Raises:
        InputError: There is no start.
    """
    if not starts:
        raise InputError("a search needs one start or more")
    first = problem.evaluate(np.stack(starts))
    ends, words = [], []
    for start, before in zip(starts, first.objective.tolist(), strict=True):
        descent = _Descent(problem, abs(before) or 1.0, progress)
        words.append(descent.run(start, iterations))
        ends.append(descent.best)
    _, _, point = min(ends, key=lambda end: (not end[0], end[1]))
    found = problem.evaluate(point[None])
    pairs = tuple((before, end[1]) for before, end in zip(first.objective.tolist(), ends, strict=True))
    return ShapeOptimum(
        point,
        float(found.objective[0]),
        float(found.nominal[0]),
        float(found.scatter[0]),
        float(found.assured[0]),
        bool(found.allowed[0]),
        pairs,
        problem.trials.count,
        tuple(words),
    )


# ==== Band around the optimum in which a share of its gain is kept ===================================================

#: Share of the random points in a band that must keep the gain, and their number.
_KEPT, _POINTS = 0.95, 60

#: Sizes of boxes, as shares of the range, the largest first; they are bisected, as a smaller box keeps more.
_SIZES = (0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.02, 0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Points around an optimum that keep a share of its gain."""

    share: float  #: Share of the gain that is kept [1].
    size: float  #: Half-width of the box around the optimum, as a share of each range; 0: no box was large enough.
    kept: float  #: Share of the random points in the box that keep the gain and meet the constraints [1].
    points: Array  #: Random points in the box (P, n).
    alone: Array  #: Lower and upper place (n, 2) of each number within which the gain is kept while the others stay.


def band(problem: Problem, optimum: ShapeOptimum, reference: float, *, share: float = 0.8, seed: int = 1) -> Band:
    """Return the largest box around an optimum in which a share of the assured gain over a reference is kept.

    The assured gain is exceeded with a probability of 95 % over the draws of the problem, such as the cars that the
    true one may be. A box counts if 95 % of 60 random points in it keep the share of it, assured likewise, and meet the
    constraints.

    Args:
        optimum: Result of `search`.
        reference: Nominal objective of the setup that the gain is counted from, such as the best of the bank.
        share: Share of the gain to keep [1].

    Raises:
        InputError: The assured objective of the optimum is not below the reference.
    """
    gain = reference - optimum.assured
    if not gain > 0.0:
        raise InputError(
            f"the assured objective {optimum.assured:g} is not below the reference {reference:g}: there is no gain"
        )
    limit = reference - share * gain
    uniform = qmc.Sobol(problem.space.size, rng=seed).random(64)[:_POINTS]
    size, kept, points = 0.0, 0.0, np.empty((0, problem.space.size))
    first, last = 0, len(_SIZES)  # the largest box that keeps it is in _SIZES[first:last], or no box keeps it
    while first < last:
        middle = (first + last) // 2
        tried = np.clip(optimum.point + _SIZES[middle] * (2.0 * uniform - 1.0), 0.0, 1.0)
        good = float(np.mean(_keeps(problem, tried, limit)))
        if good >= _KEPT:
            size, kept, points, last = _SIZES[middle], good, tried, middle
        else:
            first = middle + 1
    return Band(share, size, kept, points, _alone(problem, optimum.point, limit))


def _keeps(problem: Problem, points: Array, limit: float) -> Flags:
    found = problem.evaluate(points)
    return np.asarray(found.allowed & (found.assured <= limit), dtype=np.bool_)


def _alone(problem: Problem, point: Array, limit: float) -> Array:
    """Return the interval (n, 2) of each coordinate, on a grid, that is connected with the point and keeps the gain."""
    steps = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0])
    ends = np.repeat(point[:, None], 2, axis=1)
    for side, sign in enumerate((-1.0, 1.0)):
        moved = np.clip(point[:, None] + sign * steps, 0.0, 1.0)  # (n, steps)
        tried = np.repeat(point[None], moved.size, axis=0)
        rows = np.arange(moved.size)
        tried[rows, rows // steps.size] = moved.ravel()
        good = _keeps(problem, tried, limit).reshape(moved.shape)
        reached = np.cumprod(good, axis=1).sum(axis=1)
        ends[:, side] = np.where(reached > 0, moved[np.arange(point.size), np.maximum(reached - 1, 0)], point)
    return ends
