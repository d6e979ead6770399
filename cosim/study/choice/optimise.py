"""Integer optimisation: the best setups of a bank too large to try them all (Eq 2.3)."""

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

#: Setups in a generation: with 7 builds at 4 corners 10 to 40 take the same number of evaluations.
POPULATION = 20

Evaluate = Callable[[Integers], Scores]


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """All setups that an optimisation tried. N setups, O objectives, C constraints.

    Attributes:
        indices: (N,) their numbers, in the order in which they were tried, none twice.
        objectives: (N, O), the lower the better.
        violations: (N, C), as shares of the limits.
        seed: Of the random numbers.
        status: Why it ended, in words.
    """

    indices: Integers
    objectives: Array
    violations: Array
    seed: int
    status: str

    @property
    def allowed(self) -> Flags:
        """(N,) which setups ran and keep every constraint."""
        ran, kept = np.isfinite(self.objectives).all(axis=1), (self.violations <= 0.0).all(axis=1)
        return np.asarray(ran & kept, dtype=np.bool_)

    @property
    def best(self) -> int | None:
        """Number of the setup with the lowest first objective among the allowed ones; None where none is."""
        rows = np.flatnonzero(self.allowed)
        if rows.size == 0:
            return None
        return int(self.indices[rows[np.lexsort((self.indices[rows], self.objectives[rows, 0]))[0]]])

    @property
    def front(self) -> Integers:
        """Numbers of the allowed setups that no other allowed one beats in every objective, in order."""
        values = np.where(self.allowed[:, None], self.objectives, np.nan)
        return np.sort(self.indices[pareto_front(values)])

    def after(self, evaluations: int) -> Optimum:
        """Return what was known after so many evaluations."""
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
        space: Theta of Eq 2.3. If it has no more setups than evaluations all are tried.
        evaluate: Runs setups by their numbers (K,).
        evaluations: Most setups to try.
        seed: Of the random numbers.
        population: Setups in a generation; no more than evaluations.
        start: Setups by number that the first generation contains, such as the baseline.

    Raises:
        InputError: The numbers make no sense, or the extra `optimise` is not installed.
    """
    population = min(population, evaluations)
    if population < 2:
        raise InputError(f"a search needs generations of two setups or more, and as many evaluations, not {population}")
    factors = factors_of(space)
    counts = tuple(len(factor.builds) for factor in factors)
    trials = Trials(space, evaluate)
    if prod(counts) <= evaluations:
        trials.run(np.stack(np.unravel_index(np.arange(prod(counts)), counts), axis=-1))
        return trials.optimum(seed, "every setup was tried")
    first = _first_generation(counts, population, levels_of(space, np.array(start, dtype=np.int64)), seed)
    status = evolve(trials.run, counts, first, evaluations=evaluations, seed=seed)
    return trials.optimum(seed, status)


@dataclass(slots=True)
class Trials:
    """Setups tried so far, and the way to try more.

    Attributes:
        space: That they are of.
        evaluate: Runs them.
        indices: Their numbers, batch by batch.
        scores: What they reached, batch by batch.
    """

    space: SetupSpace
    evaluate: Evaluate
    indices: list[Integers] = field(default_factory=list)
    scores: list[Scores] = field(default_factory=list)

    def run(self, levels: Integers) -> Scores:
        """Try a batch of setups by their levels (K, F)."""
        self.indices.append(indices_of(self.space, levels))
        self.scores.append(self.evaluate(self.indices[-1]))
        return self.scores[-1]

    def optimum(self, seed: int, status: str) -> Optimum:
        """Return what was found, and why no more was tried."""
        objectives, violations = (np.concatenate(part) for part in zip(*self.scores, strict=True))
        return Optimum(np.concatenate(self.indices), objectives, violations, seed, status)


def _first_generation(counts: tuple[int, ...], population: int, start: Integers, seed: int) -> Integers:
    """Return different setups (P, F): those to start with, then such that every build is at every place as often."""
    generator = np.random.default_rng(seed)
    chosen = dict.fromkeys(tuple(row) for row in start.tolist())
    while len(chosen) < population:
        columns = [generator.permutation(np.arange(population) % count) for count in counts]
        chosen |= dict.fromkeys(tuple(row) for row in np.stack(columns, axis=-1).tolist())
    return np.array(list(chosen)[:population], dtype=np.int64)
