"""Interactive plots: panels with lines and marks, as plotly's JSON in SI, which a page's script converts and draws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Protocol

import numpy as np

from eightpost.array_types import Array


class Series(Protocol):
    """Channels sampled at common times: times (N,) [s], and samples (C, N) in the SI unit of each channel."""

    @property
    def time(self) -> Array:
        """Times (N,) [s]."""

    @property
    def values(self) -> Array:
        """Samples (C, N), each row in the SI unit of its channel."""

    @property
    def names(self) -> tuple[str, ...]:
        """C names of channels."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""

    @property
    def is_uniform(self) -> bool:
        """Whether all time steps are equal."""

    @property
    def sample_rate(self) -> float:
        """Sample rate [Hz]."""

    def __len__(self) -> int:
        """Return the number of samples."""

    def __getitem__(self, name: str, /) -> Array:
        """Return a channel (N,)."""

    def unit(self, name: str, /) -> str:
        """Return the SI unit of a channel."""

    def select(self, names: Iterable[str], /) -> Series:
        """Return a series with these channels in this order."""

    def window(self, start: float, stop: float, /) -> Series:
        """Return the samples between two times [s]."""

    def resample(self, rate: float, /) -> Series:
        """Return a series with a uniform sample rate [Hz]."""


#: Width of every figure [px]: that of a landscape A4 page within its margins, so that print and screen look the same.
WIDTH = 1000

#: Okabe and Ito's colours, which colour-blind readers can distinguish, without the yellow, which is too light on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#8e5a9b", "#56b4e9", "#e69f00", "#4d4d4d", "#a6374f")

#: Colour of measured lines, which are wider than the others.
MEASURED = "#9aa4b1"

#: Space for axis labels next to a panel and above it [px].
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 58, 44

#: Width of a letter and of the key of a line in the legend, height of a row of the legend and of a heading [px].
_LETTER, _KEY, _ROW, _HEADING = 7.0, 45, 19, 24

_AXIS = {"gridcolor": "#e6e9ee", "zerolinecolor": "#c3cad3", "linecolor": "#b9c1cb", "ticks": "outside", "ticklen": 3,
         "tickcolor": "#b9c1cb", "tickfont": {"size": 10}, "automargin": False}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of a panel."""

    title: str  #: Name of the quantity on the axis.
    unit: str = ""  #: SI unit; empty for a plain number. The page appends the unit to the title.
    kind: str = "linear"  #: `linear` or `log`.
    #: Fixed range in plotly's terms, for axes without unit; None: the range follows the data.
    span: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Panel:
    """A panel of a figure."""

    x: Axis  #: Horizontal axis.
    y: Axis  #: Vertical axis.
    column: tuple[float, float]  #: Start and end as shares of the figure's width [1].
    row: tuple[float, float]  #: Start and end as shares of the figure's height [1], from below.
    title: str = ""  #: Heading above the panel.


@dataclass
class Figure:
    """A figure under construction."""

    caption: str  #: Text below the figure.
    height: int  #: Height [px].
    panels: Sequence[Panel]  #: Panels with their axes and positions.
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _shapes: list[dict[str, Any]] = field(default_factory=list)
    _named: set[str] = field(default_factory=set)

    def line(self, panel: int, x: Array, y: Array, *, name: str, color: str, dash: str = "solid") -> None:
        """Draw a line in a panel, counted from 0; a name is in the legend once. Measured lines are wider."""
        width = 4.0 if color == MEASURED else 1.4
        self._add(panel, x, y, name, mode="lines", line={"color": color, "width": width, "dash": dash})

    def dots(self, panel: int, x: Array, y: Array, *, name: str, color: str = MEASURED, size: float = 2.5) -> None:
        """Draw dots in a panel."""
        self._add(panel, x, y, name, mode="markers", marker={"color": color, "size": size})

    def marks(
        self, panel: int, x: Array, y: Array, *, name: str, color: str, symbol: str = "circle", dash: str = "solid",
        size: float = 8,
    ) -> None:  # fmt: skip
        """Draw marks of a size [px] joined by a line."""
        marker, line = {"color": color, "size": size, "symbol": symbol}, {"color": color, "width": 1.5, "dash": dash}
        self._add(panel, x, y, name, mode="lines+markers", marker=marker, line=line)

    def ribbon(self, panel: int, x: Array, low: Array, high: Array, *, name: str, color: str) -> None:
        """Shade the area between two lines over x (N,); the shade belongs to the lines with the same name."""
        first = name not in self._named
        around, edge = np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]])
        line = {"color": color, "width": 0}
        self._add(panel, around, edge, name, mode="lines", line=line, fill="toself", opacity=0.25, hoverinfo="skip",
                  fillcolor=color, showlegend=False)  # fmt: skip
        if first:
            self._named.discard(name)

    def band(self, panel: int, start: float, stop: float) -> None:
        """Shade a span of a panel's horizontal axis, whose unit must be the same in both unit systems."""
        x, y = _axes(panel)
        self._shapes.append({"type": "rect", "xref": x, "yref": f"{y} domain", "x0": start, "x1": stop, "y0": 0,
                             "y1": 1, "fillcolor": "#eceff3", "line": {"width": 0}, "layer": "below"})  # fmt: skip

    def level(self, panel: int, value: float) -> None:
        """Draw a dotted horizontal line at a value of an axis without unit."""
        x, y = _axes(panel)
        self._shapes.append({"type": "line", "xref": f"{x} domain", "yref": y, "x0": 0, "x1": 1, "y0": value,
                             "y1": value, "line": {"color": "#5b6675", "width": 1, "dash": "dot"}})  # fmt: skip

    @property
    def units(self) -> set[str]:
        """SI units of its axes and marks."""
        axes = {axis.unit for panel in self.panels for axis in (panel.x, panel.y)}
        return axes - {""}

    def content(self) -> dict[str, Any]:
        """Return the content that the page's script draws."""
        layout: dict[str, Any] = {
            "width": WIDTH,
            "height": self.height,
            "margin": {"l": _LEFT, "r": _RIGHT, "t": self._top(), "b": _BOTTOM},
            "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top", "font": {"size": 12}},
            "shapes": self._shapes,
            "annotations": [],
        }
        units: dict[str, str] = {}
        for k, panel in enumerate(self.panels):
            x, y = _axes(k)
            layout[_layout_name(x)] = _axis(panel.x, panel.column, y)
            layout[_layout_name(y)] = _axis(panel.y, panel.row, x)
            units |= {x: panel.x.unit, y: panel.y.unit}
            if panel.title:
                layout["annotations"].append(_heading(panel))
        return {"data": self._traces, "layout": layout, "units": units}

    def _top(self) -> int:
        """Return the space above the panels [px]: for a heading, and for the legend in columns of equal width."""
        names = [name for name in self._named if name]
        if not names:
            return _HEADING + 6
        columns = max(1, int((WIDTH - _LEFT - _RIGHT) // (_LETTER * max(map(len, names)) + _KEY)))
        return max(_TOP, _ROW * -(-len(names) // columns) + _HEADING + 12)

    def _add(self, panel: int, x: Array, y: Array, name: str, **style: Any) -> None:
        x_axis, y_axis = _axes(panel)
        first = bool(name) and name not in self._named
        trace = {"type": "scatter", "x": _numbers(x), "y": _numbers(y), "xaxis": x_axis, "yaxis": y_axis,
                 "name": name, "legendgroup": name, "showlegend": first, "hoverinfo": "x+y+name"}  # fmt: skip
        self._named.add(name)
        self._traces.append(trace | style)


def grid_figure(
    caption: str, height: int, panels: Sequence[tuple[Axis, Axis, str]], columns: int, *, gap: tuple[float, float]
) -> Figure:
    """Return a figure with panels in a grid, row by row from above.

    Args:
        caption: Text below the figure.
        height: Height [px].
        panels: Horizontal axis, vertical axis and heading of each panel.
        columns: Number of panels in a row.
        gap: Gaps between columns and between rows [1].
    """
    rows = -(-len(panels) // columns)
    wide, high = (1.0 - gap[0] * (columns - 1)) / columns, (1.0 - gap[1] * (rows - 1)) / rows
    placed = []
    for k, (x, y, title) in enumerate(panels):
        left, below = (k % columns) * (wide + gap[0]), (rows - 1 - k // columns) * (high + gap[1])
        placed.append(Panel(x, y, (left, left + wide), (below, below + high), title))
    return Figure(caption, height, placed)


def row_figure(
    caption: str, height: int, panels: Sequence[tuple[Axis, Axis, str]], columns: int, *, gap: float
) -> Figure:
    """Return a figure with panels in as many rows as they need, with space for titles and labels between the rows.

    Args:
        caption: Text below the figure.
        height: Height of a row [px].
        panels: Horizontal axis, vertical axis and heading of each panel.
        columns: Number of panels in a row.
        gap: Gap between columns [1].
    """
    rows = ceil(len(panels) / columns)
    return grid_figure(caption, 110 + height * rows, panels, columns, gap=(gap, 0.28 / rows))


def _axes(panel: int) -> tuple[str, str]:
    number = "" if panel == 0 else str(panel + 1)
    return f"x{number}", f"y{number}"


def _layout_name(axis: str) -> str:
    return f"{axis[0]}axis{axis[1:]}"


def _axis(axis: Axis, domain: tuple[float, float], anchor: str) -> dict[str, Any]:
    entry: dict[str, Any] = dict(_AXIS) | {"domain": list(domain), "anchor": anchor, "type": axis.kind}
    entry["title"] = {"text": axis.title, "font": {"size": 11}, "standoff": 4}
    if axis.span:
        entry["range"] = list(axis.span)
    return entry


def _heading(panel: Panel) -> dict[str, Any]:
    return {"text": panel.title, "xref": "paper", "yref": "paper", "x": sum(panel.column) / 2.0, "y": panel.row[1],
            "xanchor": "center", "yanchor": "bottom", "showarrow": False,
            "font": {"size": 11, "color": "#1c2430"}}  # fmt: skip


def _numbers(values: Array) -> list[float]:
    """Return values rounded to six digits of the largest, finer than a screen's resolution."""
    array = np.asarray(values, dtype=np.float64)
    top = float(np.abs(array).max(initial=0.0))
    digits = 5 - int(np.floor(np.log10(top))) if top > 0.0 else 0
    rounded: list[float] = np.round(array, digits).tolist()
    return rounded
