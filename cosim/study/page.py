"""Page and tables of a study: HTML with traces, CSV files in the layout of data-logging tools, and a workbook."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cosim.report.page import versions
from cosim.study.answer import answer_of, chance, corner_choices, sought, tied
from cosim.study.choice.rig_day import Selected
from cosim.study.choice.sensitivity import Sensitivity
from cosim.study.sheet import Column, Extras, Scale, Sheet, Uncertainty, build_colors, shown_columns
from eightpost.array_types import Array, Integers
from eightpost.errors import OutputError
from eightpost.extras import needs
from eightpost.files import atomic_path, safe_cell
from eightpost.report import page as html
from eightpost.report.page import TRACES_CAPACITY, Store, spectra, traces, write_page
from eightpost.signals import TimeSeries

with needs("report", "writing workbooks"):
    import xlsxwriter
    import xlsxwriter.exceptions

# ---- CSV tables in the layout of data-logging tools -----------------------------------------------------------------

Cell = str | int | float


def write_ranking(sheet: Sheet, path: Path) -> Path:
    """Write all setups, best first, in the display units of the measures; failed setups have empty cells."""
    columns = shown_columns(sheet)
    names = ["rank", "setup", *sheet.corners, *(column.name for column in columns), "coupling error", "remark"]
    units = ["", "", *("" for _ in sheet.corners), *(column.scale.us.unit for column in columns), "%", ""]
    source = sheet.background
    settings = [
        ("Format", "eightpost setup study"),
        ("Study", source.title),
        ("Ranked by", source.objective or sheet.ranked_by.name),
        ("Constraints", "; ".join(map(str, source.constraints)) or "none"),
        *source.facts,
    ]
    return _write(path, settings, names, units, map(_safe, _ranking_rows(sheet)))


#: Number of rows of the ranking that are in memory.
_ROWS = 2048


def _ranking_rows(sheet: Sheet) -> Iterator[Sequence[Cell]]:
    """Yield one row per setup, best first: rank, number, builds, values in display units, coupling error, remark."""
    order, done = sheet.order, sheet.done
    for first in range(0, order.size, _ROWS):
        rows = order[first : first + _ROWS]
        places = np.arange(first + 1, first + rows.size + 1)
        yield from zip(
            [place if ran else "" for place, ran in zip(places.tolist(), done[rows].tolist(), strict=True)],
            sheet.numbers[rows].tolist(),
            *([sheet.builds[build] for build in corner] for corner in sheet.placed[rows].T.tolist()),
            *(_cells(column.scale.us(column.values[rows])) for column in shown_columns(sheet)),
            _cells(sheet.coupling_error[rows]),
            map(sheet.remark, rows.tolist()),
            strict=True,
        )


def write_traces(sheet: Sheet, number: int, series: TimeSeries, path: Path) -> Path:
    """Write the traces of one setup in SI, in the layout of MoTeC i2's CSV export."""
    row = sheet.row(number)
    settings = [
        ("Format", "MoTeC CSV File"),
        ("Vehicle", sheet.background.title),
        ("Comment", f"setup {number}" + ("" if row is None else f": {sheet.fitted(row)}")),
        ("Sample Rate", f"{series.sample_rate:.9g}", "Hz"),
        ("Duration", f"{series.duration:.9g}", "s"),
    ]
    rows = np.column_stack([series.time, series.values.T]).tolist()
    return _write(path, settings, ["Time", *series.names], ["s", *series.units], rows)


def _cells(values: Array) -> list[Cell]:
    return [value if isfinite(value) else "" for value in values.tolist()]


def _write(
    path: Path,
    settings: Iterable[Sequence[str]],
    names: Sequence[str],
    units: Sequence[str],
    rows: Iterable[Sequence[Cell]],
) -> Path:
    """Write text in quotes and numbers without; lines end with CR LF (RFC 4180)."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, quoting=csv.QUOTE_NONNUMERIC)
        writer.writerows(_safe(row) for row in (*settings, (), names, units))
        writer.writerows(rows)
    return path


def _safe(row: Sequence[Cell]) -> list[Cell]:
    return [safe_cell(cell) if isinstance(cell, str) else cell for cell in row]


# ---- Workbook of the ranking, with sheets for the ranking, the units and the provenance -----------------------------


#: Largest number of setups in the workbook; the CSV file has all of them.
MOST_ROWS = 20_000


def write_workbook(sheet: Sheet, path: Path) -> Path:
    """Write the workbook; text is never interpreted as a formula.

    Raises:
        OutputError: The file cannot be written.
    """
    # Rows are written to disk at once, so that the memory does not grow with their number.
    options = {"strings_to_formulas": False, "strings_to_urls": False, "constant_memory": True}
    try:
        with atomic_path(path) as temporary, xlsxwriter.Workbook(temporary, options) as workbook:
            _ranking(workbook, sheet)
            _units(workbook, sheet)
            _provenance(workbook, sheet)
    except xlsxwriter.exceptions.XlsxWriterException as error:  # wraps the operating system's error
        raise OutputError(f"{path}: cannot be written ({error}); free disk space, or choose another folder") from error
    return path


def _ranking(workbook: Any, sheet: Sheet) -> None:
    """Write one row per setup below a frozen header row, with filters and shading by level (white: the minimum)."""
    columns, count = shown_columns(sheet), min(sheet.numbers.size, MOST_ROWS)
    heads = [f"{column.name} [{column.scale.us.unit}]" for column in columns]
    names = ["rank", "setup", *(corner.upper() for corner in sheet.corners), *heads, "coupling error [%]", "remark"]
    page = workbook.add_worksheet("Ranking")
    first = 2 + len(sheet.corners)
    digits = {k: _digits(column.scale.us(column.extremes[1])) for k, column in enumerate(columns, start=first)}
    _table(workbook, page, names, islice(_ranking_rows(sheet), count), digits)
    for k in digits:
        shades = {"type": "2_color_scale", "min_color": "#FFFFFF", "max_color": "#9CC3E6"}
        page.conditional_format(1, k, max(1, count), k, shades)
    page.freeze_panes(1, first)
    page.autofilter(0, 0, max(1, count), len(names) - 1)
    page.set_column(len(names) - 1, len(names) - 1, 40)


def _digits(value: float) -> str:
    """Return the number format that shows about four digits of values of this size."""
    size = abs(value)
    return "0" if size >= 1000.0 else "0.0" if size >= 100.0 else "0.00" if size >= 10.0 else "0.0000"


def _units(workbook: Any, sheet: Sheet) -> None:
    heads = ["measure", "unit here", "SI unit", "here = factor * SI + offset: factor", "offset", "least", "greatest"]
    rows: list[list[Cell]] = []
    for column in shown_columns(sheet):
        us, (least, greatest) = column.scale.us, column.extremes
        rows.append([column.name, us.unit, us.si, us.factor, us.offset, us(least), us(greatest)])
    _table(workbook, workbook.add_worksheet("Units"), heads, rows)


def _provenance(workbook: Any, sheet: Sheet) -> None:
    source = sheet.background
    words = [("Study", source.title), ("Objective", source.objective or "none"), *source.facts]
    words += [("Constraint", str(bound)) for bound in source.constraints] + [("Note", text) for text in source.notes]
    if sheet.numbers.size > MOST_ROWS:
        text = f"the ranking has the best {MOST_ROWS} of {sheet.numbers.size} setups; all of them are in ranking.csv"
        words.append(("Note", text))
    files = [(o.name, o.file, o.identity, o.digest, ", ".join(o.parameters)) for o in source.origins]
    page = workbook.add_worksheet("Provenance")
    _table(workbook, page, ["what", "value or file", "GUID", "SHA-256", "parameters set"], [*words, *files])
    page.set_column(1, 1, 60)
    page.set_column(2, 3, 68)


def _table(
    workbook: Any,
    page: Any,
    heads: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    digits: Mapping[int, str] = MappingProxyType({}),
) -> None:
    """Write a table; `digits` has number formats by column, which must be known before the rows are written."""
    bold = workbook.add_format({"bold": True, "text_wrap": True, "valign": "top", "bottom": 1})
    page.write_row(0, 0, heads, bold)
    page.set_column(0, len(heads) - 1, 14)
    for k, form in digits.items():
        page.set_column(k, k, 14, workbook.add_format({"num_format": form}))
    for k, row in enumerate(rows, start=1):
        for column, cell in enumerate(row):
            if cell != "":
                write = page.write_string if isinstance(cell, str) else page.write_number
                write(k, column, cell)


# ==== Page ===========================================================================================================

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


def write_study_report(sheet: Sheet, extras: Extras, out_dir: str | Path) -> Path:
    """Write all files of a study's report without running a simulation: its page, which is returned, and tables.

    Args:
        out_dir: Output folder; existing files of the same names are replaced, each after the new file is complete.
    """
    folder = Path(out_dir)
    write_workbook(sheet, folder / "ranking.xlsx")
    write_ranking(sheet, folder / "ranking.csv")
    for number, series in extras.traces.items():
        if sheet.row(number) in (sheet.order[0], sheet.baseline):
            write_traces(sheet, number, series, folder / "traces" / f"setup_{number}.csv")
    return write_page(folder / "report.html", page(sheet, extras))
