"""Plot of response measures of several runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.study.measures import Measure
from eightpost.report.pictures import COLORS, Figure, new_figure, save
from eightpost.signals import TimeSeries


def plot_measures(
    runs: Mapping[str, TimeSeries], measures: Sequence[Measure], path: str | Path, *, title: str = "Response measures"
) -> None:
    """Plot each measure's change from the first run to the others in percent; measures of zero are omitted."""
    save(changes(runs, measures, title=title), path)


def changes(runs: Mapping[str, TimeSeries], measures: Sequence[Measure], *, title: str = "Response measures") -> Figure:
    """Return the figure of `plot_measures`."""
    labels = list(runs)
    baseline = runs[labels[0]]
    kept = [m for m in measures if m.statistic == "rms" and m.of(baseline) > 0.0]
    figure = new_figure(9, 0.33 * len(kept) + 1.6)
    axes = figure.subplots()
    positions = np.arange(len(kept))
    height = 0.8 / max(1, len(labels) - 1)
    for k, label in enumerate(labels[1:]):
        change = [100.0 * (m.of(runs[label]) / m.of(baseline) - 1.0) for m in kept]
        axes.barh(positions + k * height, change, height=0.9 * height, color=COLORS[(1 + k) % len(COLORS)], label=label)
    axes.set_yticks(positions + 0.4 - height / 2, [m.name for m in kept])
    axes.invert_yaxis()
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_xlabel(f"change from {labels[0]} [%]")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(frameon=False)
    figure.suptitle(title)
    return figure
