"""HTML page of a study, and its data, packed for its script."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.report.page import versions
from cosim.study.answer import answer_of, chance, corner_choices, sought, tied
from cosim.study.choice.certainty import Certainty
from cosim.study.choice.selection import Selected, Selection
from cosim.study.choice.sensitivity import Sensitivity, available_sensitivities
from cosim.study.sheet import (
    AimPage,
    Column,
    Extras,
    Scale,
    Sheet,
    ShockCurve,
    Uncertainty,
    build_colors,
    sheet_of,
    shown_columns,
)
from cosim.study.table import StudyResult
from cosim.study.tables import write_ranking, write_traces, write_workbook
from eightpost.array_types import Array, Integers
from eightpost.report import page as html
from eightpost.report.packing import TRACES_CAPACITY, Store, spectra, traces
from eightpost.report.page import write_page
from eightpost.signals import TimeSeries

# ---- Data of the page's script --------------------------------------------------------------------------------------

#: Highest frequency of the spectra of the page [Hz].
_HIGHEST = 60.0


def packed(sheet: Sheet, extras: Extras, picked: Sequence[int]) -> tuple[dict[str, Any], str]:
    """Return the manifest, which states where each number is stored, and the numbers."""
    store, known = Store(), sheet.certainty
    order, done = sheet.order, int(sheet.done.sum())
    place = {column.name: k for k, column in enumerate(shown_columns(sheet))}
    manifest = {
        "setups": sheet.numbers.size,
        "done": done,
        "corners": sheet.corners,
        "builds": sheet.builds,
        "colors": build_colors(len(sheet.builds)),
        "numbers": store.add(sheet.numbers.astype(float)),
        "placed": [store.add(column) for column in sheet.placed.T.astype(float)],
        "rank": store.add(np.argsort(order).astype(float) + 1.0),
        "allowed": store.add(sheet.allowed.astype(float)),
        "error": store.add(sheet.coupling_error),
        "chance": None
        if known is None or known.leader is None
        else {"name": chance(known), "at": store.add(known.best)},
        "ties": tied(sheet),
        "columns": [_column(store, column) for column in shown_columns(sheet)],
        "objective": sheet.objective.name if sheet.objective else None,
        "terms": [{"column": place[one.measure], "weight": one.weight} | asdict(one.display) for one in sheet.terms],
        "bounds": [{"column": place[name]} | ends for name, ends in _limits(sheet).items()],
        "failures": sheet.failures,
        "marks": sheet.marks,
        "baseline": sheet.baseline,
        "best": int(order[0]) if done else None,
        "picked": list(picked),
        "traces": dict(_traces(store, extras.traces)),
        "trace_command": sheet.background.trace_command,
        "sensitivities": list(_sensitivities(sheet, extras.sensitivities)),
        "spectra": dict(_spectra(store, extras.traces)),
        "curves": {
            name: {"velocity": store.add(one.velocity), "force": store.add(one.force), "count": one.velocity.size}
            for name, one in extras.curves.items()
        },
        "force": _scale(Scale.of("N")),
        "velocity": _scale(Scale.of("m/s")),
        "pages": extras.shock_pages,
    }
    return manifest, store.text


def _limits(sheet: Sheet) -> dict[str, dict[str, float | None]]:
    """Return the limits of the constraints by measure [SI]; None where there is no limit."""
    limits: dict[str, dict[str, float | None]] = {}
    for bound in sheet.background.constraints:
        ends = limits.setdefault(bound.measure, {"low": None, "high": None})
        ends["low" if bound.word == "at least" else "high"] = bound.value
    return limits


def _scale(scale: Scale) -> dict[str, Any]:
    return {"us": asdict(scale.us), "metric": asdict(scale.metric)}


def _column(store: Store, column: Column) -> dict[str, Any]:
    low, high = column.extremes
    return {
        "name": column.name,
        **_scale(column.scale),
        "low": low,
        "high": high,
        "better": column.better,
        "at": store.add(column.values),
        "uncertainty": column.uncertainty and _uncertainty(store, column.uncertainty),
    }


def _uncertainty(store: Store, uncertainty: Uncertainty) -> dict[str, Any]:
    return {
        "low": store.add(uncertainty.low),
        "high": store.add(uncertainty.high),
        "best": store.add(uncertainty.best),
        "tied": store.add(uncertainty.tied.astype(float)),
        "ties": int(uncertainty.tied.sum()),
    }


def _traces(store: Store, recorded: Mapping[int, TimeSeries]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield traces by setup number; each setup gets an equal share of the page's capacity."""
    for number, series in recorded.items():
        kept = traces(series, capacity=TRACES_CAPACITY // len(recorded))
        channels = [
            _channel(store, name, unit, values)
            for name, unit, values in zip(series.names, series.units, kept.values, strict=True)
        ]
        yield (
            number,
            {
                "at": store.add(kept.time),
                "count": kept.time.size,
                "from": float(kept.time[0]),
                "to": float(kept.time[-1]),
                "samples": kept.samples,
                "interval": kept.interval,
                "channels": channels,
            },
        )


def _spectra(store: Store, recorded: Mapping[int, TimeSeries]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the amplitude spectral densities of the traces by setup number, up to the highest frequency of interest."""
    for number, series in recorded.items():
        found = spectra(series)
        if found is None:
            continue
        kept = found.frequency <= _HIGHEST
        channels = [
            {"name": name, **_scale(Scale.of(unit)), "at": store.add_single(np.sqrt(density[kept]))}
            for name, unit, density in zip(series.names, series.units, found.density, strict=True)
        ]
        yield number, {"at": store.add_single(found.frequency[kept]), "count": int(kept.sum()), "channels": channels}


def _channel(store: Store, name: str, unit: str, values: Array) -> dict[str, Any]:
    return {
        "name": name,
        "quantity": name.rpartition(".")[2].replace("_", " "),
        **_scale(Scale.of(unit)),
        "low": float(values.min()),
        "high": float(values.max()),
        "at": store.add_levels(values),
    }


def _sensitivities(sheet: Sheet, terms: Sequence[Sensitivity]) -> Iterator[dict[str, Any]]:
    places = {column.name: k for k, column in enumerate(shown_columns(sheet))}
    for one in terms:
        if one.measure not in places:
            continue
        yield {
            "column": places[one.measure],
            "factors": [
                {"name": factor.name, "builds": factor.builds, "effect": one.main[factor.name].tolist()}
                for factor in one.factors
            ],
            "pairs": [
                {"names": pair, "effect": effect.tolist(), "share": one.share(*pair)}
                for pair, effect in one.pairs.items()
            ],
        }


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


# ---- Tables of extremes and sensitivities ---------------------------------------------------------------------------

#: Share of a measure's variance [1] above which a corner is highlighted.
MATTERS = 0.05


class Share(NamedTuple):
    """Shares of a measure's variance [1]: of each corner with its interactions, and of all interactions of two."""

    column: int
    name: str
    totals: tuple[float, ...]
    interactions: float
    method: str


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

#: Number of findings of the verdict that are shown at once: the answer says what must be done.
_FOLDED = 0

#: Largest number of setups in the list of failed and marked setups; the ranking contains all of them.
_LISTED = 200


def page(sheet: Sheet, extras: Extras) -> str:
    """Return the page's HTML; names of measures, builds and files are escaped."""
    groups = _groups(sheet, extras.selection)
    picked = sorted({row for _, rows in groups for row in rows})
    manifest, numbers = packed(sheet, extras, picked)
    problems = sorted(sheet.failures.items()) + sorted(sheet.marks.items())
    answer = answer_of(sheet)
    context = _choices(sheet) | _effects(sheet, extras.sensitivities)
    return html.page(
        "cosim.study",
        [f"script/{name}.js" for name in _SCRIPTS],
        **context,
        verdict=sheet.background.verdict,
        fold=_FOLDED,
        problems=problems[:_LISTED],
        more_problems=max(0, len(problems) - _LISTED),
        versions=versions(),
        title=sheet.background.title,
        places=_places(sheet, groups),
        sheet=sheet,
        background=sheet.background,
        answer=answer,
        choices=corner_choices(sheet, answer.row, extras.curves) if answer else [],
        chance=chance(sheet.certainty) if sheet.certainty else "",
        sought=sought(sheet),
        groups=groups,
        shock_pages=extras.shock_pages,
        aim=extras.aim,
        links={extras.aim.path: "Curves to aim at"} if extras.aim else {},
        ranks=np.argsort(sheet.order) + 1,
        selection_columns=[one for one in sheet.measures if one.name in {s.measure for s in extras.selection}],
        traced=sorted(extras.traces),
        data={"manifest": manifest, "numbers": numbers},
    )


def _places(sheet: Sheet, groups: Sequence[Any]) -> Iterator[tuple[str, str]]:
    yield from (("table", "Ranking"), ("levels", "Levels"), ("tradeoffs", "Trade-offs"), ("parallel", "Measures"))
    yield from (("setup", "Setup"), ("comparison", "Side by side"), ("sensitivity", "Sensitivity"))
    if groups:
        yield "selected", "Selected"
    if sheet.failures or sheet.marks:
        yield "doubtful", "Failed, marked"
    yield "provenance", "Provenance"


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


# ---- Files of a study's report --------------------------------------------------------------------------------------


def write_study_report(
    result: StudyResult,
    out_dir: str | Path,
    *,
    traces: Mapping[int, TimeSeries] | None = None,
    selection: Selection | None = None,
    certainty: Certainty | None = None,
    curves: Mapping[str, ShockCurve] | None = None,
    shock_pages: Mapping[str, str] | None = None,
    aim: AimPage | None = None,
    trace_command: str = "",
) -> Path:
    """Write all files of a study's report without running a simulation: its page, which is returned, and tables.

    Args:
        out_dir: Output folder; existing files of the same names are replaced, each after the new file is complete.
        shock_pages: Pages of the shocks relative to the folder, by build.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    sheet, folder = sheet_of(result, certainty=certainty, trace_command=trace_command), Path(out_dir)
    chosen = selection.chosen if selection else ()
    extras = Extras(traces or {}, available_sensitivities(result), chosen, curves or {}, shock_pages or {}, aim)
    write_workbook(sheet, folder / "ranking.xlsx")
    write_ranking(sheet, folder / "ranking.csv")
    for number, series in extras.traces.items():
        if sheet.row(number) in (sheet.order[0], sheet.baseline):
            write_traces(sheet, number, series, folder / "traces" / f"setup_{number}.csv")
    return write_page(folder / "report.html", page(sheet, extras))
