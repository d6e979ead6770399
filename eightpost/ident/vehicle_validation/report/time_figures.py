"""Plots of measured and predicted outputs over time (Figs 6.26, 6.29, 6.31)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid
from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eightpost.ident.vehicle_validation.comparison import Comparison
    from eightpost.ident.vehicle_validation.study import Case

#: Length of the plotted part of a record [s], for a sine in periods, and maximum number of points per line.
_SPAN, _PERIODS, _POINTS = {"random": 4.0, "bump": 1.5}, 3.0, 700

#: Panels per row.
_COLUMNS = 2

#: Time before a bump [s].
_BEFORE = 0.2

#: Quantities that are plotted, with the worst predicted output of each (6.5 shows four signals).
_DRAWN = ("velocity", "tire_force", "total_tire_force", "ride_height", "hub_acceleration", "chassis_acceleration")


def time_figure(case: Case) -> Figure:
    """Return a plot of part of a record: for each quantity the output with the worst prediction."""
    shown = list(_shown(case))
    kept = _piece(case, shown[0])
    rows = -(-len(shown) // _COLUMNS)
    places = grid(len(shown), _COLUMNS, gap=(0.08, 0.24 / rows))
    panels = [
        Panel(
            Axis("time [s]" if k >= len(shown) - _COLUMNS else ""),
            Axis(quantity(one.name).replace("_", " "), one.unit),
            *place,
            title=f"{one.name}: error {100 * one.error:.2g} %",
        )
        for k, (one, place) in enumerate(zip(shown, places, strict=True))
    ]
    caption = f"{case.record.name}: for each quantity the output with the worst prediction. Ports: {case.shocks}."
    figure = Figure(caption, 130 + 170 * rows, panels)
    smooth = {one.name: one for one in case.without_friction or ()}
    for k, one in enumerate(shown):
        time = case.time[kept]
        figure.line(k, time, one.measured[kept], name="measured", color=MEASURED)
        if one.name in smooth:
            figure.line(k, time, smooth[one.name].predicted[kept], name="without friction", color=COLORS[1], dash="dot")
        figure.line(k, time, one.predicted[kept], name="predicted", color=COLORS[0])
    return figure


def _shown(case: Case) -> Iterator[Comparison]:
    for shown in _DRAWN:
        outputs = [one for one in case.outputs if quantity(one.name) == shown]
        moving = [one for one in outputs if one.is_judged] or outputs
        if moving:
            yield max(moving, key=lambda one: one.error)


def _piece(case: Case, one: Comparison) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Return the indices of the plotted samples: around the largest value, or for a bump from just before it."""
    rate, record = case.record.series.sample_rate, case.record
    span = _PERIODS / record.frequency if record.frequency else _SPAN.get(record.kind, _SPAN["random"])
    top = int(np.argmax(np.abs(one.measured)))
    before = round((_BEFORE if record.kind == "bump" else 0.5 * span) * rate)
    count = min(round(span * rate), one.measured.size)
    first = min(max(top - before, 0), one.measured.size - count)
    return np.unique(np.linspace(first, first + count - 1, min(_POINTS, count)).astype(np.intp))
