"""Genetic search over builds as unordered choices, with pymoo.

It uses GA for one objective and NSGA-II for several, with uniform crossover and random mutation of builds. Setups are
evaluated in batches of one generation, so that all cores are busy; none is evaluated twice.

J. Blank, K. Deb, IEEE Access 8 (2020) 89497, doi:10.1109/ACCESS.2020.2990567; K. Deb et al., IEEE Transactions on
Evolutionary Computation 6 (2002) 182, doi:10.1109/4235.996017.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from eightpost.array_types import Array, Integers
from eightpost.extras import needs

#: Constraint violation of a failed setup: larger than that of any setup that ran.
_FAILED = 1e12


class Scores(NamedTuple):
    """Objectives and constraint violations of a batch of K setups."""

    objectives: Array  #: Objectives (K, O); lower is better; NaN if the setup failed.
    #: Violation of each constraint (K, C), as a share of its limit; 0 or less if the constraint is met.
    violations: Array


def evolve(
    run: Callable[[Integers], Scores], counts: tuple[int, ...], first: Integers, *, evaluations: int, seed: int
) -> str:
    """Generate and evaluate setups, generation by generation.

    Args:
        run: Function that evaluates setups by their levels (K, F).
        counts: Number of builds of each factor (F,).
        first: First generation (P, F); later ones have the same size.
        evaluations: Maximum number of setups to evaluate.
        seed: Seed of the random number generator.

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
