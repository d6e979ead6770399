"""The FMU's icon: a symbol of a shock or of a vehicle, which discloses none of their data."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from builder.documents.picture import plain_style, png
from eightpost.shock import Shock
from eightpost.vehicle import Vehicle

_CAR = ([6, 6, 16, 30, 38, 62, 74, 94, 95, 6], [36, 50, 54, 56, 72, 72, 56, 52, 36, 36])
_WINDOW = ([36, 42, 59, 66], [56.5, 67, 67, 56.5])
_INK, _BODY, _PART = "#1c2430", "#0072b2", "#c9d6e4"


def icon(source: Shock | Vehicle) -> bytes:
    """Return a square PNG, 256 pixels wide, with a transparent background."""
    return _drawn(_draw_shock if isinstance(source, Shock) else _draw_vehicle)


@lru_cache
def _drawn(draw: Callable[[Axes], None]) -> bytes:
    with plain_style():
        figure = Figure(figsize=(2.56, 2.56), dpi=100)
        FigureCanvasAgg(figure)
        figure.patch.set_alpha(0.0)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
        draw(axes)
        return png(figure)


def _draw_shock(axes: Axes) -> None:
    """Draw a monotube shock with its eyes and a coil around it."""
    edge: dict[str, Any] = {"edgecolor": _INK, "linewidth": 2.5}
    axes.add_patch(Rectangle((46.5, 48), 7, 36, facecolor=_PART, **edge))
    axes.add_patch(FancyBboxPatch((37, 17), 26, 38, "round,pad=0,rounding_size=4", facecolor=_BODY, **edge))
    for centre in (9, 91):
        axes.add_patch(Circle((50, centre), 7, facecolor="white", edgecolor=_INK, linewidth=4))
    for bottom in range(24, 78, 9):
        axes.plot([28, 72], [bottom, bottom + 9], color=_INK, linewidth=4.5, solid_capstyle="round")


def _draw_vehicle(axes: Axes) -> None:
    """Draw a stock car from the side: body, window, two wheels, road."""
    edge: dict[str, Any] = {"edgecolor": _INK, "joinstyle": "round"}
    axes.fill(*_CAR, facecolor=_BODY, linewidth=3.5, **edge)
    axes.fill(*_WINDOW, facecolor="white", linewidth=2.5, **edge)
    for centre in (25, 75):
        axes.add_patch(Circle((centre, 35), 13, facecolor=_INK, edgecolor="white", linewidth=2.5))
        axes.add_patch(Circle((centre, 35), 5.5, facecolor=_PART, edgecolor="none"))
    axes.plot([3, 97], [21, 21], color=_INK, linewidth=3.5, solid_capstyle="round")
