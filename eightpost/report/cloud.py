"""Figure of many points in the plane of two values, some of them named."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array, Flags
from eightpost.report.pictures import Picture, drawable, new_figure
from eightpost.report.traces import COLORS

#: Size of a point among many, and number of points from which they are many.
_SMALL, _MANY = 4.0, 200


class Mark(NamedTuple):
    """A point with a name: its label and its row."""

    label: str
    row: int


class Cloud(NamedTuple):
    """Points of a figure."""

    #: Values (R,) of the horizontal and the vertical axis; NaN for points that are not drawn.
    values: tuple[Array, Array]
    labels: tuple[str, str]  #: Labels of both axes.
    kept: Flags  #: Whether each point (R,) is drawn in colour; the others are grey.
    marks: tuple[Mark, ...] = ()  #: Named points.
    is_line: bool = False  #: Whether the points are joined, from left to right.


def cloud(points: Cloud, *, title: str = "") -> Picture:
    """Return a picture of points.

    Args:
        points: Points to draw.
        title: Title of the figure.
    """
    figure = new_figure(6.0, 4.5)
    axes, (x, y), kept = figure.subplots(), (drawable(one) for one in points.values), points.kept
    size = _SMALL if kept.size > _MANY else 2.0 * _SMALL
    axes.plot(x[~kept], y[~kept], ".", color="0.75", markersize=size)
    axes.plot(x[kept], y[kept], ".", color=COLORS[0], markersize=size)
    if points.is_line:
        order = np.argsort(x, kind="stable")
        axes.plot(x[order], y[order], color=COLORS[0], lw=1.0)
    for mark, color, shape in zip(points.marks, COLORS[1:], ("*", "s", "D"), strict=False):
        axes.plot(x[mark.row], y[mark.row], shape, color=color, markersize=11.0, label=mark.label)
    axes.set(xlabel=points.labels[0], ylabel=points.labels[1], title=title)
    if points.marks:
        axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    return Picture(figure)
