"""Small plots of curves as SVG, which need no script: visible at once, on any screen and in print."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

import numpy as np
from markupsafe import Markup

from eightpost.array_types import Array
from eightpost.report.numbers import Display, figure

#: Size of a plot and space for the numbers beside it [px].
WIDTH, HEIGHT = 300, 190
_LEFT, _RIGHT, _TOP, _BOTTOM = 42, 6, 8, 32

#: Curve: x (K,) and y (K,) in the SI units of the axes, and the style class of its line.
Curve = tuple[Array, Array, str]


def small_plot(curves: Sequence[Curve], x: tuple[str, Display], y: tuple[str, Display], label: str) -> Markup:
    """Return a plot of curves.

    Args:
        curves: Curves; later ones are drawn on top.
        x: Name and display unit of the horizontal axis.
        y: Name and display unit of the vertical axis.
        label: Description for readers who cannot see the plot.
    """
    across, up = [curve[0] for curve in curves], [curve[1] for curve in curves]
    spans = [[display(end) for end in _span(values)] for values, (_, display) in ((across, x), (up, y))]

    def place(values: Array, axis: int) -> Array:
        low, high = spans[axis]
        share: Array = (np.asarray(values) - low) / (high - low)
        wide, tall = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
        start, size = (_LEFT, wide) if axis == 0 else (HEIGHT - _BOTTOM, -tall)
        return np.asarray(start + size * share)

    grid = [_line(tick, place(np.array([tick]), axis)[0], axis) for axis in (0, 1) for tick in _ticks(*spans[axis])]
    lines = [
        f'<polyline class="{style}" points="{_points(place(x[1](xs), 0), place(y[1](ys), 1))}"/>'
        for xs, ys, style in curves
    ]
    titles = (
        f'<text x="{WIDTH - _RIGHT}" y="{HEIGHT - 3}" class="end">{{}} [{{}}]</text>'
        f'<text x="{_LEFT + 4}" y="{_TOP + 8}">{{}} [{{}}]</text>'
    )
    head = f'<svg class="small" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{{}}">'
    return Markup(head + "".join(grid) + titles + "".join(lines) + "</svg>").format(
        label, x[0], x[1].unit, y[0], y[1].unit
    )


def _span(values: Sequence[Array]) -> tuple[float, float]:
    low, high = float(min(map(np.min, values))), float(max(map(np.max, values)))
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _ticks(low: float, high: float) -> list[float]:
    """Return two to five round numbers in a span."""
    size = 10.0 ** floor(log10(high - low))
    step = next(part * size for part in (0.2, 0.5, 1.0, 2.0, 5.0) if (high - low) / (part * size) <= 5.0)
    return [k * step for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _line(tick: float, place: float, axis: int) -> str:
    """Return a grid line with its number; the line of zero is an axis."""
    style = "axis" if tick == 0.0 else "grid"
    if axis == 0:
        line = f'<line class="{style}" x1="{place:.1f}" x2="{place:.1f}" y1="{_TOP}" y2="{HEIGHT - _BOTTOM}"/>'
        return f'{line}<text class="middle" x="{place:.1f}" y="{HEIGHT - _BOTTOM + 13}">{figure(tick)}</text>'
    line = f'<line class="{style}" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{place:.1f}" y2="{place:.1f}"/>'
    return f'{line}<text class="end" x="{_LEFT - 4}" y="{place + 4:.1f}">{figure(tick)}</text>'


def _points(across: Array, up: Array) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
