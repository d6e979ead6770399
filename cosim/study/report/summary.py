"""Texts and figures at the top of the page, and its tables of extremes and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np

from cosim.report.figures import figure, percent
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.report.scale import Scale, Shown
from cosim.study.report.sheet import Column, Sheet

#: Share of a measure's variance [1] above which a corner is highlighted.
MATTERS = 0.05


@dataclass(frozen=True, slots=True)
class Tile:
    """A figure at the top of the page, in US customary (`us`) and metric (`metric`) units."""

    what: str
    us: str
    metric: str
    detail: str


@dataclass(frozen=True, slots=True)
class Share:
    """Shares of a measure's variance [1]: of each corner with its interactions, and of all interactions of two."""

    column: int
    name: str
    totals: tuple[float, ...]
    interactions: float
    method: str


def headline(sheet: Sheet) -> str:
    """Return a summary: how many setups ran, failed and are marked, which one is best, and remarks on it."""
    failed, marked, done = len(sheet.failures), len(sheet.marks), int(sheet.done.sum())
    counts = f"{done} setups ran{f', {failed} failed' if failed else ''}, {marked} marked."
    return " ".join((counts, *_best(sheet)))


def _best(sheet: Sheet) -> Iterator[str]:
    feasible = int(np.sum(sheet.allowed & sheet.done))
    if feasible:
        best = int(sheet.order[0])
        yield f"Best: setup {sheet.numbers[best]} ({sheet.fitted(best)})."
        if sheet.background.constraints:
            yield f"{feasible} setups meet all constraints."
        yield from _remarks_on_best(sheet, best)


def _remarks_on_best(sheet: Sheet, best: int) -> Iterator[str]:
    """Yield remarks on the best setup: its mark, and how many setups are tied with it."""
    if best in sheet.marks:
        yield f"The best setup is marked: {sheet.marks[best]}."
    column = sheet.ranked_by
    if column.uncertainty is not None:
        close = np.abs(column.values - column.values[best]) <= column.uncertainty.from_best
        yield f"{int(np.sum(close & sheet.allowed)) - 1} other setups are tied with the best."


def tiles(sheet: Sheet) -> tuple[Tile, ...]:
    """Return the figures at the top of the page."""
    return tuple(_tiles(sheet)) if sheet.done.any() else ()


def _tiles(sheet: Sheet) -> Iterator[Tile]:
    column, best = sheet.ranked_by, int(sheet.order[0])
    us, metric = _both(column.scale, float(column.values[best]))
    yield Tile(f"best {column.name}", us, metric, f"setup {sheet.numbers[best]}")
    if sheet.baseline is not None and sheet.done[sheet.baseline]:
        base = float(column.values[sheet.baseline])
        gain = percent(100.0 * (float(column.values[best]) - base) / abs(base)) if base else "not defined"
        yield Tile("best compared with baseline", gain, gain, f"baseline: setup {sheet.numbers[sheet.baseline]}")
        place = str(int(np.flatnonzero(sheet.order == sheet.baseline)[0]) + 1)
        yield Tile("rank of the baseline", place, place, sheet.fitted(sheet.baseline))
    known = sheet.coupling_error[np.isfinite(sheet.coupling_error)]
    if known.size:
        worst = percent(float(known.max()))
        yield Tile("largest coupling error", worst, worst, f"median {percent(float(np.median(known)))}")
    ran = f"{int(sheet.done.sum())}"
    yield Tile("setups", ran, ran, f"{len(sheet.failures)} failed, {len(sheet.marks)} marked")


def _both(scale: Scale, value: float) -> tuple[str, str]:
    return _with_unit(scale.us, value), _with_unit(scale.metric, value)


def _with_unit(shown: Shown, value: float) -> str:
    return fixed(shown(value)) if shown.unit == "1" else f"{fixed(shown(value))} {shown.unit}"


def fixed(value: float, digits: int = 4) -> str:
    """Return a number with all significant digits, including trailing zeros, so that the digits of a column align.

    >>> fixed(162.0), fixed(-0.05)
    ('162.0', '−0.05000')
    """
    if not 1e-4 <= abs(value) < 1e5:
        return figure(value, digits)
    places = max(0, digits - 1 - floor(log10(abs(value))))
    return f"{value:.{places}f}".replace("-", "−")


def extremes(columns: Sequence[Column]) -> tuple[tuple[Column, int, int], ...]:
    """Return for every column the rows of its minimum and its maximum, as in Table 7.4."""
    known = [column for column in columns if np.isfinite(column.values).any()]
    return tuple((column, int(np.nanargmin(column.values)), int(np.nanargmax(column.values))) for column in known)


def shares(terms: Sequence[Sensitivity], places: Mapping[str, int]) -> tuple[Share, ...]:
    """Return the shares of the corners in the variance of each measure; `places` are the columns of the measures."""
    return tuple(
        Share(
            places[one.measure],
            one.measure,
            tuple(one.total(factor.name) for factor in one.factors),
            sum(one.share(*pair) for pair in one.pairs),
            one.method,
        )
        for one in terms
        if one.measure in places
    )
