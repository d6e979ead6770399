"""HTML page of a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.report.origin import versions
from cosim.study.choice.selection import Selected
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.report.answer import answer_of
from cosim.study.report.packed import packed
from cosim.study.report.sheet import Column, Extras, Scale, Sheet, build_colors, shown_columns
from eightpost.array_types import Array, Integers
from eightpost.report import page as html
from eightpost.report.numbers import Display, fixed, percent
from eightpost.report.tables import Tile

# ---- Corner whose build explains most of a measure ------------------------------------------------------------------


def dominant_corner(sheet: Sheet, measure: Column) -> int:
    """Return the corner whose build explains most of a measure's variance; the first corner if no setup ran."""
    if not np.isfinite(measure.levels).any():
        return 0
    return int(np.argmax([_between(placed, measure.levels) for placed in sheet.placed.T]))


def _between(placed: Integers, levels: Array) -> float:
    """Return the variance of the means over the setups with each build."""
    known = np.isfinite(levels)
    counts = np.bincount(placed[known])
    means = np.bincount(placed[known], levels[known])[counts > 0] / counts[counts > 0]
    return float(np.average((means - levels[known].mean()) ** 2, weights=counts[counts > 0]))


# ---- Texts and figures at the top of the page, and its tables of extremes and sensitivities -------------------------

#: Share of a measure's variance [1] above which a corner is highlighted.
MATTERS = 0.05


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
        yield f"Best prediction: setup {sheet.numbers[best]} ({sheet.fitted(best)})."
        if sheet.background.constraints:
            yield f"{feasible} setups meet all constraints."
        yield from _remarks_on_best(sheet, best)


def _remarks_on_best(sheet: Sheet, best: int) -> Iterator[str]:
    """Yield remarks on the setup with the best prediction: its mark."""
    if best in sheet.marks:
        yield f"This setup is marked: {sheet.marks[best]}."


def tiles(sheet: Sheet) -> tuple[Tile, ...]:
    """Return the figures at the top of the page."""
    return tuple(_tiles(sheet)) if sheet.done.any() else ()


def _tiles(sheet: Sheet) -> Iterator[Tile]:
    column, best = sheet.ranked_by, int(sheet.order[0])
    us, metric = _both(column.scale, float(column.values[best]))
    yield Tile(f"best {column.name}", us, f"setup {sheet.numbers[best]}", metric)
    if sheet.baseline is not None and sheet.done[sheet.baseline]:
        base = float(column.values[sheet.baseline])
        gain = percent(100.0 * (float(column.values[best]) - base) / abs(base)) if base else "not defined"
        yield Tile("best compared with baseline", gain, f"baseline: setup {sheet.numbers[sheet.baseline]}")
        place = str(int(np.flatnonzero(sheet.order == sheet.baseline)[0]) + 1)
        yield Tile("rank of the baseline", place, sheet.fitted(sheet.baseline))
    known = sheet.coupling_error[np.isfinite(sheet.coupling_error)]
    if known.size:
        worst = percent(float(known.max()))
        yield Tile("largest coupling error", worst, f"median {percent(float(np.median(known)))}")
    ran = f"{int(sheet.done.sum())}"
    yield Tile("setups", ran, f"{len(sheet.failures)} failed, {len(sheet.marks)} marked")


def _both(scale: Scale, value: float) -> tuple[str, str]:
    return _with_unit(scale.us, value), _with_unit(scale.metric, value)


def _with_unit(shown: Display, value: float) -> str:
    return fixed(shown(value)) if shown.unit == "1" else f"{fixed(shown(value))} {shown.unit}"


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


# ---- The study's page -----------------------------------------------------------------------------------------------

#: Parts of the page's script, in the order of their dependencies.
_SCRIPTS = ("state", "table", "dots", "plots", "parallel", "setup", "compare", "sensitivity", "weights", "page")

#: Number of trade-offs that are drawn when the page opens.
_TRADES = 6

#: Number of columns of the ranking when the page opens, including the objective; the others can be added.
_TABLED = 7

#: Number of findings of the verdict that are shown at once: the answer and the ranking stay on the first screen.
_FOLDED = 2

#: Largest number of setups in the list of failed and marked setups; the ranking contains all of them.
_LISTED = 200


def page(sheet: Sheet, extras: Extras) -> str:
    """Return the page's HTML; names of measures, builds and files are escaped."""
    groups = _groups(sheet, extras.selection)
    picked = sorted({row for _, rows in groups for row in rows})
    manifest, numbers = packed(sheet, extras, picked)
    context = _words(sheet) | _choices(sheet) | _effects(sheet, extras.sensitivities)
    return html.page(
        "cosim.study.report",
        [f"script/{name}.js" for name in _SCRIPTS],
        **context,
        title=sheet.background.title,
        places=_places(sheet, groups),
        sheet=sheet,
        background=sheet.background,
        answer=answer_of(sheet),
        groups=groups,
        shock_pages=extras.shock_pages,
        aim=extras.aim,
        links={extras.aim.path: "Curves to aim at"} if extras.aim else {},
        ranks=np.argsort(sheet.order) + 1,
        selection_columns=_selected_for(sheet, extras.selection),
        traced=sorted(extras.traces),
        data={"manifest": manifest, "numbers": numbers},
    )


def _places(sheet: Sheet, groups: Sequence[Any]) -> Iterator[tuple[str, str]]:
    yield from (("table", "Ranking"), ("levels", "Levels"), ("tradeoffs", "Trade-offs"), ("parallel", "Measures"))
    yield from (("setup", "Setup"), ("comparison", "Side by side"))
    yield "sensitivity", "Sensitivity"
    if groups:
        yield "selected", "Selected"
    if sheet.failures or sheet.marks:
        yield "doubtful", "Failed, marked"
    yield "provenance", "Provenance"


def _words(sheet: Sheet) -> dict[str, Any]:
    problems = sorted(sheet.failures.items()) + sorted(sheet.marks.items())
    return {
        "verdict": sheet.background.verdict,
        "fold": _FOLDED,
        "headline": headline(sheet),
        "tiles": tiles(sheet),
        "problems": problems[:_LISTED],
        "more_problems": max(0, len(problems) - _LISTED),
        "versions": versions(),
    }


def _choices(sheet: Sheet) -> dict[str, Any]:
    """Return the choices of the page and their initial state: the first measure, against those that follow."""
    columns = shown_columns(sheet)
    first, *others = (columns.index(column) for column in sheet.measures)
    return {
        "columns": columns,
        "colors": build_colors(len(sheet.builds)),
        "present": [sorted(set(column.tolist())) for column in sheet.placed.T],
        "focus": first,
        "tabled": set(range(_TABLED)),
        "against": {first, *others[:_TRADES]},
        "colored": dominant_corner(sheet, columns[first]),
        "spreads": any(column.uncertainty is not None for column in columns),
    }


def _effects(sheet: Sheet, terms: Sequence[Sensitivity]) -> dict[str, Any]:
    columns = shown_columns(sheet)
    places = {column.name: k for k, column in enumerate(columns)}
    return {
        "shares": shares(terms, places),
        "factor_names": [factor.name for factor in terms[0].factors] if terms else [],
        "matters": MATTERS,
        "extremes": extremes(columns),
    }


def _groups(sheet: Sheet, selection: Sequence[Selected]) -> list[tuple[str, list[int]]]:
    """Return the rows of the selected setups, grouped by the reason for their selection."""
    groups: dict[str, list[int]] = {}
    for selected in selection:
        if (row := sheet.row(selected.setup.index)) is not None:
            groups.setdefault(f"{selected.measure}: {selected.end}", []).append(row)
    return list(groups.items())


def _selected_for(sheet: Sheet, selection: Sequence[Selected]) -> list[Column]:
    named = {selected.measure for selected in selection}
    return [column for column in sheet.measures if column.name in named]
