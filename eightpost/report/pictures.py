"""Plots in image files: figures, panels and how they are saved."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.extras import needs
from eightpost.files import atomic_path
from eightpost.outputs import PICTURE, check_file

with needs("report", "drawing pictures"):
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, FancyBboxPatch, Rectangle
    from matplotlib.ticker import LogLocator, NullLocator

__all__ = [
    "Axes", "Circle", "FancyBboxPatch", "Figure", "Picture", "Rectangle", "color_cells", "drawable",
    "new_figure", "panels_of", "plain_style", "plain_text", "png", "save", "ticks_at_1_2_5",
]  # fmt: skip


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """Return an empty figure of a width and a height [in]; the layout of its panels is computed when it is drawn.

    Args:
        width: Width [in].
        height: Height [in].
        options: Options of matplotlib's figure; `layout=None` if its panels have fixed positions.
    """
    figure = Figure(figsize=(width, height), **{"layout": "constrained"} | options)
    FigureCanvasAgg(figure)
    return figure


def panels_of(figure: Figure, count: int, columns: int, **options: Any) -> list[Axes]:
    """Return the panels of a grid, row by row.

    Args:
        figure: Figure to which the panels are added.
        count: Number of panels.
        columns: Number of panels in a row.
        options: Options of matplotlib's subplots.
    """
    rows = -(-count // columns)
    panels = list(figure.subplots(rows, columns, squeeze=False, **options).ravel())
    for panel in panels[count:]:
        panel.set_visible(False)
    return panels[:count]


def drawable(values: Array) -> Array:
    """Return values with NaN, which is not drawn, where they are too large for the axes of matplotlib.

    Args:
        values: Values of any shape, as of a run that diverged.
    """
    return np.where(np.abs(values) <= _LARGEST, values, np.nan)


#: Largest number whose axis matplotlib can divide: the limits of an axis are multiplied and subtracted.
_LARGEST = 1e300


def plain_text(text: str) -> str:
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
