"""Tables and plots of a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.curve import curve_forces
from eightpost.ident.shock.law_choice import LawChoice, LawScore
from eightpost.ident.shock.result import ShockFit
from eightpost.ident.shock.verdict import Parameter, in_field_units
from eightpost.report.console import Table, console_table, right, unbroken
from eightpost.report.pictures import Axes, Figure, new_figure, panels_of, save
from eightpost.rig.peak_velocity import PeakVelocityTable
from eightpost.shock import Shock, StaticCurve, law_title
from eightpost.units import convert

# ---- Tables of fits for the console ---------------------------------------------------------------------------------


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


_QUARTERS = "quarters of the record"


def choice_table(choice: LawChoice) -> Table:
    """Return the comparison of the laws: held-out error with its standard error, error of the fit, size and cost."""
    columns = right("held out, % of std", "std error", "fit, % of std", "parameters", "cost, x Polylinear")
    whole = {"builds": "builds, all runs of each,", "runs": "runs,"}
    what = f"whole {whole[choice.left_out]} without their level" if choice.left_out in whole else _QUARTERS
    rows = [_choice_row(score, choice) for score in choice.scores]
    title = f"Choice of the law: errors on left-out {what}"
    return console_table([*unbroken("law"), *unbroken("curve"), *columns, "note"], rows, title=title)


def _choice_row(score: LawScore, choice: LawChoice) -> tuple[str, ...]:
    cost = "-" if score.step_cost is None else f"{score.step_cost:.2g}"
    notes = [*(["chosen"] if score.law == choice.law else []), *([score.trouble] if score.trouble else [])]
    curve = "-" if score.curve is None else score.curve.kind
    if score.blocks is None:
        fitted = (f"{score.fit_percent:.3g}", str(score.parameters)) if score.parameters else ("-", "-")
        return law_title(score.law), curve, "-", "-", *fitted, cost, ", ".join(notes)
    held = score.held_out
    figures = (f"{held.percent:.3g}", f"{held.spread:.2g}", f"{score.fit_percent:.3g}", str(score.parameters))
    return law_title(score.law), curve, *figures, cost, ", ".join(notes)


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
    if parameter.interval is None:
        return "not determined"
    (low, _), (high, unit) = (in_field_units(end, parameter.unit) for end in parameter.interval)
    return f"{low:.4g} to {high:.4g} {unit}"


def _bounds(parameter: Parameter) -> str:
    if parameter.bounds is None:
        return "-"
    (low, unit), (high, _) = (in_field_units(bound, parameter.unit) for bound in parameter.bounds)
    return f"{low:.4g} to {high:.4g} {unit}" if isfinite(high) else f"{low:.4g} or more"


# ---- Plots of force over velocity, measured and fitted (Fig 3.14) ---------------------------------------------------

_INCH, _POUND = convert(1.0, "m/s", "in/s"), convert(1.0, "N", "lbf")

#: Number of samples shown as dots, and duration of the model's loop [s]; more would only fill the page.
_DOTS, _LOOP = 6000, 1.0


def plot_force_velocity(fits: ShockFit | tuple[ShockFit, ...] | list[ShockFit], path: str | Path) -> None:
    """Write a PNG of force over velocity without the gas force: measured dots, model loop, static curve.

    Args:
        fits: One fit, or several of one record, with a panel each.
        path: File to write; an existing file is replaced only when the new one is complete.
    """
    save(force_velocity(list(fits) if isinstance(fits, (tuple, list)) else [fits]), path, format="png")


def force_velocity(fits: Sequence[ShockFit]) -> Figure:
    """Return the figure of `plot_force_velocity`."""
    figure = new_figure(7.2 * len(fits), 6.4)
    for axes, fit in zip(panels_of(figure, len(fits), len(fits), sharex=True, sharey=True), fits, strict=True):
        _panel(axes, fit)
    return figure


def plot_peak_velocity(found: Sequence[tuple[PeakVelocityTable, Shock]], path: str | Path) -> None:
    """Write a PNG of peak-velocity tables and the curves through them, with a colour for each setting of the adjusters.

    Args:
        found: Tables and the shocks made of them.
        path: File to write; an existing file is replaced only when the new one is complete.
    """
    figure = new_figure(7.2, 6.4)
    axes = figure.subplots()
    for table, shock in found:
        (line,) = axes.plot(*_static_curve(shock.law.curve), linewidth=1.5, label=table.clicks or shock.name)
        speed = np.concatenate([-table.speed, table.speed])
        force = np.concatenate([table.rebound, table.compression])
        axes.plot(_INCH * speed, _POUND * force, "o", color=line.get_color(), markersize=4.0)
    axes.set_title("points of the table and curves through them", pad=34)
    _decorate(axes)
    save(figure, path, format="png")


def _panel(axes: Axes, fit: ShockFit) -> None:
    velocity, gas = _INCH * fit.measured["velocity"], fit.predicted["gas_force"]
    dots = slice(None, None, max(velocity.size // _DOTS, 1))
    loop = _liveliest(fit.measured.time, velocity)
    measured, predicted = (_POUND * (series["force"] - gas) for series in (fit.measured, fit.predicted))
    axes.plot(velocity[dots], measured[dots], ".", color="0.6", markersize=2.0, label="measured")
    axes.plot(velocity[loop], predicted[loop], color="tab:blue", linewidth=0.9, label=f"model, {_LOOP:g} s")
    axes.plot(*_static_curve(fit.shock.law.curve), color="tab:red", linewidth=1.8, label="static curve")
    band = fit.band
    low, high = (_POUND * (band.force + sign * band.half_width) for sign in (-1.0, 1.0))
    axes.fill_between(_INCH * band.velocity, low, high, color="tab:red", alpha=0.3, linewidth=0, label="95 % band")
    law = law_title(fit.shock.law_name)
    axes.set_title(f"{fit.shock.name}: {law}, RMS {_POUND * fit.rms:.2f} lbf, {fit.percent:.2f} % of std", pad=34)
    _decorate(axes)


def _liveliest(time: Array, velocity: Array) -> NDArray[np.bool_]:
    """Return which samples (N,) are in the second around the highest speed."""
    middle = float(time[np.argmax(np.abs(velocity))])
    start = min(max(middle - 0.5 * _LOOP, time[0]), max(time[-1] - _LOOP, time[0]))
    return np.asarray((time >= start) & (time <= start + _LOOP))


def _static_curve(curve: StaticCurve) -> tuple[Array, Array]:
    velocity = np.linspace(-curve.rebound_speed, curve.compression_speed, 600)
    return _INCH * velocity, _POUND * curve_forces(curve, velocity)


def _decorate(axes: Axes) -> None:
    axes.set_xlabel("velocity [in/s], positive in compression")
    axes.set_ylabel("force without gas force [lbf]")
    axes.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
    axes.axvline(0.0, color="0.7", linewidth=0.6, zorder=0)
    axes.grid(visible=True, color="0.92")
    axes.set_axisbelow(True)
    legend = axes.legend(loc="upper left", framealpha=0.9)
    for handle in legend.legend_handles:
        if handle is not None and hasattr(handle, "set_markersize"):
            handle.set_markersize(7.0)
    top = axes.secondary_xaxis("top", functions=_scaled(1.0 / _INCH))
    top.set_xlabel("[m/s]")
    right = axes.secondary_yaxis("right", functions=_scaled(1.0 / _POUND))
    right.set_ylabel("[N]")


def _scaled(factor: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the conversions of a second axis: to its unit, and back."""
    return lambda values: values * factor, lambda values: values / factor
