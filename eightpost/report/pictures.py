"""Plots in image files: figures, panels, how they are saved, and the figures of series and of many points."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eightpost import units
from eightpost.array_types import Array, Flags
from eightpost.errors import InputError, check_number
from eightpost.extras import needs
from eightpost.files import atomic_path
from eightpost.outputs import PICTURE, check_file
from eightpost.report.charts import Series

# ---- Figures and panels ---------------------------------------------------------------------------------------------

with needs("report", "drawing pictures"):
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

__all__ = [
    "Axes", "Figure", "Picture", "color_cells", "new_figure", "panels_of", "plain_style", "png", "save",
    "ticks_at_1_2_5",
]  # fmt: skip


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """Return an empty figure of a width and a height [in]; the layout of its panels is computed when it is drawn.

    Args:
        width: Width [in].
        height: Height [in].
        options: Options of matplotlib's figure; `layout=None` if its panels have fixed positions.
    """
    figure = Figure(figsize=(width, height), **dict[str, Any]({"layout": "constrained"} | options))
    FigureCanvasAgg(figure)
    return figure


def panels_of(figure: Figure, count: int, columns: int, **options: Any) -> list[Axes]:
    """Return the panels of a grid, row by row."""
    rows = -(-count // columns)
    panels = list(figure.subplots(rows, columns, squeeze=False, **options).ravel())
    for panel in panels[count:]:
        panel.set_visible(False)
    return panels[:count]


def _drawable(values: Array) -> Array:
    """Return values with NaN, which is not drawn, where they are too large for the axes of matplotlib."""
    return np.where(np.abs(values) <= _LARGEST, values, np.nan)


#: Largest number whose axis matplotlib can divide: the limits of an axis are multiplied and subtracted.
_LARGEST = 1e300


def _plain_text(text: str) -> str:
    """Return a name of the user so that it is drawn as it is, and not as mathematics, if it contains dollar signs."""
    return text.replace("$", r"\$")


def color_cells(axes: Axes, numbers: Array, colors: Sequence[str]) -> None:
    """Draw a matrix of the numbers 1, 2, ... as cells in the first, the second, ... colour."""
    colored = ListedColormap(list(colors))
    axes.imshow(numbers, cmap=colored, vmin=0.5, vmax=len(colors) + 0.5, aspect="auto")


def ticks_at_1_2_5(axes: Axes) -> None:
    """Put the ticks of a logarithmic horizontal axis at 1, 2 and 5 of every decade."""
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:g}")


@contextmanager
def plain_style() -> Iterator[None]:
    """Draw with matplotlib's defaults, not the user's settings, so that the same data give the same bytes."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        yield


def png(figure: Figure, *, dpi: int | None = None) -> bytes:
    """Return a figure as PNG without a date and without the name of the software.

    Args:
        figure: Figure to draw.
        dpi: Resolution [1/in]; None: that of the figure.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi or "figure", metadata={"Software": None})
    return buffer.getvalue()


def save(figure: Figure, path: str | Path, *, dpi: int = 110, **options: Any) -> None:
    """Save a figure; an existing file is replaced only when the new one is complete.

    Args:
        figure: Figure to save.
        path: File to write; its suffix is its format (.png, .pdf, .svg).
        dpi: Resolution [1/in].
        options: Options of matplotlib's savefig.
    """
    check_file(Path(path), PICTURE)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi, **options)


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure that a notebook shows."""

    figure: Figure  #: Figure of matplotlib, to be changed before it is shown or saved.

    def save(self, path: str | Path, *, dpi: int = 110) -> None:
        """Save the picture; the suffix of the file name is the format (.png, .svg, .pdf).

        Args:
            path: File to write.
            dpi: Resolution [1/in].
        """
        save(self.figure, path, dpi=dpi)

    def _repr_png_(self) -> bytes:
        return png(self.figure, dpi=_SCREEN)


#: Resolution of a picture in a notebook [1/in].
_SCREEN = 72


# ---- Time series: traces over time, and one channel over another ----------------------------------------------------

COLORS = ("#1f77b4", "#d95f02", "#1b9e77", "#7570b3")

#: Number of channels in the picture of a run, and the length that it shows of a long run [s].
PANELS, _SHOWN = 12, 4.0

#: Largest number of channels in a picture; matplotlib cannot save one of 65,536 pixels.
_MOST = 300


def traces(
    runs: Mapping[str, Series], channels: Sequence[str], *, start: float, stop: float, title: str = "Time traces"
) -> Figure:
    """Return channels over time, one panel each, one line per run.

    Args:
        runs: Series by label.
        channels: Names of the channels.
        start: Start of the shown part [s].
        stop: End of the shown part [s].
        title: Title of the figure.
    """
    # Margins in inches. A computed layout would draw all panels once more, which takes most of a short run's time.
    width, height = 11.0, 1.9 * len(channels) + 0.8
    margins = {"left": 1.0 / width, "right": 1.0 - 0.1 / width, "bottom": 0.5 / height, "top": 1.0 - 0.45 / height}
    figure = new_figure(width, height, layout=None)
    panels = panels_of(figure, len(channels), 1, sharex=True, gridspec_kw={**margins, "hspace": 0.12})
    for panel, channel in zip(panels, channels, strict=True):
        for (label, series), color in zip(runs.items(), COLORS, strict=False):
            shown = series.window(start, stop)
            values = _drawable(displayed(shown, channel))
            panel.plot(shown.time, values, lw=1.0, color=color, label=_plain_text(label))
        _label(panel, runs, channel)
    panels[-1].set_xlabel("time [s]")
    if len(runs) > 1:
        panels[0].legend(loc="upper right", ncols=len(runs), frameon=False)
    figure.suptitle(_plain_text(title), y=1.0 - 0.1 / height, va="top")
    return figure


def _excerpt(series: Series) -> tuple[float, float]:
    """Return start and end [s] of the middle of a long series, of the whole of one that is short or has few samples."""
    first, last = float(series.time[0]), float(series.time[-1])
    begin, end = 0.5 * (first + last - _SHOWN), 0.5 * (first + last + _SHOWN)
    inside = np.searchsorted(series.time, end, "right") - np.searchsorted(series.time, begin, "left")
    return (first, last) if last - first <= 2.0 * _SHOWN or inside < 2 else (begin, end)


def picture(
    series: Series,
    channels: str | Sequence[str] = (),
    *,
    start: float | None = None,
    stop: float | None = None,
    title: str = "",
) -> Picture:
    """Return a picture of channels over time.

    Args:
        series: Series to show.
        channels: Names of the channels; default: the first twelve.
        start: Start of the shown part [s].
        stop: End of the shown part [s]; default of both: the middle of a long series, all of a short one.
        title: Title of the figure.

    Raises:
        MissingChannelError: The series has no such channel.
        InputError: There is no sample between start and stop, or no channel, or only one sample, or too many channels.
    """
    for name, value in (("start", start), ("stop", stop)):
        check_number(name, value, "s")
    shown = tuple(dict.fromkeys([channels] if isinstance(channels, str) else channels)) or series.names[:PANELS]
    if not 0 < len(shown) <= _MOST or len(series) < 2:
        raise InputError(f"a picture over time needs two samples and 1 to {_MOST} channels; these are "
                         f"{len(series)} samples of {len(shown)} channels")  # fmt: skip
    series = series.select(shown)
    begin, end = _excerpt(series) if start is None and stop is None else (float(series.time[0]), float(series.time[-1]))
    begin, end = begin if start is None else start, end if stop is None else stop
    if not (max(begin, series.time[0]) < min(end, series.time[-1])):
        span = f"{series.time[0]:g} to {series.time[-1]:g} s"
        raise InputError(f"start = {begin:g} s and stop = {end:g} s contain no sample; the channels cover {span}")
    return Picture(traces({title or "series": series}, shown, start=begin, stop=end, title=title))


def loop(series: Series, across: str, up: str, *, title: str = "") -> Picture:
    """Return a picture of one channel over another."""
    figure = new_figure(6.0, 4.5)
    axes = figure.subplots()
    axes.plot(_drawable(displayed(series, across)), _drawable(displayed(series, up)), lw=0.5, color=COLORS[0])
    axes.set_xlabel(f"{_plain_text(across)} [{display_unit(series, across)}]")
    axes.set_ylabel(f"{_plain_text(up)} [{display_unit(series, up)}]")
    axes.set_title(_plain_text(title))
    axes.grid(alpha=0.3)
    return Picture(figure)


def display_unit(series: Series, channel: str) -> str:
    """Return the unit in which a channel is drawn."""
    return units.display_unit(series.unit(channel))


def displayed(series: Series, channel: str) -> Array:
    """Return a channel (N,) in the unit in which it is drawn."""
    with np.errstate(over="ignore"):  # a run that diverged
        return units.convert(series[channel], series.unit(channel), display_unit(series, channel))


def _label(panel: Axes, runs: Mapping[str, Series], channel: str) -> None:
    panel.set_ylabel(f"{_plain_text(channel)}\n[{display_unit(next(iter(runs.values())), channel)}]", fontsize=9)
    panel.yaxis.set_label_coords(-0.055, 0.5)
    panel.grid(alpha=0.3)


# ---- Many points in the plane of two values, some of them named -----------------------------------------------------

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
    """Return a picture of points."""
    figure = new_figure(6.0, 4.5)
    axes, (x, y), kept = figure.subplots(), (_drawable(one) for one in points.values), points.kept
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
