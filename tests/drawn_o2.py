"""The words of a page, and what its figures and pictures draw, for the fixture `unchanged`."""

from __future__ import annotations

import base64
import gzip
import json
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tests.unchanged import text_of_page


def words_of(page: Path) -> str:
    """Return the words of a page, with each row of a table on a line."""
    tree = lxml.html.fromstring(page.read_text(encoding="utf-8"))
    for row in tree.xpath("//tr"):
        words = " | ".join(" ".join(" ".join(cell.itertext()).split()) for cell in row)
        row.clear()
        row.text = words
    return text_of_page(lxml.html.tostring(tree, encoding="unicode"))


def figures_of(page: Path) -> dict[str, object]:
    """Return the panels, shapes and traces of each figure of a page."""
    tree = lxml.html.fromstring(page.read_text(encoding="utf-8"))
    (script,) = tree.xpath("//script[@id='figures']")
    figures = json.loads(gzip.decompress(base64.b64decode(script.text)))["figures"]
    return {f"figure {k}": _described(figure) for k, figure in enumerate(figures, start=1)}


def _described(figure: dict[str, Any]) -> dict[str, object]:
    layout, units = figure["layout"], figure["units"]
    axes = {
        name: f"{axis['title']['text']} [{units[name.replace('axis', '')]}] {axis['type']} "
              f"{[round(end, 6) for end in axis['domain']]} {axis.get('range', '')}"
        for name, axis in layout.items() if "axis" in name
    }  # fmt: skip
    shapes = {
        f"shape {k} {shape['xref']} {shape['yref']}": np.array([shape[key] for key in ("x0", "x1", "y0", "y1")])
        for k, shape in enumerate(layout["shapes"])
    }
    headings = "; ".join(one["text"] for one in layout["annotations"])
    size = f"{layout['width']} by {layout['height']}, margins {list(layout['margin'].values())}"
    traces = {f"{k} {_style(trace)}": _points(trace) for k, trace in enumerate(figure["data"])}
    return {"size": size, "headings": headings, **axes, **shapes, **traces}


def _style(trace: dict[str, Any]) -> str:
    """Return all of a trace but its points."""
    dressed = {key: trace[key] for key in ("line", "marker", "opacity", "fill") if key in trace}
    return f"{trace['name']} {trace['xaxis']} {trace['mode']} {json.dumps(dressed)} {trace['showlegend']}"


def _points(trace: dict[str, Any]) -> dict[str, object]:
    return {key: np.array(trace[key], dtype=np.float64) for key in "xy"}


def picture_of(figure: Figure) -> dict[str, object]:
    """Return what a picture shows: size, titles, and the axes with their lines, bars, texts and legends."""
    texts = [text.get_text() for text in figure.texts]
    axes = {f"axes {k}": _axes(one) for k, one in enumerate(figure.axes, start=1)}
    return {"size": figure.get_size_inches(), "texts": "; ".join(texts), **axes}


def _axes(axes: Axes) -> dict[str, object]:
    legend = axes.get_legend()
    named = (axes.get_title(), axes.get_title("left"), axes.get_xlabel(), axes.get_ylabel())
    shown = "; ".join(text.get_text() for text in (*axes.texts, *(legend.get_texts() if legend else ())))
    limits = np.array([*axes.get_xlim(), *axes.get_ylim(), *axes.get_position().bounds])
    lines = {
        f"line {k} {line.get_color()} {line.get_linewidth():g} {line.get_linestyle()} {line.get_marker()}":
            {"x": np.asarray(line.get_xdata(), float), "y": np.asarray(line.get_ydata(), float)}
        for k, line in enumerate(axes.lines)
    }  # fmt: skip
    bars = np.array([(one.get_x(), one.get_y(), one.get_width(), one.get_height())
                     for one in axes.patches if isinstance(one, Rectangle)])  # fmt: skip
    parts = {
        "scales": f"{axes.get_xscale()} {axes.get_yscale()}",
        "shown": shown,
        "limits and place": limits,
        "bars": bars,
    }
    return {"named": "; ".join(filter(None, named)), **parts, **lines}
