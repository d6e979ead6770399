"""Console tables of fits: misfit by law, parameters."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from eightpost.ident.shock.result import ShockFit, interval_of
from eightpost.ident.shock.verdict import Parameter, in_field_units
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.shock import law_title
from eightpost.units import convert


def fit_table(fits: Sequence[ShockFit]) -> Table:
    """Return a table of fits like Table 3.4; the reduction is relative to Polylinear of the same shock, if fitted."""
    static = {fit.shock.name: fit.rms for fit in fits if fit.shock.law_name == "polylinear"}
    columns = right("RMS, lbf", "RMS, N", "% of std", "% less than static", "time, s")
    rows = [
        (
            fit.shock.name,
            law_title(fit.shock.law_name),
            *(f"{rms:.2f}" for rms in (convert(fit.rms, "N", "lbf"), fit.rms, fit.percent)),
            _reduction(fit, static.get(fit.shock.name)),
            f"{fit.seconds:.2f}",
        )
        for fit in fits
    ]
    return console_table(["shock", *unbroken("law"), *columns], rows, title="Fits")


def parameter_table(fit: ShockFit) -> Table:
    """Return the parameters of a fit: value, 95 % interval and bounds in SI and in field units."""
    columns = [*unbroken("parameter"), *right("value", "95 % interval", "SI", "bounds"), "at bound"]
    title = f"{fit.shock.name}, {law_title(fit.shock.law_name)}: parameters"
    return console_table(columns, map(_parameter_row, fit.parameters), title=title)


def _parameter_row(parameter: Parameter) -> tuple[str, ...]:
    value, unit = in_field_units(parameter.value, parameter.unit)
    si = f"{parameter.value:.4g} {parameter.unit}"
    return (
        parameter.name,
        f"{value:.4g} {unit}",
        _interval(parameter),
        si,
        _bounds(parameter),
        parameter.at_bound or "-",
    )


def _reduction(fit: ShockFit, static: float | None) -> str:
    if static is None or fit.shock.law_name == "polylinear":
        return "-"
    return f"{100.0 * (1.0 - fit.rms / static):.1f}"


def _interval(parameter: Parameter) -> str:
    if (interval := interval_of(parameter)) is None:
        return "-" if parameter.at_bound else "not determined"
    (low, _), (high, unit) = (in_field_units(end, parameter.unit) for end in interval)
    return f"{low:.4g} to {high:.4g} {unit}"


def _bounds(parameter: Parameter) -> str:
    if parameter.bounds is None:
        return "-"
    (low, unit), (high, _) = (in_field_units(bound, parameter.unit) for bound in parameter.bounds)
    return f"{low:.4g} to {high:.4g} {unit}" if isfinite(high) else f"{low:.4g} or more"
