"""Figures of reproduced items: panels of lines, with one colour for each name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.report.charts import COLORS, MEASURED, Axis, Figure, grid_figure

#: Name of the measured, or true, line of a panel, which is drawn wide and grey.
TRUTH = "truth"

#: Number of points of a line; more would only fill the page.
_POINTS = 400

FREQUENCY = Axis("frequency [Hz]", kind="log")
LINEAR_FREQUENCY = Axis("frequency [Hz]")
TIME = Axis("time [s]")
COHERENCE = Axis("coherence", span=(0.0, 1.05))


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a panel."""

    name: str  #: Name in the legend; `truth` is drawn wide and grey.
    x: Array  #: Horizontal values (N,) in SI units.
    y: Array  #: Vertical values (N,) in SI units.
    style: str = "line"  #: `line`, `dots`, `marks` (joined by a line), or `points` (marks alone).


@dataclass(frozen=True, slots=True)
class Plot:
    """A panel with its lines."""

    title: str  #: Heading of the panel.
    x: Axis  #: Horizontal axis.
    y: Axis  #: Vertical axis.
    lines: Sequence[Line] = field(default_factory=list)  #: Lines in the order in which they are drawn.


def figure_of(caption: str, plots: Sequence[Plot], *, columns: int = 3, row: int = 230) -> Figure:
    """Return a figure with panels in a grid; lines of the same name have the same colour in all panels.

    Args:
        caption: Text below the figure.
        plots: Panels, row by row.
        columns: Number of panels in a row.
        row: Height of a row of panels [px].
    """
    columns = min(columns, len(plots))
    rows = -(-len(plots) // columns)
    gap = (min(0.09, 0.16 / columns), 0.26 / rows)
    panels = [(plot.x, plot.y, plot.title) for plot in plots]
    figure = grid_figure(caption, 90 + (row + 30) * rows, panels, columns, gap=gap)
    names = dict.fromkeys(line.name for plot in plots for line in plot.lines if line.name != TRUTH)
    color = {TRUTH: MEASURED} | {name: COLORS[k % len(COLORS)] for k, name in enumerate(names)}
    for k, plot in enumerate(plots):
        for line in plot.lines:
            _draw(figure, k, line, color[line.name])
    return figure


def _draw(figure: Figure, panel: int, line: Line, color: str) -> None:
    every = max(1, -(-line.x.size // (3 * _POINTS if line.style == "dots" else _POINTS)))
    x, y = line.x[::every], line.y[::every]
    if line.style == "dots":
        figure.dots(panel, x, y, name=line.name, color=color)
    elif line.style == "points":
        figure.dots(panel, line.x, line.y, name=line.name, color=color, size=7)
    elif line.style == "marks":
        figure.marks(panel, line.x, line.y, name=line.name, color=color)
    else:
        figure.line(panel, x, y, name=line.name, color=color)


def decibels(values: Array | Complex, unit: float = 1.0) -> Array:
    """Return magnitudes in decibels relative to a unit (Eq 4.8)."""
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(values) / unit, 1e-300)))


def decibel_axis(unit: str) -> Axis:
    """Return a vertical axis in decibels relative to a unit."""
    return Axis(f"dB re 1 {unit}")
