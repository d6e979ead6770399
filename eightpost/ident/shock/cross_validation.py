"""Cross-validation of a law: parts of the records, or whole runs, are left out of the fit and then predicted.

The law is simulated freely over every record, with the parameters of a fit to the other parts, and only the part that
was left out counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.runs import Runs
from eightpost.progress import beats

#: Number of contiguous blocks of a record, of which each is left out once.
BLOCKS = 4

#: Gap on either side of a block, in which the residual is correlated with that of the block [s], and its upper bound as
#: a share of the record.
_GAP, _GAP_SHARE = 0.3, 0.02

#: Number of pieces of a left-out block or run whose errors are counted one by one.
PIECES = 4

#: Errors that differ by less than this share count as equal: the fits are not more accurate.
TIE = 1e-3

#: Smallest mean square error [1] that counts; smaller ones are rounding.
_FLOOR = 1e-14

#: Maximum number of fits that leave out runs or builds; with more of these, several are left out together.
_MOST_FITS = 8


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """A part of the records that is left out of a fit and predicted.

    Attributes:
        kept: Whether each row (R,) is fitted.
        parts: Rows that are predicted, each a part of one run.
        is_whole: Whether the parts are whole runs. The offset and the level of such a run are then unknown.
    """

    kept: NDArray[np.bool_]
    parts: tuple[slice, ...]
    is_whole: bool


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of a law on what was left out, over the variance of the force of each run.

    Laws are compared by the ratios of their errors on the same pieces. In a mean of the errors or of their squares, the
    one piece that every law predicts badly would outweigh the others and hide which law is better on them.

    Attributes:
        pieces: Mean square error of each piece [1]; without offset and level if whole runs were left out.
        raw: Mean square error of each piece [1] about its mean, but including the level of the run.
    """

    pieces: tuple[float, ...]
    raw: tuple[float, ...]

    @property
    def percent(self) -> float:
        """Geometric mean of the pieces' RMS errors in percent of the force's standard deviation."""
        return _geometric_percent(self.pieces)

    @property
    def mean_percent(self) -> float:
        """Mean of the pieces' RMS errors in percent of the force's standard deviation; large if one piece is."""
        return 100.0 * float(np.mean(np.sqrt(self.pieces)))

    @property
    def raw_percent(self) -> float:
        """The same as `percent` for the errors that include the level of a run."""
        return _geometric_percent(self.raw)

    @property
    def spread(self) -> float:
        """Standard error of `percent`, to first order."""
        return self.percent * _standard_error(_logarithms(self.pieces))

    def is_as_good_as(self, best: HeldOut) -> bool:
        """Return whether the errors are within one standard error, or within `TIE`, of those of the best."""
        excess, error = self.excess_over(best)
        return excess <= max(error, TIE)

    def excess_over(self, other: HeldOut) -> tuple[float, float]:
        """Return the mean logarithm of the ratio of the RMS errors to those of another law, and its standard error.

        The pieces are compared one by one, because all laws have larger errors on the same pieces.
        """
        ratios = _logarithms(self.pieces) - _logarithms(other.pieces)
        return float(ratios.mean()), _standard_error(ratios)


def _logarithms(pieces: tuple[float, ...]) -> Array:
    """Return the logarithms of RMS errors (P,), given mean squares."""
    return np.asarray(0.5 * np.log(np.maximum(pieces, _FLOOR)))


def _geometric_percent(pieces: tuple[float, ...]) -> float:
    return 100.0 * float(np.exp(_logarithms(pieces).mean()))


def _standard_error(values: Array) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0


def left_out_blocks(runs: Runs) -> list[LeftOut]:
    """Return four contiguous blocks with gaps; each contains one quarter of every run."""
    found = []
    for number in range(BLOCKS):
        kept, parts = np.ones(runs.target.size, dtype=bool), []
        for rows, rate in zip(_rows_of(runs), _rates(runs), strict=True):
            size = rows.stop - rows.start
            gap = round(min(_GAP * rate, _GAP_SHARE * size))
            start, stop = (rows.start + size * k // BLOCKS for k in (number, number + 1))
            kept[max(start - gap, rows.start) : min(stop + gap, rows.stop)] = False
            parts.append(slice(start, stop))
        found.append(LeftOut(kept, tuple(parts), is_whole=False))
    return found


def left_out_runs(runs: Runs) -> list[LeftOut]:
    """Return each run; nothing if there is only one."""
    rows = _rows_of(runs)
    fits = min(len(rows), _MOST_FITS)
    found = []
    for number in range(fits if len(rows) > 1 else 0):
        kept, parts = np.ones(runs.target.size, dtype=bool), tuple(rows[number::fits])
        for part in parts:
            kept[part] = False
        found.append(LeftOut(kept, parts, is_whole=True))
    return found


def left_out_builds(runs: Runs) -> list[LeftOut]:
    """Return all runs of each build, of many builds in groups; nothing if there is one build, or one run of each."""
    builds, rows = runs.builds, _rows_of(runs)
    if not 2 <= len(builds) < len(rows):
        return []
    found = []
    fits = min(len(builds), _MOST_FITS)
    for number in range(fits):
        kept, group = np.ones(runs.target.size, dtype=bool), builds[number::fits]
        parts = tuple(part for part, p in zip(rows, runs.prepared, strict=True) if p.build in group)
        for part in parts:
            kept[part] = False
        found.append(LeftOut(kept, parts, is_whole=True))
    return found


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """A fitted law and its predictions of parts that are left out, each computed once when it is needed.

    Attributes:
        fit: Fit to all records, from which the fits without a part start.
    """

    fit: FittedLaw

    def blocks(self, counted: Array) -> HeldOut:
        """Return the errors on quarters of the records, with weights (R,) of the rows, such as 0 for outliers."""
        return self._errors(self._blocks, counted)

    def runs(self, counted: Array) -> HeldOut | None:
        """Return the errors on whole runs, with weights (R,) of the rows; None if there is only one run."""
        return self._errors(self._runs, counted) if self._runs else None

    def builds(self, counted: Array) -> HeldOut | None:
        """Return the errors on all runs of a build, with weights (R,) of the rows; None if there is only one build.

        With one run of each build these are the errors on whole runs.
        """
        if self._builds:
            return self._errors(self._builds, counted)
        return self.runs(counted) if len(self.fit.runs.builds) > 1 else None

    def decisive(self, counted: Array) -> HeldOut:
        """Return the errors that decide.

        These are the errors on whole builds or whole runs, if each run has another of its speed that is not left out
        with it, else those on quarters.
        """
        runs, found = self.fit.runs, None
        if runs.has_repeated_builds:
            found = self.builds(counted)
        elif runs.has_repeated_speeds:
            found = self.runs(counted)
        return found or self.blocks(counted)

    @cached_property
    def _blocks(self) -> list[tuple[LeftOut, Array]]:
        return self._predicted(left_out_blocks(self.fit.runs))

    @cached_property
    def _runs(self) -> list[tuple[LeftOut, Array]]:
        return self._predicted(left_out_runs(self.fit.runs))

    @cached_property
    def _builds(self) -> list[tuple[LeftOut, Array]]:
        return self._predicted(left_out_builds(self.fit.runs))

    def _predicted(self, left_out: Iterable[LeftOut]) -> list[tuple[LeftOut, Array]]:
        """Return each part with the force (R,) [N] of a fit without it."""
        return [(part, self.fit.refitted_rows(self.fit.runs.weights * part.kept)) for part in beats(left_out)]

    def _errors(self, predicted: Iterable[tuple[LeftOut, Array]], counted: Array) -> HeldOut:
        pieces: list[float] = []
        raw: list[float] = []
        for part, force in predicted:
            for rows in part.parts:
                measured, here, weights = self.fit.runs.target[rows], force[rows], counted[rows]
                variance = max(_deviation(measured, weights) ** 2, 1e-300)
                error = here - measured
                raw += _mean_squares(error - np.average(error, weights=weights) * part.is_whole, weights, variance)
                error = _without_level(here, measured, weights) if part.is_whole else error
                pieces += _mean_squares(error, weights, variance)
        return HeldOut(tuple(pieces), tuple(raw))


def _mean_squares(error: Array, weights: Array, variance: float) -> list[float]:
    """Return the mean square errors over a variance of the pieces of a part; a piece of outliers alone is left out."""
    ends = np.linspace(0, error.size, PIECES + 1).astype(int)
    slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
    return [
        float(np.average(error[here] ** 2, weights=weights[here])) / variance
        for here in slices
        if weights[here].sum() > 0.0
    ]


def _without_level(predicted: Array, measured: Array, weights: Array) -> Array:
    """Return the error (R,) of a prediction with the best offset and gain."""
    about = predicted - np.average(predicted, weights=weights)
    size = float(np.sum(weights * about**2))
    gain = float(np.sum(weights * about * measured)) / size if size > 0.0 else 0.0
    return np.asarray(gain * about + np.average(measured, weights=weights) - measured)


def _deviation(values: Array, weights: Array) -> float:
    return float(np.sqrt(np.average((values - np.average(values, weights=weights)) ** 2, weights=weights)))


def _rows_of(runs: Runs) -> list[slice]:
    ends = np.cumsum([0, *(f.rows.size for f in runs.filters)]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]


def _rates(runs: Runs) -> list[float]:
    return [f.row_rate for f in runs.filters]
