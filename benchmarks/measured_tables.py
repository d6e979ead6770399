"""Errors on measured records as Markdown tables: a line for each held-out run, a column for each law."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from benchmarks.shock_records import BOUC_WEN, LAWS
from benchmarks.shock_rows import FailedFit, FitErrors, Result
from benchmarks.shock_tables import grid
from benchmarks.table import number
from eightpost.ident.shock.plots import law_title

_COLUMNS = (*LAWS, BOUC_WEN)


def held_out_table(found: Sequence[Result]) -> str:
    """Return the errors on the held-out runs, the smallest of each line in bold, and the mean of LPNL2's error."""
    return _table(found, lambda one: one.validation_percent, "mean of LPNL2's error [%]", _mean)


def fit_errors_table(found: Sequence[Result]) -> str:
    """Return the errors on the fitted runs."""
    return _table(found, lambda one: one.fit_percent, "", None)


def lag_table(found: Sequence[Result]) -> str:
    """Return the parameters of the laws with lag; parameters at a bound are marked."""
    heads = ("fitted", "LPF1: lag [ms]", "LPNL2: lag [ms]", "alpha = 1 up to [N]", "0 from [N]")
    lines: dict[str, list[str]] = {}
    for record, by_law in _by_record(found).items():
        fitted = record.partition(", held out")[0]
        cells = [
            _parameter(by_law.get("lpf1"), "time_constant", 1e3),
            _parameter(by_law.get("lpnl2"), "time_constant", 1e3),
            _parameter(by_law.get("lpnl2"), "lag_full_force", 1.0),
            _parameter(by_law.get("lpnl2"), "lag_zero_force", 1.0),
        ]
        lines.setdefault(fitted, [fitted, *cells])
    return grid(heads, list(lines.values()))


def _table(
    found: Sequence[Result],
    figure: Callable[[FitErrors], float],
    last: str,
    more: Callable[[dict[str, Result]], str] | None,
) -> str:
    heads = ["fitted, held out", *(_title(law) for law in _COLUMNS), *([last] if more else [])]
    lines = []
    for record, by_law in _by_record(found).items():
        figures = {law: figure(one) for law, one in by_law.items() if isinstance(one, FitErrors)}
        smallest = min(figures.values())
        cells = [_cell(figures.get(law), smallest) for law in _COLUMNS]
        lines.append([record, *cells, *([more(by_law)] if more else [])])
    return grid(heads, lines)


def _title(law: str) -> str:
    return "Bouc-Wen" if law == BOUC_WEN else law_title(law)


def _by_record(found: Sequence[Result]) -> dict[str, dict[str, Result]]:
    by_record: dict[str, dict[str, Result]] = {}
    for one in found:
        if one.case.about_mean:
            by_record.setdefault(one.case.record, {})[one.law] = one
    return by_record


def _cell(value: float | None, smallest: float) -> str:
    if value is None:
        return "refused"
    return f"**{number(value)}**" if value == smallest else number(value)


def _mean(by_law: dict[str, Result]) -> str:
    one = by_law.get("lpnl2")
    return number(100.0 * one.offset / one.deviation) if isinstance(one, FitErrors) else "-"


def _parameter(one: Result | None, name: str, factor: float) -> str:
    if one is None or isinstance(one, FailedFit):
        return "-"
    return f"{number(factor * one.parameters[name])}{' (bound)' if name in one.at_bound else ''}"
