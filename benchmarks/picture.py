"""Picture of error over cost for every engine and scheme."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from math import log10
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

Row = dict[str, Any]

#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
COLORS = {
    "eightpost": "#0072B2", "fmpy": "#E69F00", "fmpy-ssp": "#CC79A7", "libcosim": "#009E73", "ecos": "#D55E00",
    "fmu-container": "#000000", "C loop": "#999999",
}  # fmt: skip
MARKERS = {
    "jacobi, held": "o", "jacobi, extrapolated": "s", "gauss-seidel, held": "^", "gauss-seidel, interpolated": "v",
    "gauss-seidel, extrapolated": "D", "gauss-seidel, parabolic": "p", "implicit": "P", "adaptive": "X", "default": "*",
}  # fmt: skip
OURS = "eightpost"
QUANTITY = "error_tire_force_percent"

Line = tuple[str, str, list[tuple[float, float]]]


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the rows with full damping; one line per engine and scheme, one point per rate."""
    lines = _lines(rows)
    if not lines:
        return
    figure, axes = plt.subplots(figsize=(11.0, 6.6))
    figure.subplots_adjust(left=0.25, right=0.77, bottom=0.1, top=0.93)
    for engine, scheme, points in lines:
        size = 11 if scheme == "default" else 6
        axes.loglog(
            *zip(*points, strict=True), marker=MARKERS.get(scheme, "o"), color=COLORS.get(engine, "#56B4E9"),
            markersize=size, linewidth=1.2, alpha=0.9,
        )  # fmt: skip
    axes.axhline(0.2, color="0.6", linewidth=0.8, linestyle="--")
    axes.set_xlabel("computing time per second of simulation [ms]")
    axes.set_ylabel("")
    title = "Error of tire force [% of its standard deviation] against cost, all damping in the shocks"
    axes.set_title(title, fontsize=11)
    axes.grid(visible=True, which="major", alpha=0.3)
    _label(axes, [line for line in lines if line[0] == OURS], left=True)
    _label(axes, [line for line in lines if line[0] != OURS], left=False)
    axes.tick_params(axis="y", direction="in", pad=-30, labelsize=8)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _lines(rows: Sequence[Row]) -> list[Line]:
    usable = [
        row
        for row in rows
        if row["damping"] == "full" and None not in (row[QUANTITY], row["us_per_step"]) and row[QUANTITY] > 0.0
    ]
    key = _key
    return [
        (engine, scheme, [(1e-3 * row["rate_hz"] * row["us_per_step"], row[QUANTITY]) for row in group])
        for (engine, scheme), group in groupby(sorted(usable, key=lambda row: (key(row), row["rate_hz"])), key=key)
    ]


def _key(row: Row) -> tuple[str, str]:
    return row["engine"], "adaptive" if row["scheme"].startswith("adaptive") else row["scheme"]


def _label(axes: Any, lines: Sequence[Line], *, left: bool) -> None:
    """Draw names next to the axes at the height of a line's outer end, without overlaps, with thin lines to them."""
    low, high = (log10(limit) for limit in axes.get_ylim())
    ends = [(engine, scheme, min(points) if left else max(points)) for engine, scheme, points in lines]
    ends.sort(key=lambda end: (end[2][1], end[2][0] if left else -end[2][0]))  # avoid crossing lines
    wanted = [(log10(point[1]) - low) / (high - low) for *_, point in ends]
    for (engine, scheme, point), height in zip(ends, _apart(wanted, 0.052), strict=True):
        axes.annotate(
            f"{engine}: {scheme}", xy=point, xytext=(-0.02 if left else 1.02, height), textcoords="axes fraction",
            ha="right" if left else "left", va="center", fontsize=9, color=COLORS.get(engine, "#56B4E9"),
            arrowprops={
                "arrowstyle": "-", "color": COLORS.get(engine, "#56B4E9"), "linewidth": 0.5, "alpha": 0.6,
                "relpos": (1.0 if left else 0.0, 0.5),
            },
        )  # fmt: skip


def _apart(heights: Sequence[float], gap: float) -> list[float]:
    """Return sorted heights at least `gap` apart, within the axes if they fit."""
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + gap) if placed else max(height, 0.02))
    excess = max(0.0, placed[-1] - 0.98) if placed else 0.0
    top = 1.0 + gap
    for k in range(len(placed) - 1, -1, -1):
        placed[k] = min(placed[k], top - gap) if excess else placed[k]
        top = placed[k]
    return placed
