"""Measured and predicted over time (Figs 6.26, 6.29, 6.31)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid
from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from eightpost.ident.vehicle_validation.comparison import Comparison
    from eightpost.ident.vehicle_validation.study import Case

#: How much of a record is drawn [s], of a sine in periods, and most points of a line.
_SPAN, _PERIODS, _POINTS = {"random": 4.0, "bump": 1.5}, 3.0, 700

#: Panels beside each other.
_COLUMNS = 2

#: Time before a bump [s].
_BEFORE = 0.2

#: Quantities that are drawn, the worst predicted output of each (6.5 shows four signals).
_DRAWN = ("velocity", "tire_force", "total_tire_force", "ride_height", "hub_acceleration", "chassis_acceleration")


def time_figure(case: Case) -> Figure:
    """Return a piece of a record: of each quantity the output that is predicted worst."""
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
    caption = f"{case.record.name}: of each quantity the output that is predicted worst. With {case.shocks}."
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
    for wanted in _DRAWN:
        found = [one for one in case.outputs if quantity(one.name) == wanted]
        moving = [one for one in found if one.is_judged] or found
        if moving:
            yield max(moving, key=lambda one: one.error)


def _piece(case: Case, one: Comparison) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Return the samples that are drawn: about the largest value, of a bump just before it."""
    rate, record = case.record.series.sample_rate, case.record
    span = _PERIODS / record.frequency if record.frequency else _SPAN.get(record.kind, _SPAN["random"])
    top = int(np.argmax(np.abs(one.measured)))
    before = round((_BEFORE if record.kind == "bump" else 0.5 * span) * rate)
    count = min(round(span * rate), one.measured.size)
    first = min(max(top - before, 0), one.measured.size - count)
    return np.unique(np.linspace(first, first + count - 1, min(_POINTS, count)).astype(np.intp))
