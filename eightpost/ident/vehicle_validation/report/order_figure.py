"""Plot of the stabilisation diagram of a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.validation.report.figure import COLORS, MEASURED, Axis, Figure, Panel, grid

if TYPE_CHECKING:
    from eightpost.ident.vehicle.trust import Orders


def order_figure(orders: Orders) -> Figure:
    """Return a plot of the poles of models of increasing order, and of the gaps of the singular values."""
    (poles, _), (_, row) = grid(2, 2, gap=(0.08, 0.0))
    states = Axis("states", span=(0.0, orders.tried[-1].states + 2.0))
    panels = (
        Panel(Axis("frequency [Hz]", span=(0.0, 1.2 * orders.high)), states, (poles[0], 0.76), row, title="poles"),
        Panel(Axis("singular value / next one", kind="log"), states, (0.82, 1.0), row, title="gaps"),
    )
    why = "a clear gap of the singular values" if orders.is_clear else "the description length, as no gap is clear"
    figure = Figure(
        f"Stabilisation diagram: poles of models of increasing order. {orders.chosen} states were chosen by {why}.",
        380,
        panels,
    )
    for steady, name, color in ((False, "moved", MEASURED), (True, "same as at the previous order", COLORS[0])):
        there = [(p.frequency, one.states) for one in orders.tried for p in one.poles if p.steady is steady]
        kept = np.array([pair for pair in there if pair[0] <= 1.2 * orders.high]).reshape(-1, 2)
        figure.dots(0, kept[:, 0], kept[:, 1], name=name, color=color, size=6.0)
    gaps = np.array([one.gap for one in orders.tried])
    figure.marks(1, gaps, np.array([float(one.states) for one in orders.tried]), name="gap", color=COLORS[2])
    for panel in (0, 1):
        figure.level(panel, float(orders.chosen))
    return figure
