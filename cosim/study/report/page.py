"""The study's page: one file that loads nothing."""

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
from cosim.study.report.corner import telling_corner
from cosim.study.report.packed import packed, shown_columns
from cosim.study.report.sheet import Column, Sheet
from cosim.study.report.summary import MATTERS, extremes, fixed, headline, shares, tiles
from eightpost.page import insert, plotly, template
from eightpost.signals import TimeSeries

_PACKAGE = "cosim.study.report"

#: The page's script, in the order in which its parts need each other.
_SCRIPTS = ("store", "state", "table", "dots", "plots", "setup", "sensitivity", "page")

#: Trade-offs that are drawn at first.
_TRADES = 6

#: Columns of the ranking at first, the objective among them; the others can be had.
_TABLED = 7

#: Failed and marked setups that are listed on their own; the table has them all.
_DOUBTFUL = 200


@dataclass(frozen=True, slots=True, eq=False)
class Extras:
    """What a report shows where it is given.

    Args:
        traces: Time traces by the setup's number.
        sensitivities: Of the measures, or of some.
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
    doubtful = sorted(sheet.failures.items()) + sorted(sheet.marks.items())
    return {
        "verdict": sheet.background.verdict,
        "headline": headline(sheet),
        "tiles": tiles(sheet),
        "doubtful": doubtful[:_DOUBTFUL],
        "more_doubtful": max(0, len(doubtful) - _DOUBTFUL),
        "versions": versions(),
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _choices(sheet: Sheet) -> dict[str, Any]:
    """Return what may be chosen, and what is chosen at first: what the study is about, against what follows."""
    columns = shown_columns(sheet)
    first, *others = (columns.index(column) for column in sheet.measures)
    return {
        "columns": columns,
        "colors": build_colors(len(sheet.builds)),
        "present": [set(column.tolist()) for column in sheet.placed.T],
        "focus": first,
        "tabled": set(range(_TABLED)),
        "against": {first, *others[:_TRADES]},
        "colored": telling_corner(sheet, columns[first]),
        "spreads": any(column.doubt is not None for column in columns),
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
    """Return the rows of the selected setups by what they were selected for."""
    groups: dict[str, list[int]] = {}
    for selected in selection:
        if (row := sheet.row(selected.setup.index)) is not None:
            groups.setdefault(f"{selected.measure}: {selected.end}", []).append(row)
    return list(groups.items())


def _selected_for(sheet: Sheet, selection: Sequence[Selected]) -> list[Column]:
    named = {selected.measure for selected in selection}
    return [column for column in sheet.measures if column.name in named]
