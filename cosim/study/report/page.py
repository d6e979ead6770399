"""The study's page: one HTML file that loads nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
from markupsafe import Markup

from cosim.report.provenance import versions
from cosim.study.choice.selection import Selected
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.report.colors import build_colors
from cosim.study.report.corner import dominant_corner
from cosim.study.report.packed import packed, shown_columns
from cosim.study.report.sheet import Column, Sheet
from cosim.study.report.summary import MATTERS, extremes, fixed, headline, shares, tiles
from eightpost.page import insert, plotly, template
from eightpost.signals import TimeSeries

_PACKAGE = "cosim.study.report"

#: Parts of the page's script, in the order of their dependencies.
_SCRIPTS = ("store", "state", "table", "dots", "plots", "setup", "sensitivity", "page")

#: Number of trade-offs that are drawn when the page opens.
_TRADES = 6

#: Number of columns of the ranking when the page opens, including the objective; the others can be added.
_TABLED = 7

#: Largest number of setups in the list of failed and marked setups; the ranking contains all of them.
_LISTED = 200


@dataclass(frozen=True, slots=True, eq=False)
class Extras:
    """Optional content of a report.

    Args:
        traces: Time traces by setup number.
        sensitivities: Sensitivities of all or some measures.
        selection: Setups to confirm on the rig.
    """

    traces: Mapping[int, TimeSeries] = field(default_factory=dict)
    sensitivities: Sequence[Sensitivity] = ()
    selection: Sequence[Selected] = ()


def page(sheet: Sheet, extras: Extras) -> str:
    """Return the page's HTML; names of measures, builds and files are escaped."""
    groups = _groups(sheet, extras.selection)
    picked = sorted({row for _, rows in groups for row in rows})
    manifest, numbers = packed(sheet, extras.traces, extras.sensitivities, picked)
    return template(_PACKAGE, {"fixed": fixed}).render(
        _words(sheet)
        | _choices(sheet)
        | _effects(sheet, extras.sensitivities)
        | {
            "sheet": sheet,
            "background": sheet.background,
            "groups": groups,
            "ranks": np.argsort(sheet.order) + 1,
            "selection_columns": _selected_for(sheet, extras.selection),
            "traced": sorted(extras.traces),
            "manifest": manifest,
            "numbers": numbers,
            "plotly": plotly(),
            "style": insert(_PACKAGE, "page.css"),
            "script": Markup("\n").join(insert(_PACKAGE, f"script/{name}.js") for name in _SCRIPTS),
        }
    )


def _words(sheet: Sheet) -> dict[str, Any]:
    problems = sorted(sheet.failures.items()) + sorted(sheet.marks.items())
    return {
        "verdict": sheet.background.verdict,
        "headline": headline(sheet),
        "tiles": tiles(sheet),
        "problems": problems[:_LISTED],
        "more_problems": max(0, len(problems) - _LISTED),
        "versions": versions(),
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _choices(sheet: Sheet) -> dict[str, Any]:
    """Return the choices of the page and their initial state: the first measure, against those that follow."""
    columns = shown_columns(sheet)
    first, *others = (columns.index(column) for column in sheet.measures)
    return {
        "columns": columns,
        "colors": build_colors(len(sheet.builds)),
        "present": [set(column.tolist()) for column in sheet.placed.T],
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
