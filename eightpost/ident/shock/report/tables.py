"""Tables of fits for the console: one like Table 3.4, and the parameters of each fit."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from rich.table import Table

from eightpost.ident.shock.report.findings import in_field_units
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.ident.shock.report.parameters import Parameter
    from eightpost.ident.shock.report.result import ShockFit


def law_title(name: str) -> str:
    """Return the display name of a law: LPF1, LPNL2, Polylinear, Maxwell."""
    return name.upper() if any(letter.isdigit() for letter in name) else name.capitalize()


def fit_table(fits: Sequence[ShockFit]) -> Table:
    """Return a table of fits like Table 3.4; the reduction is relative to Polylinear of the same shock, if fitted."""
    table = Table("shock", title="Fits")
    table.add_column("law", no_wrap=True)
    for title in ("RMS, lbf", "RMS, N", "% of std", "% less than static", "time, s"):
        table.add_column(title, justify="right")
    static = {fit.shock.name: fit.rms for fit in fits if fit.shock.law_name == "polylinear"}
    for fit in fits:
        table.add_row(
            fit.shock.name,
            law_title(fit.shock.law_name),
            f"{convert(fit.rms, 'N', 'lbf'):.2f}",
            f"{fit.rms:.2f}",
            f"{fit.percent:.2f}",
            _reduction(fit, static.get(fit.shock.name)),
            f"{fit.seconds:.2f}",
        )
    return table


def parameter_table(fit: ShockFit) -> Table:
    """Return the parameters of a fit: value, 95 % interval and bounds in SI and in field units."""
    table = Table(title=f"{fit.shock.name}, {law_title(fit.shock.law_name)}: parameters")
    table.add_column("parameter", no_wrap=True)
    for title in ("value", "95 % interval", "SI", "bounds"):
        table.add_column(title, justify="right")
    table.add_column("at bound")
    for parameter in fit.parameters:
        value, unit = in_field_units(parameter.value, parameter.unit)
        table.add_row(
            parameter.name,
            f"{value:.4g} {unit}",
            _interval(parameter),
            f"{parameter.value:.4g} {parameter.unit}",
            _bounds(parameter),
            parameter.at_bound or "-",
        )
    return table


def _reduction(fit: ShockFit, static: float | None) -> str:
    if static is None or fit.shock.law_name == "polylinear":
        return "-"
    return f"{100.0 * (1.0 - fit.rms / static):.1f}"


def _interval(parameter: Parameter) -> str:
    if parameter.interval is None:
        return "not determined"
    (low, _), (high, unit) = (in_field_units(end, parameter.unit) for end in parameter.interval)
    return f"{low:.4g} to {high:.4g} {unit}"


def _bounds(parameter: Parameter) -> str:
    if parameter.bounds is None:
        return "-"
    (low, unit), (high, _) = (in_field_units(bound, parameter.unit) for bound in parameter.bounds)
    return f"{low:.4g} to {high:.4g} {unit}" if isfinite(high) else f"{low:.4g} or more"
