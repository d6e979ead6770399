"""Picture of the error over the coupling rate for every scheme, with slopes of the orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log10
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from benchmarks.picture import _apart

#: Colours of Okabe and Ito, one per method; line styles, one per kind of values.
COLORS = {"Jacobi": "#D55E00", "Gauss-Seidel": "#0072B2", "Implicit": "#000000"}
STYLES = {"held": "-", "interpolated": ":", "extrapolated": "--", "parabolic": "-.", "": "-"}
TITLES = ("shock velocity", "tire force")

Errors = Mapping[str, Sequence[tuple[float | None, float | None]]]


def draw(found: Errors, rates: Sequence[float], path: Path) -> None:
    """Draw both quantities [%] by scheme; diverged runs are omitted."""
    figure, both = plt.subplots(1, 2, figsize=(12.0, 5.4), sharey=True)
    figure.subplots_adjust(left=0.07, right=0.83, bottom=0.11, top=0.9, wspace=0.04)
    lowest = min(value for pairs in found.values() for pair in pairs for value in pair if value is not None)
    for k, axes in enumerate(both):
        for scheme, pairs in found.items():
            points = [(rate, pair[k]) for rate, pair in zip(rates, pairs, strict=True) if pair[k] is not None]
            axes.loglog(*zip(*points, strict=True), marker="o", markersize=4, linewidth=1.6, **_look(scheme))
        for order in (1, 2, 3):
            _slope(axes, order)
        _dress(axes, rates, f"{TITLES[k]}: error in % of its standard deviation", lowest)
    _names(both[1], found)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _look(scheme: str) -> dict[str, Any]:
    method, _, values = scheme.partition(", ")
    return {"color": COLORS[method], "linestyle": STYLES[values]}


def _dress(axes: Any, rates: Sequence[float], title: str, lowest: float) -> None:
    axes.set_title(title, fontsize=11)
    axes.set_xlabel("coupling rate [Hz]")
    axes.set_xticks(rates, [f"{rate:g}" for rate in rates])
    axes.minorticks_off()
    axes.set_ylim(0.7 * lowest, 500.0)
    axes.text(125.0, 330.0, "Jacobi diverges at 125 Hz", fontsize=9, color=COLORS["Jacobi"], va="center")
    axes.set_yticks([0.001, 0.01, 0.1, 1.0, 10.0, 100.0], ["0.001 %", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"])
    axes.grid(visible=True, alpha=0.3)


def _slope(axes: Any, order: int) -> None:
    """Draw a short line with the slope of an order, and its label."""
    first, top = {1: (1400.0, 70.0), 2: (140.0, 0.03), 3: (140.0, 0.009)}[order]
    ends = (first, 2.0 * first), (top, top / 2.0**order)
    axes.loglog(*ends, color="0.35", linewidth=1.0)
    axes.text(2.1 * first, ends[1][1], f"order {order}", fontsize=9, color="0.35", va="center")


def _names(axes: Any, found: Errors) -> None:
    """Draw names at the right end of each line, without overlaps."""
    low, high = (log10(limit) for limit in axes.get_ylim())
    ends = sorted((pairs[-1][1], scheme) for scheme, pairs in found.items() if pairs[-1][1] is not None)
    wanted = [(log10(value) - low) / (high - low) for value, _ in ends]
    for (value, scheme), height in zip(ends, _apart(wanted, 0.05), strict=True):
        axes.annotate(
            scheme, xy=(4000.0, value), xytext=(1.03, height), textcoords="axes fraction", va="center", fontsize=9.5,
            color=_look(scheme)["color"],
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "0.6", "relpos": (0.0, 0.5)},
        )  # fmt: skip
