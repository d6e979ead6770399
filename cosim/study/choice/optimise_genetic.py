"""Genetic search over builds as choices without an order, by pymoo.

For one objective its GA, for several its NSGA-II: uniform crossover, a build drawn anew in mutation. Setups are asked
for in batches, one generation each, so that all cores have work; none is asked for twice.

J. Blank, K. Deb, IEEE Access 8 (2020) 89497, doi:10.1109/ACCESS.2020.2990567; K. Deb et al., IEEE Transactions on
Evolutionary Computation 6 (2002) 182, doi:10.1109/4235.996017.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: What a failed setup violates its constraints by: more than any that ran.
_FAILED = 1e12


class Scores(NamedTuple):
    """What a batch of K setups reached.

    Attributes:
        objectives: (K, O), the lower the better; a row with NaN: the setup failed.
        violations: (K, C) by how much each constraint is violated, as a share of its limit; 0 or less: it is kept.
    """

    objectives: Array
    violations: Array


def evolve(
    run: Callable[[Integers], Scores], counts: tuple[int, ...], first: Integers, *, evaluations: int, seed: int
) -> str:
    """Breed and try setups, generation after generation.

    Args:
        run: Tries setups by their levels (K, F).
        counts: (F,) how many builds each factor has.
        first: (P, F) the first generation; later ones are as large.
        evaluations: Most setups to try.
        seed: Of the random numbers.

    Returns:
        Why it ended, in words.

    Raises:
        InputError: pymoo is not installed.
    """
    scores, novelty = run(first), Novelty()
    algorithm = _algorithm(scores, counts, first, novelty, seed)
    _tell(algorithm, algorithm.ask(), scores)
    novelty.learn(first)
    left = evaluations - first.shape[0]
    while left > 0:
        offspring = algorithm.ask()
        if offspring is None or len(offspring) == 0:
            return f"no new setups could be bred after {evaluations - left} of {evaluations} evaluations"
        offspring = offspring[:left]
        levels = offspring.get("X").astype(np.int64)
        novelty.learn(levels)
        _tell(algorithm, offspring, run(levels))
        left -= len(offspring)
    return f"{evaluations} setups were tried"


class Novelty:
    """What pymoo asks which setups to leave out: those already tried, not only those of its last generation."""

    def __init__(self) -> None:
        self._tried: set[tuple[int, ...]] = set()

    def learn(self, levels: Integers) -> None:
        """Note setups (K, F) as tried."""
        self._tried.update(_keys(levels))

    def do(self, population: Any, *others: Any, **_: Any) -> Any:
        """Keep of a pymoo population the setups that are new: not tried, not in `others`, and each once."""
        known = self._tried.union(*(_keys(other.get("X")) for other in others if len(other)))
        keys = _keys(population.get("X")) if len(population) else []
        return population[[n for n, key in enumerate(keys) if key not in known and key not in keys[:n]]]


def _keys(levels: Any) -> list[tuple[int, ...]]:
    return [tuple(int(level) for level in row) for row in levels]


def _algorithm(scores: Scores, counts: tuple[int, ...], first: Integers, novelty: Novelty, seed: int) -> Any:
    """Return pymoo's algorithm, ready to be asked."""
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2  # noqa: PLC0415 - an extra
        from pymoo.algorithms.soo.nonconvex.ga import GA  # noqa: PLC0415
        from pymoo.core.problem import Problem  # noqa: PLC0415
        from pymoo.core.termination import NoTermination  # noqa: PLC0415
        from pymoo.core.variable import Choice  # noqa: PLC0415
        from pymoo.operators.crossover.ux import UX  # noqa: PLC0415
        from pymoo.operators.mutation.rm import ChoiceRandomMutation  # noqa: PLC0415
    except ImportError as error:
        raise InputError("optimising needs pymoo: pip install 'eightpost[optimise]'") from error
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
    """Give pymoo what setups reached; that a setup failed is one more constraint, violated by a large number."""
    from pymoo.core.evaluator import Evaluator  # noqa: PLC0415 - an extra
    from pymoo.problems.static import StaticProblem  # noqa: PLC0415

    failed = np.asarray(~np.isfinite(scores.objectives).all(axis=1))
    objectives = np.where(failed[:, None], 0.0, scores.objectives)
    constraints = np.column_stack([np.where(failed[:, None], 0.0, scores.violations), np.where(failed, _FAILED, 0.0)])
    Evaluator().eval(StaticProblem(algorithm.problem, F=objectives, G=constraints), population)
    algorithm.tell(infills=population)
