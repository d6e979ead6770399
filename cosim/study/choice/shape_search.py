"""Search over continuous numbers of the shocks at each corner, for the best mean plus scatter of the objective.

scipy's SLSQP minimises the study's objective under its constraints from several starts; gradients are differences of
runs, a batch for each step, so that all cores are busy (D. Kraft, DFVLR-FB 88-28, 1988).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, minimize
from scipy.stats import norm, qmc

from cosim.study.choice.best import Criterion, Limits, limits_of
from cosim.study.choice.optimise import Scores, scores_of, violation
from cosim.study.choice.posterior import Posterior
from cosim.study.choice.sensitivity import factors_of
from cosim.study.choice.sources import UNKNOWN, Axes, Variables
from cosim.study.definition import Build, Study
from cosim.study.running.sweep import Trials
from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError

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
    best, nominal, scatter, assured = (float(one[0]) for one in found[:1] + found[2:])
    allowed, count = bool(found.allowed[0]), problem.trials.count
    return ShapeOptimum(point, best, nominal, scatter, assured, allowed, pairs, count, tuple(words))


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


# ==== Drawn errors of the vehicle for setups that are not in the table: shocks that nobody has built =================

#: Number of groups of draws with the same scales, and number of draws in each; half of them are the others negated.
_VEHICLE_GROUPS, _PER_GROUP = 64, 4


@dataclass(frozen=True, eq=False)
class VehicleDraws:
    """D drawn errors of M measures, as functions of the levels that the vehicle predicts for a setup.

    ln(true / predicted) = common + own . z,    z: position of the setup
    """

    names: tuple[str, ...]  #: Names of the measures.
    common: Array  #: Common error (D, M).
    own: Array  #: Gradient of the own error (D, M, Z).
    axes: Axes  #: Axes of the positions of setups.
    unknown: tuple[str, ...]  #: Measures whose uncertainty is not known; their errors are 0.

    @classmethod
    def of(cls, result: StudyResult, posterior: Posterior, seed: int = 20270) -> VehicleDraws | None:
        """Return drawn errors; None if the vehicle of the study states no uncertainty."""
        sources = posterior.sources
        generator = np.random.default_rng(seed)
        drawn = [
            posterior.draw(one, _PER_GROUP, generator) for one in posterior.scales.groups(_VEHICLE_GROUPS, generator)
        ]
        parts = drawn if posterior.observations.rows.size else [_balanced(one, sources.shift) for one in drawn]
        unknown = tuple(n for n, origin in zip(sources.names, sources.bases, strict=True) if origin == UNKNOWN)
        common, own = (np.concatenate([getattr(one, part) for one in parts]) for part in ("common", "own"))
        if not np.any(common) and not np.any(own):
            return None
        return cls(sources.names, common, own, Axes.of(result), unknown)

    def levels(self, predicted: Array, measures: Integers) -> Array:
        """Return the true levels (D, K, I) of some measures, SI.

        Args:
            predicted: Predicted levels of all measures of K setups (K, M), SI.
            measures: Positions of the measures (I,).
        """
        places = self.axes.position(predicted)
        errors = self.common[:, None, measures] + np.einsum("diz,kz->dki", self.own[:, measures], places)
        return np.asarray(predicted[:, measures] * np.exp(errors))


def _balanced(drawn: Variables, shift: Array) -> Variables:
    """Return draws of which the second half is the first one negated about the shift, so that this is their mean."""
    half = len(drawn.common) // 2
    parts = (drawn.common - shift, drawn.own, drawn.shocks)
    common, own, shocks = (np.concatenate([part[:half], -part[:half]]) for part in parts)
    return Variables(common + shift, own, shocks)


@dataclass(frozen=True, eq=False)
class DrawnCar:
    """Objective and constraints of setups on D cars that the true one may be, compared with a reference setup.

    An error of the objective that the reference has too, such as a common one, says nothing on which setup is better;
    it is left out of the objective, but not of the constraints.
    """

    draws: VehicleDraws  #: Drawn errors.
    criterion: Criterion  #: Objective.
    limits: tuple[Limits, ...]  #: Constraints.
    reference: Array  #: Predicted levels of the reference (M,), SI.

    @classmethod
    def of(cls, result: StudyResult, draws: VehicleDraws, name: str, row: int) -> DrawnCar:
        """Return the drawn cars of a study.

        Args:
            name: `OBJECTIVE` or the name of a measure.
        """
        reference = np.array([result.values(measure)[row] for measure in draws.names])
        return cls(draws, Criterion.of(result, name), limits_of(result), reference)

    @property
    def is_known(self) -> bool:
        """Whether the uncertainty of every measure of the objective is known."""
        return not self.unknown(self.criterion.measures)

    def unknown(self, measures: Integers) -> tuple[str, ...]:
        """Return those of some measures whose uncertainty is not known."""
        return tuple(self.draws.names[m] for m in measures.tolist() if self.draws.names[m] in self.draws.unknown)

    def objectives(self, predicted: Array) -> Array:
        """Return the objective (K, D) of predicted levels (K, M), less the error that the reference has too."""
        own, reference = (self._objectives(rows) for rows in (predicted, self.reference[None]))
        return own - reference + self.criterion.values(self.reference)

    def limited(self, predicted: Array) -> Sequence[Array]:
        """Return the levels (K, D) of the measure of each constraint."""
        return [self.draws.levels(predicted, np.array([limit.measure]))[..., 0].T for limit in self.limits]

    def _objectives(self, predicted: Array) -> Array:
        levels = self.draws.levels(predicted, self.criterion.measures)
        return np.asarray((levels @ self.criterion.weights + self.criterion.offset).T)
