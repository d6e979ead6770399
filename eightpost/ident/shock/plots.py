"""Plots of fits (Fig 3.14) and of a shock over its settings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.clicks import ClickAnswer, TargetCurve
from eightpost.ident.shock.curve import curve_forces
from eightpost.report.pictures import Axes, Figure, new_figure, panels_of, save
from eightpost.rig.peak_velocity import PeakVelocityTable
from eightpost.shock import Axis, Shock, StaticCurve, law_title
from eightpost.shock.file import force_half_width
from eightpost.units import convert

_INCH, _POUND = convert(1.0, "m/s", "in/s"), convert(1.0, "N", "lbf")

#: Number of samples shown as dots, and duration of the model's loop [s]; more would only fill the page.
_DOTS, _LOOP = 6000, 1.0


#: A `ShockFit`, which draws itself with this module, or what has the same attributes.
DrawnFit = Any


def plot_force_velocity(fits: DrawnFit | Sequence[DrawnFit], path: str | Path) -> None:
    """Write a PNG of force over velocity without the gas force: measured dots, model loop, static curve."""
    save(force_velocity(fits if isinstance(fits, Sequence) else [fits]), path, format="png")


def force_velocity(fits: Sequence[DrawnFit]) -> Figure:
    """Return the figure of `plot_force_velocity`."""
    figure = new_figure(7.2 * len(fits), 6.4)
    for axes, fit in zip(panels_of(figure, len(fits), len(fits), sharex=True, sharey=True), fits, strict=True):
        _panel(axes, fit)
    return figure


def plot_peak_velocity(found: Sequence[tuple[PeakVelocityTable, Shock]], path: str | Path) -> None:
    """Write a PNG of peak-velocity tables and the curves through them, with a colour for each setting."""
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


def _panel(axes: Axes, fit: DrawnFit) -> None:
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


#: Speeds of the map [m/s], as far as they were measured; at most this many settings have a curve.
_SPEEDS = (0.025, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
_CURVES = 9

_VELOCITY, _FORCE = "velocity [m/s], positive in compression", "force without gas force [N]"


def plot_click_map(shock: Shock, path: str | Path) -> None:
    """Write a picture with two panels for each adjuster: curves over clicks, and forces at speeds over clicks.

    The other adjusters are at their reference. Dots are measured settings, shaded areas the 95 % bands, dashed lines
    are beyond the measured settings.
    """
    assert shock.settings is not None
    count = len(shock.settings.axes)
    figure = new_figure(13.0, 5.2 * count)
    panels = panels_of(figure, 2 * count, 2)
    for number, axis in enumerate(shock.settings.axes):
        _curves(panels[2 * number], shock, number, axis)
        _forces(panels[2 * number + 1], shock, number, axis)
    figure.suptitle(f"{shock.name}: force over velocity and setting")
    save(figure, path, format="png")


def plot_answer(shock: Shock, target: TargetCurve, answer: ClickAnswer, path: str | Path) -> None:
    """Write a picture of a target curve and the curve of the best setting with its band."""
    assert shock.settings is not None
    figure = new_figure(7.2, 6.0)
    axes = figure.subplots()
    setting = answer.best.setting
    law = shock.settings.law_at(shock.law, setting)
    velocity = np.linspace(-law.curve.rebound_speed, law.curve.compression_speed, 401)
    force = curve_forces(law.curve, velocity)
    half = np.interp(velocity, law.curve.knot_velocity, force_half_width(shock.settings, shock.law, setting))
    axes.fill_between(
        velocity, force - half, force + half, color="tab:blue", alpha=0.25, linewidth=0, label="95 % band"
    )
    axes.plot(velocity, force, color="tab:blue", label=answer.best.text)
    axes.plot(target.velocity, target.force, "k.", markersize=4.0, label=f"target {target.name}")
    axes.set_title(f"best setting: {answer.best.rms:.0f} N RMS, {answer.best.percent:.1f} % of the target")
    _labelled(axes, _VELOCITY, _FORCE)
    save(figure, path, format="png")


def _on_axis(shock: Shock, number: int, value: float) -> tuple[float, ...]:
    assert shock.settings is not None
    return tuple(value if k == number else reference for k, reference in enumerate(shock.settings.reference))


def _values(axis: Axis, count: int) -> list[float]:
    low = axis.nodes[0] if axis.lowest is None else axis.lowest
    high = axis.nodes[-1] if axis.highest is None else axis.highest
    spread = np.linspace(low, high, count)
    return sorted({*axis.nodes, *(np.round(spread) if axis.is_whole else spread).tolist()})


def _curves(panel: Axes, shock: Shock, number: int, axis: Axis) -> None:
    assert shock.settings is not None
    values = list(axis.nodes) if len(axis.nodes) >= _CURVES else _values(axis, _CURVES)
    for value in values:
        law = shock.settings.law_at(shock.law, _on_axis(shock, number, value))
        velocity = np.linspace(-law.curve.rebound_speed, law.curve.compression_speed, 401)
        color = _color(value, values)
        is_node = value in axis.nodes
        style = "-" if not axis.beyond(value) else "--"
        panel.plot(
            velocity, curve_forces(law.curve, velocity), style, color=color, linewidth=1.8 if is_node else 0.8,
            label=f"{value:.4g}" + (" measured" if is_node else ""),
        )  # fmt: skip
    panel.set_title(f"static curves over {_title(axis)}")
    _labelled(panel, _VELOCITY, _FORCE)


def _forces(panel: Axes, shock: Shock, number: int, axis: Axis) -> None:
    assert shock.settings is not None
    values = _values(axis, 57)
    velocity = np.array(shock.law.curve.knot_velocity)
    laws = [shock.settings.law_at(shock.law, _on_axis(shock, number, value)) for value in values]
    widths = [force_half_width(shock.settings, shock.law, _on_axis(shock, number, value)) for value in values]
    speeds = [speed for speed in _SPEEDS if speed < min(-velocity[0], velocity[-1])]
    for place, speed in enumerate(speeds):
        color = _color(place, range(len(speeds)))
        for sign in (1.0, -1.0):
            force = np.array([law.curve.force(sign * speed) for law in laws])
            half = np.array([np.interp(sign * speed, velocity, width) for width in widths])
            label = f"{speed:g} m/s" if sign > 0.0 else None
            panel.fill_between(values, force - half, force + half, color=color, alpha=0.2, linewidth=0)
            panel.plot(values, force, color=color, linewidth=1.4, label=label)
            at = [values.index(node) for node in axis.nodes]
            panel.plot(list(axis.nodes), force[at], "o", color=color, markersize=4.0)
    panel.set_title("force at speeds, compression above and rebound below")
    _labelled(panel, _title(axis), _FORCE)
    panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _title(axis: Axis) -> str:
    unit = "clicks" if axis.is_whole else axis.unit
    return f"{axis.name} [{unit}{' ' + axis.counted if axis.counted else ''}]"


def _color(value: float, values: Sequence[float]) -> tuple[float, float, float]:
    """Return a colour from blue, the first value, to red, the last."""
    low, high = min(values), max(values)
    share = (value - low) / (high - low) if high > low else 0.0
    return (0.1 + 0.8 * share, 0.3 + 0.25 * (1.0 - abs(2.0 * share - 1.0)), 0.9 - 0.8 * share)


def _labelled(panel: Axes, horizontal: str, vertical: str) -> None:
    panel.set_xlabel(horizontal)
    panel.set_ylabel(vertical)
    panel.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
    panel.grid(visible=True, color="0.92")
    panel.set_axisbelow(True)
    panel.legend(loc="upper left", framealpha=0.9, fontsize=8)
