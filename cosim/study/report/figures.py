"""Figures for papers like Figs 7.1 to 7.6: levels by build, and trade-offs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cosim.study.choice.pareto import pareto_front
from cosim.study.report.colors import build_colors
from cosim.study.report.corner import dominant_corner
from cosim.study.report.sheet import Column, Indices, Sheet
from eightpost.files import atomic_path

#: Number of measures with figures, and number of other measures that each is plotted against, as in the dissertation.
_DRAWN, _AGAINST = 3, 4


def write_figures(sheet: Sheet, folder: Path) -> tuple[Path, ...]:
    """Write levels and trade-offs of the first measures of the sheet, each as PNG and SVG.

    Args:
        sheet: Report data.
        folder: Output folder.

    Returns:
        The files; empty if no setup ran.
    """
    if not sheet.done.any():
        return ()
    files: list[Path] = []
    for measure in sheet.measures[:_DRAWN]:
        files += _save(trend(sheet, measure), folder / f"{_slug(measure.name)}_levels")
        if len(sheet.measures) > 1:
            files += _save(tradeoffs(sheet, measure), folder / f"{_slug(measure.name)}_tradeoffs")
    return tuple(files)


def trend(sheet: Sheet, measure: Column) -> Figure:
    """Draw the levels of all setups by the build at each corner (Figs 7.1, 7.3, 7.5)."""
    rows = (len(sheet.corners) + 1) // 2
    figure = Figure(figsize=(7.2, rows * (0.9 + 0.24 * len(sheet.builds))), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).ravel()
    colors = np.array(build_colors(len(sheet.builds)))
    for panel, corner, placed in zip(panels, sheet.corners, sheet.placed.T, strict=False):
        spots = panel.scatter(100.0 * measure.levels, placed, s=70, c=colors[placed], marker="|", lw=0.6, alpha=0.5)
        spots.set_rasterized(True)
        panel.set_title(f"{corner.upper()} shock", loc="left", fontsize=9)
        panel.set_yticks(range(len(sheet.builds)), sheet.builds, fontsize=8)
        panel.set_ylim(len(sheet.builds) - 0.4, -0.6)
        panel.grid(axis="x", alpha=0.3)
    _hide(panels[len(sheet.corners) :])
    figure.supxlabel(_level_axis(measure), fontsize=9)
    return figure


def tradeoffs(sheet: Sheet, measure: Column) -> Figure:
    """Draw the levels of one measure against those of others, with the Pareto fronts (Figs 7.2, 7.4, 7.6).

    Colours show the build at the corner that explains most of the measure.
    """
    others = [column for column in sheet.measures if column is not measure][:_AGAINST]
    rows = (len(others) + 1) // 2
    figure = Figure(figsize=(7.2, 2.7 * rows + 0.9), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    corner = dominant_corner(sheet, measure)
    colors = np.array(build_colors(len(sheet.builds)))[sheet.placed[:, corner]]
    for panel, other in zip(panels, others, strict=False):
        spots = panel.scatter(100.0 * measure.levels, 100.0 * other.levels, s=5, c=colors, lw=0, alpha=0.7)
        spots.set_rasterized(True)
        _front(panel, sheet, measure, other)
        panel.set_ylabel(f"{other.name}, level [%]", fontsize=8)
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=8)
    _hide(panels[len(others) :])
    figure.supxlabel(_level_axis(measure), fontsize=9)
    _legend(figure, sheet, corner)
    return figure


def _front(panel: Axes, sheet: Sheet, first: Column, second: Column) -> None:
    rows = front(sheet, first, second)
    panel.plot(100.0 * first.levels[rows], 100.0 * second.levels[rows], "k.-", lw=1.0, ms=4, label="Pareto front")


def front(sheet: Sheet, first: Column, second: Column) -> Indices:
    """Return the rows of the Pareto front of two measures among the feasible setups, ordered by the first measure."""
    costs = [column.values * (1.0 if column.better == "low" else -1.0) for column in (first, second)]
    rows = np.flatnonzero(sheet.allowed & np.isfinite(costs[0]) & np.isfinite(costs[1]))
    kept = rows[pareto_front(np.column_stack(costs)[rows])]
    return np.asarray(kept[np.argsort(first.values[kept])], dtype=np.int64)


def _legend(figure: Figure, sheet: Sheet, corner: int) -> None:
    colors = build_colors(len(sheet.builds))
    marks = [Line2D([], [], color=color, marker="o", ls="", ms=5) for color in colors]
    title = f"build at {sheet.corners[corner].upper()}"
    figure.legend(marks, sheet.builds, title=title, loc="outside upper center", ncols=8, frameon=False, fontsize=8)


def _level_axis(measure: Column) -> str:
    us, (low, high) = measure.scale.us, measure.extremes
    unit = "" if us.unit == "1" else f" {us.unit}"
    return f"{measure.name}, level [%]; 0 is {us(low):.4g}{unit}, 100 is {us(high):.4g}{unit}"


def _hide(panels: Iterable[Axes]) -> None:
    for panel in panels:
        panel.set_visible(False)


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _save(figure: Figure, stem: Path) -> list[Path]:
    """Save a figure as PNG and SVG; the same figure gives the same bytes."""
    files = [stem.with_name(f"{stem.name}.{suffix}") for suffix in ("png", "svg")]
    with mpl.rc_context({"svg.hashsalt": stem.name, "svg.fonttype": "none"}):
        for path in files:
            with atomic_path(path) as temporary:
                figure.savefig(temporary, dpi=200, metadata={"Date": None} if path.suffix == ".svg" else None)
            figure.set_layout_engine("none")  # keep the layout of the first file
    return files
