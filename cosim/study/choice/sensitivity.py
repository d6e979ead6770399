"""Sensitivity of measures to the corners: main effects and first-order interactions of the builds.

The functional analysis of variance of a measure y over all setups (s_1, ..., s_F), with equally likely builds, is

    y(s) = mean + sum_f y_f(s_f) + sum_{f<g} y_fg(s_f, s_g) + rest.

Every term has the mean 0 over each of its arguments, so that the variances of the terms add up to the variance of y.
If the whole bank was run, the terms are averages and exact. If only a part of it was run, they are fitted by least
squares, and the rest is the residual.

I. M. Sobol', Mathematics and Computers in Simulation 55 (2001) 271, doi:10.1016/S0378-4754(00)00270-6.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert

from cosim.study.choice.factor import Factor, factors_of, levels_of, varied
from cosim.study.result import StudyResult
from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Method of computing the terms: `exact` (averages over the whole bank), `fitted`, or `fitted main effects` alone.
Method = Literal["exact", "fitted", "fitted main effects"]


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """The terms of one measure, in the measure's unit.

    Attributes:
        measure: Name of the measure.
        factors: The F factors.
        mean: Mean over all setups.
        main: Main effect of each build (L_f,), by factor.
        pairs: Interaction of each two builds (L_f, L_g) in addition to their main effects, by pair of factors; empty if
            too few setups were run.
        rest: Variance not explained by the terms: higher interactions, and the residual if only a part was run.
        setups: Number of setups used.
        method: Method that computed the terms.
    """

    measure: str
    factors: tuple[Factor, ...]
    mean: float
    main: Mapping[str, Array]
    pairs: Mapping[tuple[str, str], Array]
    rest: float
    setups: int
    method: Method

    @property
    def variance(self) -> float:
        """Variance of the measure over all setups, in the square of its unit."""
        terms = (*self.main.values(), *self.pairs.values())
        return float(sum(np.mean(term**2) for term in terms)) + self.rest

    def share(self, *names: str) -> float:
        """Return the share of the variance [1] of a factor, or of the interaction of two factors."""
        term = self.main[names[0]] if len(names) == 1 else self._pair(*names)
        return self._part(float(np.mean(term**2)))

    def total(self, name: str) -> float:
        """Return the share of the variance [1] of a factor including all its first-order interactions."""
        return self.share(name) + sum(self.share(*pair) for pair in self.pairs if name in pair)

    @property
    def rest_share(self) -> float:
        """Share of the variance [1] that neither main effects nor pairs explain."""
        return self._part(self.rest)

    def shares(self) -> Iterator[tuple[str, float]]:
        """Yield names and shares of the variance [1]: factors, pairs (`lf x rf`), rest."""
        yield from ((name, self.share(name)) for name in self.main)
        yield from ((" x ".join(pair), self.share(*pair)) for pair in self.pairs)
        yield "rest", self.rest_share

    def _pair(self, first: str, second: str) -> Array:
        return self.pairs[first, second] if (first, second) in self.pairs else self.pairs[second, first]

    def _part(self, variance: float) -> float:
        return variance / self.variance if self.variance > 0.0 else 0.0


def sensitivities_of(result: StudyResult) -> tuple[Sensitivity, ...]:
    """Return the sensitivity of every measure of a study to the corners, in the table's order and units.

    Corners that always have the same build are one factor; corners with a single allowed build are omitted.

    Raises:
        InputError: No corner has a choice of builds, or too few setups were run for the main effects.
    """
    factors, levels = _varied(result)
    if not factors:
        raise InputError(
            f"{result.study.name}: every corner has only one build, so there are no sensitivities to compute"
        )
    names = (measure.name for measure in result.measures)
    return tuple(sensitivity(factors, levels, result.values(name), name) for name in names)


def available_sensitivities(result: StudyResult) -> tuple[Sensitivity, ...]:
    """Return the sensitivities that can be computed from the setups that ran; empty if no corner has a choice."""
    factors, levels = _varied(result)
    names = [measure.name for measure in result.measures if np.isfinite(result.values(measure.name)).any()]
    found = list[Sensitivity]()
    for name in names if factors else ():
        with suppress(InputError):  # too few setups were run
            found.append(sensitivity(factors, levels, result.values(name), name))
    return tuple(found)


def _varied(result: StudyResult) -> tuple[list[Factor], Integers]:
    """Return the factors with two or more builds, and their levels (N, F), one row per setup."""
    factors = factors_of(result.study.space)
    free = varied(factors)
    return [factors[k] for k in free], levels_of(result.study.space, result.setups)[:, free]


def sensitivity(factors: Sequence[Factor], levels: Integers, values: Array, measure: str = "") -> Sensitivity:
    """Return the sensitivity of a measure to the factors.

    Args:
        factors: The F factors, each with two or more builds.
        levels: Index of the build of each factor (N, F), one row per setup, no setup twice.
        values: Values of the measure (N,); failed setups (NaN) are ignored.
        measure: Name of the measure.

    Raises:
        InputError: The shapes disagree, a setup occurs twice, or too few setups were run for the main effects.
    """
    shape = tuple(len(factor.builds) for factor in factors)
    levels, values = _checked(shape, levels, values, measure)
    if values.size == np.prod(shape, dtype=np.int64):
        return _exact(factors, levels, values, measure)
    return _fitted(factors, levels, values, measure)


def _checked(shape: tuple[int, ...], levels: Integers, values: Array, measure: str) -> tuple[Integers, Array]:
    if levels.shape != (values.size, len(shape)):
        raise InputError(
            f"{measure}: {values.size} values of {len(shape)} factors need levels of the shape "
            f"{(values.size, len(shape))}, not {levels.shape}"
        )
    done = np.isfinite(values)
    numbers = np.ravel_multi_index(tuple(levels[done].T), shape)
    if np.unique(numbers).size != numbers.size:
        raise InputError(f"{measure}: a setup occurs twice; give each setup once")
    return levels[done], values[done]


def _exact(factors: Sequence[Factor], levels: Integers, values: Array, measure: str) -> Sensitivity:
    grid = np.empty(tuple(len(factor.builds) for factor in factors))
    grid[tuple(levels.T)] = values
    mean = float(grid.mean())
    main = {f.name: _average(grid, keep=(i,)) - mean for i, f in enumerate(factors)}
    pairs = {}
    for (i, f), (j, g) in combinations(enumerate(factors), 2):
        pairs[f.name, g.name] = _average(grid, keep=(i, j)) - mean - main[f.name][:, None] - main[g.name]
    explained = sum(float(np.mean(term**2)) for term in (*main.values(), *pairs.values()))
    rest = max(float(grid.var()) - explained, 0.0)
    return Sensitivity(measure, tuple(factors), mean, main, pairs, rest, values.size, "exact")


def _average(grid: Array, *, keep: tuple[int, ...]) -> Array:
    others = tuple(axis for axis in range(grid.ndim) if axis not in keep)
    return np.asarray(grid.mean(axis=others), dtype=np.float64)


def _fitted(factors: Sequence[Factor], levels: Integers, values: Array, measure: str) -> Sensitivity:
    """Fit the terms, with pairs if the setups determine them and leave degrees of freedom, else without."""
    codes = {f.name: helmert(len(f.builds)).T for f in factors}  # columns of sum 0, orthonormal
    main = {f.name: codes[f.name][levels[:, i]] for i, f in enumerate(factors)}
    pairs = {(f, g): _products(main[f], main[g]) for f, g in combinations(main, 2)}
    for kept in (pairs, {}):
        columns = np.hstack([np.ones((values.size, 1)), *main.values(), *kept.values()])
        if values.size > columns.shape[1] == np.linalg.matrix_rank(columns):
            break
    else:
        raise InputError(_too_few(factors, values.size, measure))
    solution, squares, *_ = np.linalg.lstsq(columns, values, rcond=None)
    parts = iter(np.split(solution, np.cumsum([1, *(b.shape[1] for b in (*main.values(), *kept.values()))])[:-1]))
    mean = float(next(parts)[0])
    effects = {name: code @ next(parts) for name, code in codes.items()}
    joint = {(f, g): _joint(codes[f], codes[g], next(parts)) for f, g in kept}
    rest = float(squares[0]) / (values.size - columns.shape[1])
    method: Method = "fitted" if kept else "fitted main effects"
    return Sensitivity(measure, tuple(factors), mean, effects, joint, rest, values.size, method)


def _products(a: Array, b: Array) -> Array:
    """Return every product of a column of `a` (N, p) with one of `b` (N, q): (N, p q)."""
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(a.shape[0], -1), dtype=np.float64)


def _joint(a: Array, b: Array, solution: Array) -> Array:
    """Return the interaction (L_f, L_g) of two factors from the coefficients of its products (p q,)."""
    return np.asarray(a @ solution.reshape(a.shape[1], b.shape[1]) @ b.T, dtype=np.float64)


def _too_few(factors: Sequence[Factor], setups: int, measure: str) -> str:
    needed = 2 + sum(len(f.builds) - 1 for f in factors)
    return (
        f"{measure}: {setups} setups are too few to separate the factors; run {needed} or more, with every build at "
        "every position and no two positions always alike"
    )
