"""Integer optimisation: search for the best setups of a bank that is too large for an exhaustive study (Eq 2.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np
from numpy.typing import NDArray

from cosim.study.choice.factor import factors_of, indices_of, levels_of
from cosim.study.choice.optimise_genetic import Scores, evolve
from cosim.study.choice.pareto import pareto_front
from cosim.study.setup import SetupSpace
from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Number of setups in a generation; with 7 builds at 4 corners, 10 to 40 need the same number of evaluations.
POPULATION = 20

Evaluate = Callable[[Integers], Scores]


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """All setups that an optimisation evaluated. N setups, O objectives, C constraints.

    Attributes:
        indices: Numbers of the setups (N,) in the order of evaluation, each once.
        objectives: Objectives (N, O); lower is better.
        violations: Constraint violations (N, C), as shares of the limits.
        seed: Seed of the random number generator.
        status: Reason why the search ended.
    """

    indices: Integers
    objectives: Array
    violations: Array
    seed: int
    status: str

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

    def after(self, evaluations: int) -> Optimum:
        """Return the state of the search after a number of evaluations."""
        kept = slice(evaluations)
        return Optimum(
            self.indices[kept], self.objectives[kept], self.violations[kept], self.seed, f"after {evaluations}"
        )


def optimise(
    space: SetupSpace,
    evaluate: Evaluate,
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
        evaluations: Maximum number of setups to evaluate.
        seed: Seed of the random number generator.
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
    trials = Trials(space, evaluate)
    if prod(counts) <= evaluations:
        trials.run(np.stack(np.unravel_index(np.arange(prod(counts)), counts), axis=-1))
        return trials.optimum(seed, "every setup was evaluated")
    first = _first_generation(counts, population, levels_of(space, np.array(start, dtype=np.int64)), seed)
    status = evolve(trials.run, counts, first, evaluations=evaluations, seed=seed)
    return trials.optimum(seed, status)


@dataclass(slots=True)
class Trials:
    """Setups evaluated so far.

    Attributes:
        space: Space of the setups.
        evaluate: Function that runs setups by number.
        indices: Numbers of the setups, batch by batch.
        scores: Objectives and violations of the setups, batch by batch.
    """

    space: SetupSpace
    evaluate: Evaluate
    indices: list[Integers] = field(default_factory=list)
    scores: list[Scores] = field(default_factory=list)

    def run(self, levels: Integers) -> Scores:
        """Evaluate a batch of setups by their levels (K, F)."""
        self.indices.append(indices_of(self.space, levels))
        self.scores.append(self.evaluate(self.indices[-1]))
        return self.scores[-1]

    def optimum(self, seed: int, status: str) -> Optimum:
        """Return the evaluated setups with the reason why the search ended."""
        objectives, violations = (np.concatenate(part) for part in zip(*self.scores, strict=True))
        return Optimum(np.concatenate(self.indices), objectives, violations, seed, status)


def _first_generation(counts: tuple[int, ...], population: int, start: Integers, seed: int) -> Integers:
    """Return different setups (P, F): `start`, then setups with every build equally frequent at every position."""
    generator = np.random.default_rng(seed)
    chosen = dict.fromkeys(tuple(row) for row in start.tolist())
    while len(chosen) < population:
        columns = [generator.permutation(np.arange(population) % count) for count in counts]
        chosen |= dict.fromkeys(tuple(row) for row in np.stack(columns, axis=-1).tolist())
    return np.array(list(chosen)[:population], dtype=np.int64)
