"""Uncertainty of the measures of a study, setup by setup."""

from __future__ import annotations

from typing import Literal

import numpy as np

from cosim.study.choice.robust import REACH, Spread
from cosim.study.report.sheet import Array, Uncertainty
from cosim.study.result import StudyResult


def uncertainty_of(result: StudyResult, band: Spread) -> Uncertainty:
    """Return the uncertainty of a result's setups according to a spread; NaN for setups that it does not contain."""
    places = np.searchsorted(result.setups, band.setups)
    sign = 1.0 if better_end(result, band.measure) == "low" else -1.0
    first = _place(band, result, int(result.ranking()[0]) if result.ranking().size else None)
    known = np.isfinite(band.values)
    best = int(np.nanargmin(sign * band.values)) if known.any() else None
    above, deviation = (np.zeros(known.size),) * 2 if best is None else band.difference(best)
    tied = np.zeros(len(result), dtype=np.bool_)
    tied[places] = known & ~(sign * above > REACH * deviation)
    return Uncertainty(
        _spread_out(result, places, REACH * band.deviation),
        _spread_out(result, places, _of_difference(band, first)),
        _spread_out(result, places, _of_difference(band, _place(band, result, result.baseline_row))),
        tied,
    )


def better_end(result: StudyResult, measure: str) -> Literal["low", "high"]:
    """Return whether low or high values of a measure are better: high if its weight in the objective is negative."""
    rewarded = any(term.measure == measure and term.weight < 0.0 for term in result.study.objective)
    return "high" if rewarded else "low"


def _place(band: Spread, result: StudyResult, row: int | None) -> int | None:
    """Return the position of a result's row in the spread; None if the spread does not contain it."""
    found = np.flatnonzero(band.setups == result.setups[row]) if row is not None else np.empty(0, dtype=np.int64)
    return int(found[0]) if found.size else None


def _of_difference(band: Spread, place: int | None) -> Array:
    if place is None:
        return np.full(band.setups.size, np.nan)
    return np.asarray(REACH * band.difference(place)[1], dtype=np.float64)


def _spread_out(result: StudyResult, places: np.ndarray[tuple[int], np.dtype[np.int64]], values: Array) -> Array:
    whole = np.full(len(result), np.nan)
    whole[places] = values
    return whole
