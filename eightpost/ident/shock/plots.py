"""Plots of force over velocity, measured and fitted (Fig 3.14)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.curve import curve_forces
from eightpost.ident.shock.problem import CurveBand
from eightpost.report.pictures import Axes, Figure, new_figure, panels_of, save
from eightpost.rig.peak_velocity import PeakVelocityTable
from eightpost.shock import Shock, StaticCurve, law_title
from eightpost.signals import TimeSeries
from eightpost.units import convert

_INCH, _POUND = convert(1.0, "m/s", "in/s"), convert(1.0, "N", "lbf")

#: Number of samples shown as dots, and duration of the model's loop [s]; more would only fill the page.
_DOTS, _LOOP = 6000, 1.0


class DrawnFit(Protocol):
    """What a picture shows of a fit: see the attributes of `ShockFit`."""

    @property
    def shock(self) -> Shock:
        """Fitted shock."""
        ...

    @property
    def measured(self) -> TimeSeries:
        """Measured `velocity` [m/s] and `force` [N]."""
        ...

    @property
    def predicted(self) -> TimeSeries:
        """Fitted `force` [N] and `gas_force` [N] at the measured times."""
        ...

    @property
    def band(self) -> CurveBand:
        """95 % band of the static curve."""
        ...

    @property
    def rms(self) -> float:
        """RMS force error [N]."""
        ...

    @property
    def percent(self) -> float:
        """RMS force error [% of the standard deviation of the force]."""
        ...


def plot_force_velocity(fits: DrawnFit | Sequence[DrawnFit], path: str | Path) -> None:
    """Write a PNG of force over velocity without the gas force: measured dots, model loop, static curve.

    Args:
        fits: One fit, or several of one record, with a panel each.
        path: File to write; an existing file is replaced only when the new one is complete.
    """
    save(force_velocity(fits if isinstance(fits, Sequence) else [fits]), path, format="png")


def force_velocity(fits: Sequence[DrawnFit]) -> Figure:
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
