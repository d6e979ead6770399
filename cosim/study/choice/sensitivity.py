"""Sensitivity of measures to the builds at each corner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np
from arro3.core import DataType, Field, Schema
from scipy.linalg import cho_factor, cho_solve, helmert

from cosim.components.component import Variable
from cosim.study.choice.certainty import OBJECTIVE
from cosim.study.definition import Build, Parameters, SetupSpace
from cosim.study.running.evaluator import Evaluator, coupling_of
from cosim.study.running.sweep import Trials
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult, error_column
from eightpost.array_types import Array, Integers
from eightpost.errors import InputError, StepError
from eightpost.signals.parquet_file import Table, write_table

# ---- Factors --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Factor:
    """A position at which builds are exchanged: a corner, or corners that always have the same build."""

    name: str  #: Name of the corner, or of the corners as `lf+rf`.
    builds: tuple[str, ...]  #: Allowed builds; their order has no meaning.


def factors_of(space: SetupSpace) -> tuple[Factor, ...]:
    """Return the F factors of a space, including those with a single build."""
    found = []
    for group in _groups(space):
        first, *others = (space.corners[corner] for corner in group)
        common = tuple(build for build in first if all(build in other for other in others))
        found.append(Factor("+".join(group), common))
    return tuple(found)


def levels_of(space: SetupSpace, indices: Integers) -> Integers:
    """Return the builds of setups as indices into the factors' builds.

    Args:
        indices: Numbers of setups (N,); each must satisfy `alike` of the space.

    Returns:
        Index of the build of each factor (N, F).
    """
    digits, corners = space.digits(indices), list(space.corners)
    columns = []
    for group, factor in zip(_groups(space), factors_of(space), strict=True):
        place = {build: level for level, build in enumerate(factor.builds)}
        known = np.array([place.get(build, -1) for build in space.corners[group[0]]])
        columns.append(known[digits[:, corners.index(group[0])]])
    return np.stack(columns, axis=-1)


def indices_of(space: SetupSpace, levels: Integers) -> Integers:
    """Return the numbers (N,) of the setups with these levels (N, F); the inverse of `levels_of`."""
    digits = np.empty((levels.shape[0], len(space.corners)), dtype=np.int64)
    corners = list(space.corners)
    for group, factor, level in zip(_groups(space), factors_of(space), levels.T, strict=True):
        for corner in group:
            own = np.array([space.corners[corner].index(build) for build in factor.builds])
            digits[:, corners.index(corner)] = own[level]
    return np.asarray(np.ravel_multi_index(tuple(digits.T), space.radices), dtype=np.int64)


def _groups(space: SetupSpace) -> list[tuple[str, ...]]:
    """Return the corners in groups with the same build, in the corners' order; overlapping groups are merged."""
    group = {corner: {corner} for corner in space.corners}
    for alike in space.alike:
        joined = set().union(*(group[corner] for corner in alike))
        group |= dict.fromkeys(joined, joined)
    sorted_groups = (tuple(c for c in space.corners if c in group[corner]) for corner in space.corners)
    return list(dict.fromkeys(sorted_groups))


# ---- Sensitivity of measures to the corners -------------------------------------------------------------------------


#: Method of computing the terms: `exact` (averages over the whole bank), `fitted`, or `fitted main effects` alone.
Method = Literal["exact", "fitted", "fitted main effects"]


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """The terms of one measure, in the measure's unit."""

    measure: str  #: Name of the measure.
    factors: tuple[Factor, ...]  #: The F factors.
    mean: float  #: Mean over all setups.
    main: Mapping[str, Array]  #: Main effect of each build (L_f,), by factor.
    #: Interaction of each two builds (L_f, L_g) in addition to their main effects, by pair of factors; empty if too few
    #: setups were run.
    pairs: Mapping[tuple[str, str], Array]
    rest: float  #: Variance not explained by the terms: higher interactions, and the residual if only a part was run.
    setups: int  #: Number of setups used.
    method: Method  #: Method that computed the terms.

    @property
    def variance(self) -> float:
        """Variance of the measure over all setups, in the square of its unit."""
        terms = (*self.main.values(), *self.pairs.values())
        return float(sum(np.mean(term**2) for term in terms)) + self.rest

    def share(self, *names: str) -> float:
        """Return the share of the variance [1] of a factor, or of the interaction of two factors."""
        pairs = {**self.pairs, **{(second, first): term for (first, second), term in self.pairs.items()}}
        term = self.main[names[0]] if len(names) == 1 else pairs[names[0], names[1]]
        return self._part(float(np.mean(term**2)))

    def total(self, name: str) -> float:
        """Return the share of the variance [1] of a factor including all its first-order interactions."""
        return self.share(name) + sum(self.share(*pair) for pair in self.pairs if name in pair)

    @property
    def rest_share(self) -> float:
        """Share of the variance [1] that neither main effects nor pairs explain."""
        return self._part(self.rest)

    def _part(self, variance: float) -> float:
        whole = self.variance
        return variance / whole if whole > 0.0 else 0.0


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
    free = [place for place, factor in enumerate(factors) if len(factor.builds) > 1]
    return [factors[k] for k in free], levels_of(result.study.space, result.setups)[:, free]


def sensitivity(factors: Sequence[Factor], levels: Integers, values: Array, measure: str = "") -> Sensitivity:
    """Return the sensitivity of a measure to the factors.

    Args:
        levels: Index of the build of each factor (N, F), one row per setup, no setup twice.
        values: Values of the measure (N,); failed setups (NaN) are ignored.

    Raises:
        InputError: Too few setups were run for the main effects.
    """
    done = np.isfinite(values)
    levels, values = np.ascontiguousarray(levels[done], dtype=np.int64), values[done]
    whole = values.size == prod(len(factor.builds) for factor in factors)
    return (_exact if whole else _fitted)(factors, levels, values, measure)


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
    for pairs in (tuple(combinations(range(len(factors)), 2)), ()):
        design = _design(tuple(len(factor.builds) for factor in factors), levels.tobytes(), pairs)
        if design is not None:
            break
    else:
        needed = 2 + sum(len(f.builds) - 1 for f in factors)
        raise InputError(
            f"{measure}: {values.size} setups are too few to separate the factors; run {needed} or more, with every "
            "build at every position and no two positions always alike"
        )
    (mean, *effects), squares = design.solve(values)
    main = {factor.name: effect for factor, effect in zip(factors, effects, strict=False)}
    joint = {
        (factors[i].name, factors[j].name): effect.reshape(len(factors[i].builds), -1)
        for (i, j), effect in zip(pairs, effects[len(factors) :], strict=True)
    }
    method: Method = "fitted" if pairs else "fitted main effects"
    rest = squares / (values.size - design.columns)
    return Sensitivity(measure, tuple(factors), float(mean[0]), main, joint, rest, values.size, method)


#: Smallest eigenvalue of the normal equations, relative to the largest, of effects that the setups determine.
_DETERMINED = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class _Design:
    """Least squares for the mean, the main effects and the interactions.

    The normal equations are sums over tables of counts, so that no matrix has a row per setup.
    """

    cells: tuple[Integers, ...]  #: Cell of every setup in each term, e.g. the level of a factor (N,).
    codes: tuple[Array, ...]  #: Effects of the cells for each coefficient of a term (cells, columns); they sum to zero.
    factor: tuple[Array, bool]  #: Cholesky factor of the normal equations.

    @property
    def columns(self) -> int:
        """Number of coefficients."""
        return sum(code.shape[1] for code in self.codes)

    def solve(self, values: Array) -> tuple[list[Array], float]:
        """Return the effects of every term's cells, and the sum of the squared residuals, for values (N,)."""
        sums = [np.bincount(cell, values, len(code)) for cell, code in zip(self.cells, self.codes, strict=True)]
        right = np.concatenate([code.T @ one for code, one in zip(self.codes, sums, strict=True)])
        solution = cho_solve(self.factor, right)
        parts = np.split(solution, np.cumsum([code.shape[1] for code in self.codes])[:-1])
        effects = [code @ part for code, part in zip(self.codes, parts, strict=True)]
        fitted = np.sum([effect[cell] for effect, cell in zip(effects, self.cells, strict=True)], axis=0)
        return effects, float(np.sum((values - fitted) ** 2))


@lru_cache(maxsize=2)  # most measures of a study are known for the same setups
def _design(sizes: tuple[int, ...], levels: bytes, pairs: tuple[tuple[int, int], ...]) -> _Design | None:
    """Return the design of the mean, all main effects and some pairs; None if the setups do not determine them."""
    columns = np.frombuffer(levels, dtype=np.int64).reshape(-1, len(sizes)).T
    coded = [np.asarray(helmert(size).T, dtype=np.float64) for size in sizes]  # columns of sum 0, orthonormal
    cells = [np.zeros_like(columns[0]), *columns, *(columns[i] * sizes[j] + columns[j] for i, j in pairs)]
    products = [np.asarray(np.kron(coded[i], coded[j]), dtype=np.float64) for i, j in pairs]
    codes: list[Array] = [np.ones((1, 1)), *coded, *products]
    if columns.shape[1] <= sum(code.shape[1] for code in codes):
        return None
    terms = list(zip(cells, codes, strict=True))
    normal = np.block([[_block(first, second) for second in terms] for first in terms])
    found = np.linalg.eigvalsh(normal)
    if found[0] <= _DETERMINED * found[-1]:
        return None
    return _Design(tuple(cells), tuple(codes), cho_factor(normal))


def _block(first: tuple[Integers, Array], second: tuple[Integers, Array]) -> Array:
    """Return one block of the normal equations from the number of setups in each pair of cells."""
    (cell, code), (other, coded) = first, second
    counts = np.bincount(cell * len(coded) + other, minlength=len(code) * len(coded)).reshape(len(code), len(coded))
    return np.asarray(code.T @ counts @ coded, dtype=np.float64)


# ---- Table of sensitivities, with one row per term and builds, for other programs and for plots ---------------------

_TEXTS = ("measure", "unit", "first", "second", "first_build", "second_build")
_NUMBERS = ("effect", "share")
_COLUMNS = Schema([
    *(Field(name, DataType.string()) for name in _TEXTS),
    *(Field(name, DataType.float64()) for name in _NUMBERS),
    Field("method", DataType.string()),
])  # fmt: skip


def write_terms(sensitivities: Sequence[Sensitivity], units: Mapping[str, str], path: str | Path) -> None:
    """Write a table of all terms of all measures as a Parquet file.

    Columns: `measure`, its SI `unit`, the factors `first` and `second` (empty for a main effect) and their builds, the
    `effect` [unit] of these builds, the `share` of the variance [1] of the term, and the `method`.
    """
    rows = [row for one in sensitivities for row in _rows(one, units[one.measure])]
    write_table(Table.of_rows(rows, _COLUMNS), Path(path))


def _rows(sensitivity: Sensitivity, unit: str) -> Iterator[dict[str, Any]]:
    builds = {factor.name: factor.builds for factor in sensitivity.factors}
    common = {"measure": sensitivity.measure, "unit": unit, "method": sensitivity.method}
    for name, effects in sensitivity.main.items():
        term = common | {"first": name, "second": "", "second_build": "", "share": sensitivity.share(name)}
        for build, effect in zip(builds[name], effects.tolist(), strict=True):
            yield term | {"first_build": build, "effect": effect}
    for (first, second), effects in sensitivity.pairs.items():
        term = common | {"first": first, "second": second, "share": sensitivity.share(first, second)}
        for build, row in zip(builds[first], effects.tolist(), strict=True):
            for other, effect in zip(builds[second], row, strict=True):
                yield term | {"first_build": build, "second_build": other, "effect": effect}


# ==== Changes of every measure by a change at single corners: two runs of one setup, with and without it =============


@dataclass(frozen=True, slots=True)
class MeasureChange:
    """Change of one measure by a change of the shocks, in the measure's display unit."""

    measure: str  #: Name of the measure.
    unit: str  #: Display unit.
    before: float  #: Value without the change.
    after: float  #: Value with the change.
    noise: float  #: Estimated coupling error of a single run; NaN if not known.

    @property
    def change(self) -> float:
        """Value with the change less the value without it."""
        return self.after - self.before

    @property
    def relative(self) -> float:
        """Change as a share of the value without it [1]; NaN if that is 0."""
        return self.change / self.before if self.before else float("nan")

    @property
    def is_clear(self) -> bool:
        """Whether the change is larger than the coupling error of a run."""
        return not abs(self.change) <= self.noise


def shock_at(
    result: StudyResult, evaluator: Evaluator, corner: str, setup: int | None = None
) -> tuple[Build, Mapping[str, Variable]]:
    """Return the build at a corner of a setup (default: the baseline, or else the best), and its FMU's variables.

    Raises:
        InputError: There is no such corner or setup.
    """
    builds = _builds(result, setup)
    if corner not in builds:
        raise InputError(f"there is no corner {corner!r}; the corners are {', '.join(builds)}")
    shock = evaluator.system(result.study.space.find(builds)).components[corner]
    return result.study.bank[builds[corner]], shock.variables


def what_if(
    result: StudyResult,
    workers: Workers,
    changes: Mapping[str, Parameters],
    *,
    setup: int | None = None,
    before: Mapping[str, Parameters] | None = None,
) -> tuple[MeasureChange, ...]:
    """Return the effect of other parameters of the shocks at some corners on the objective and every measure.

    Args:
        result: Result of a study; its FMUs and drive files must still exist at their paths.
        changes: Parameters that change, by corner, such as `{"lr": {"clicks.rebound": 13.0}}`.
        setup: Number of the setup; None: the baseline, or else the best setup.

    Raises:
        InputError: There is no such corner or setup, or nothing changes.
        StepError: A run failed.
    """
    if not any(changes.values()):
        raise InputError("nothing changes; name a corner and a parameter of its shock")
    builds = {corner: result.study.bank[name] for corner, name in _builds(result, setup).items()}
    for corner in (*changes, *(before or {})):
        if corner not in builds:
            raise InputError(f"there is no corner {corner!r}; the corners are {', '.join(builds)}")
    first = _with(builds, before or {})
    trials = Trials(result.study, result.provenance.measure_units, workers, coupling_of(result))
    runs = trials.run([first, _with(first, changes)])
    if not runs.done.all():
        raise StepError(f"a run failed: {runs.failures[0][1]}")
    return _effects(runs)


def _builds(result: StudyResult, setup: int | None) -> Mapping[str, str]:
    """Return the builds by corner of a setup by its number, of the baseline, or of the best setup."""
    if setup is not None:
        return result.study.space.setup(setup).builds
    if result.study.baseline:
        return result.study.baseline
    ranked = result.ranking()
    if not ranked.size:
        raise InputError("no setup of the study meets its constraints; name one with --setup")
    return result.setup(int(ranked[0])).builds


def _with(builds: Mapping[str, Build], changes: Mapping[str, Parameters]) -> dict[str, Build]:
    return {
        corner: replace(build, parameters={**build.parameters, **changes.get(corner, {})})
        for corner, build in builds.items()
    }


def _effects(runs: StudyResult) -> tuple[MeasureChange, ...]:
    found = []
    if runs.objective is not None:
        before, after = runs.objective.tolist()
        noise = float(sum(abs(runs.factor(term)) * _noise(runs, term.measure) for term in runs.study.objective))
        found.append(MeasureChange(OBJECTIVE, "", before, after, noise))
    for measure in runs.measures:
        noise = runs.shown_difference(measure.name, _noise(runs, measure.name))
        before, after = runs.shown(measure.name).tolist()
        found.append(MeasureChange(measure.name, runs.display(measure.name), before, after, noise))
    return tuple(found)


def _noise(runs: StudyResult, measure: str) -> float:
    """Return the larger coupling error of a measure of both runs [SI]; NaN if it is not known."""
    return float(np.max(np.abs(runs.column(error_column(measure)))))
