"""What a figure of matplotlib shows, for kept results."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from .unchanged import lines_of


def figure_lines(figure: Figure) -> list[str]:
    """Return the size and the title of a figure, and the texts, lines, bars, areas and images of each of its panels."""
    found = [f"size {figure.get_size_inches().tolist()} {figure.get_suptitle()}"]
    for axes in figure.axes:
        title, xscale, yscale = axes.get_title(), axes.get_xscale(), axes.get_yscale()
        words = [title, axes.get_xlabel(), axes.get_ylabel(), xscale, yscale, "" if axes.get_visible() else "hidden"]
        legend = axes.get_legend()
        found.append(
            f"panel: {' | '.join(words)} | {[text.get_text() for text in legend.get_texts()] if legend else ''}"
        )
        if figure.get_layout_engine() is None:
            found.append(f"place {np.round(axes.get_position().bounds, 4).tolist()}")
        found += [f"  {line}" for line in _artists(axes)]
    return found


def _artists(axes: Any) -> Iterator[str]:
    yield from (f"text {one.get_text()} at {one.get_position()}" for one in axes.texts if isinstance(one, Text))
    for line in axes.lines:
        x, y = (np.asarray(data, dtype=float) for data in line.get_data())
        style = [line.get_color(), line.get_linestyle(), line.get_linewidth(), line.get_marker(), line.get_markersize()]
        yield f"line {_label(line)} {style}"
        if x.size:
            yield from lines_of({"x": x, "y": y})
    for bar in axes.patches:
        yield f"patch {bar.get_facecolor()}"
        yield from lines_of({"corners": _corners(bar)})
    for part in axes.collections:
        yield f"collection {_label(part)}"
        if isinstance(part, LineCollection):
            yield from lines_of({"segments": np.concatenate([np.asarray(one) for one in part.get_segments()])})
        elif isinstance(part, PolyCollection):
            yield from lines_of({"area": np.concatenate([path.vertices for path in part.get_paths()])})
    for image in axes.images:
        yield from lines_of({"image": np.asarray(image.get_array(), dtype=float), "extent": list(image.get_extent())})


def _label(artist: Any) -> str:
    """Return the label of an artist; empty if it has none of its own."""
    label: str = artist.get_label()
    return "" if label.startswith("_") else label


def _corners(patch: Any) -> np.ndarray:
    """Return the corners of a patch in the units of its panel."""
    return np.asarray(patch.get_patch_transform().transform(patch.get_path().vertices)).ravel()
