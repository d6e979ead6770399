"""Plot for docs/explanation/coupling.md: stated errors over true ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.honesty.summary import SMALL, compared, worst

Row = dict[str, Any]

_LARGEST = 1e3


def draw(rows: Sequence[Row], path: Path) -> None:
    """Plot the distribution of stated over true, and stated against true errors, of the worst decisive channels.

    Args:
        rows: Rows of a campaign.
        path: Path of the plot.
    """
    ended = [row for row in compared(rows) if worst(row).stated is not None]
    stated = np.array([min(worst(row).stated or 0.0, _LARGEST) for row in ended])
    true = np.array([worst(row).true for row in ended])
    accepted = np.array([row["acceptable"] for row in ended], dtype=bool)
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _scatter(left, true, stated, accepted)
    counted = true > SMALL
    _distribution(right, stated[counted] / true[counted])
    figure.savefig(path, dpi=120)


def _scatter(axes: Any, true: Any, stated: Any, accepted: Any) -> None:
    ends = np.array([1e-3, 1e3])
    for factor, style in ((1.0, "-"), (0.5, "--"), (5.0, "--")):
        axes.plot(ends, factor * ends, style, color="0.6", lw=0.8)
    for chosen, label, color in ((accepted, "acceptable", "tab:blue"), (~accepted, "not acceptable", "tab:red")):
        axes.plot(np.maximum(true[chosen], 1e-3), np.maximum(stated[chosen], 1e-3), ".", color=color, label=label)
    axes.axvline(SMALL, color="0.6", lw=0.8, ls=":")
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel="true error [%]", ylabel="stated error [%]")
    axes.set_title("worst bond or tire-force channel of each system", fontsize=10)
    axes.legend(loc="lower right", fontsize=8)


def _distribution(axes: Any, ratios: Any) -> None:
    ordered = np.sort(np.clip(ratios, 1e-2, 1e2))
    axes.step(ordered, 100.0 * np.arange(1, ordered.size + 1) / max(1, ordered.size), where="post")
    for place in (0.5, 1.0, 5.0):
        axes.axvline(place, color="0.6", lw=0.8, ls="-" if place == 1.0 else "--")
    axes.set(xscale="log", xlim=(1e-2, 1e2), ylim=(0.0, 100.0), xlabel="stated / true error", ylabel="systems [%]")
    axes.set_title(f"{ordered.size} systems with a true error above {SMALL:g} %", fontsize=10)
    axes.grid(True, which="major", color="0.9")
