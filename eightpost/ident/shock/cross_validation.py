"""Cross-validation of a law: parts of the records, or whole runs, are left out of the fit and then predicted.

The law is simulated freely over every record, with the parameters of a fit to the other parts, and only the part that
was left out counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

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

#: Smallest mean square error [1] that counts; smaller ones are rounding.
_FLOOR = 1e-14

#: An addition to a law must lower the error by this share, and by more than one standard error.
WORTHWHILE = 0.02

#: Maximum number of fits that leave out runs or builds; with more of these, several are left out together.
_MOST_FITS = 8

#: Parts of the records that are left out.
Parts = Literal["builds", "runs", "quarters"]


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """A part of the records that is left out of a fit and predicted."""

    kept: NDArray[np.bool_]  #: Whether each row (R,) is fitted.
    parts: tuple[slice, ...]  #: Rows that are predicted, each a part of one run.
    is_whole: bool  #: Whether the parts are whole runs. The offset of such a run is then unknown.


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of a law on what was left out."""

    #: Mean square error of each piece over the variance of the force of its run [1]; without the offset if whole runs
    #: were left out.
    pieces: tuple[float, ...]

    @property
    def percent(self) -> float:
        """Mean of the pieces' RMS errors in percent of the force's standard deviation."""
        return 100.0 * float(np.mean(np.sqrt(self.pieces)))

    def is_beaten_by(self, other: HeldOut) -> bool:
        """Return whether the other errors are lower by a notable share, and by more than one standard error.

        The pieces are compared one by one: all laws have larger errors on the same pieces, and one of these would
        outweigh the others in a difference of means.
        """
        ratios = _logarithms(self.pieces) - _logarithms(other.pieces)
        spread = float(np.std(ratios, ddof=1) / np.sqrt(ratios.size)) if ratios.size > 1 else 0.0
        return bool(ratios.mean() > max(spread, -np.log1p(-WORTHWHILE)))


@dataclass(frozen=True, slots=True)
class HeldOutErrors:
    """Errors of a fitted law on parts of the records that were left out of its fit, beside those of LPNL2."""

    left_out: Parts  #: Parts that were left out: `builds`, `runs` or `quarters`.
    percent: float  #: Error of the law in percent of the force's standard deviation.
    #: Error of LPNL2 on the same parts; None if the law is LPNL2, or if this cannot be fitted.
    lpnl2_percent: float | None = None

    def __str__(self) -> str:
        other = "" if self.lpnl2_percent is None else f" (LPNL2: {self.lpnl2_percent:.3g} %)"
        what = "quarters of the record" if self.left_out == "quarters" else f"whole {self.left_out}"
        return f"held-out error {self.percent:.3g} % of the force's standard deviation{other}, on {what}"

    def to_json(self) -> dict[str, Any]:
        """Return the errors as JSON values."""
        other = {} if self.lpnl2_percent is None else {"lpnl2_percent": self.lpnl2_percent}
        return {"left_out": self.left_out, "percent": self.percent, **other}


def _logarithms(pieces: tuple[float, ...]) -> Array:
    """Return the logarithms of RMS errors (P,), given mean squares."""
    return np.asarray(0.5 * np.log(np.maximum(pieces, _FLOOR)))


def left_out_blocks(runs: Runs) -> list[LeftOut]:
    """Return four sets of blocks with gaps; each set contains every fourth sixteenth of every run."""
    found = []
    for number in range(BLOCKS):
        kept, parts = np.ones(runs.target.size, dtype=bool), []
        for rows, rate in zip(_rows_of(runs), _rates(runs), strict=True):
            ends = np.linspace(rows.start, rows.stop, BLOCKS * PIECES + 1).astype(int).tolist()
            gap = round(min(_GAP * rate, _GAP_SHARE * (rows.stop - rows.start)))
            for start, stop in list(pairwise(ends))[number::BLOCKS]:
                kept[max(start - gap, rows.start) : min(stop + gap, rows.stop)] = False
                parts.append(slice(start, stop))
        found.append(LeftOut(kept, tuple(parts), is_whole=False))
    return found


def _left_out_runs(runs: Runs) -> list[LeftOut]:
    """Return each run, of many runs in groups."""
    rows, found = _rows_of(runs), []
    fits = min(len(rows), _MOST_FITS)
    for number in range(fits):
        kept, parts = np.ones(runs.target.size, dtype=bool), tuple(rows[number::fits])
        for part in parts:
            kept[part] = False
        found.append(LeftOut(kept, parts, is_whole=True))
    return found


def _left_out_builds(runs: Runs) -> list[LeftOut]:
    """Return all runs of each build, of many builds in groups."""
    builds, rows, found = runs.builds, _rows_of(runs), []
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
    """A fitted law and its predictions of parts that are left out, each computed once when it is needed."""

    fit: FittedLaw  #: Fit to all records, from which the fits without a part start.

    @property
    def left_out(self) -> Parts:
        """Whole builds or runs if each run has another of its motion that is not left out with it, else quarters."""
        runs = self.fit.runs
        return "builds" if runs.has_repeated_builds else "runs" if runs.has_repeated_motions else "quarters"

    def errors(self, counted: Array) -> HeldOut:
        """Return the errors on what is left out, with weights (R,) of the rows, such as 0 for outliers."""
        pieces: list[float] = []
        target, runs = self.fit.runs.target, _rows_of(self.fit.runs)
        for part, force in self._predicted:
            for rows in part.parts:
                measured, here, weights = target[rows], force[rows], counted[rows]
                run = next(run for run in runs if run.start <= rows.start < run.stop)
                variance = max(_deviation(target[run], counted[run]) ** 2, 1e-300)
                error = here - measured
                if part.is_whole:
                    error = error - np.average(error, weights=weights)
                pieces += _mean_squares(error, weights, variance)
        return HeldOut(tuple(pieces))

    @cached_property
    def _predicted(self) -> list[tuple[LeftOut, Array]]:
        """Each part with the force (R,) [N] of a fit without it."""
        runs = self.fit.runs
        left_out = {"builds": _left_out_builds, "runs": _left_out_runs, "quarters": left_out_blocks}[self.left_out]
        return [(part, self.fit.refitted_rows(runs.weights * part.kept)) for part in beats(left_out(runs))]


def _mean_squares(error: Array, weights: Array, variance: float) -> list[float]:
    """Return the mean square errors over a variance of the pieces of a part; a piece of outliers alone is left out."""
    ends = np.linspace(0, error.size, PIECES + 1).astype(int)
    slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
    return [
        float(np.average(error[here] ** 2, weights=weights[here])) / variance
        for here in slices
        if weights[here].sum() > 0.0
    ]


def _deviation(values: Array, weights: Array) -> float:
    return float(np.sqrt(np.average((values - np.average(values, weights=weights)) ** 2, weights=weights)))


def _rows_of(runs: Runs) -> list[slice]:
    ends = np.cumsum([0, *(f.rows.size for f in runs.filters)]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]


def _rates(runs: Runs) -> list[float]:
    return [f.row_rate for f in runs.filters]
