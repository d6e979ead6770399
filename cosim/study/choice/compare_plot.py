"""Plot of measured and predicted levels (Fig 7.7)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cosim.study.choice.compare import Comparison
from eightpost import units
from eightpost.files import atomic_path

_PREDICTED, _MEASURED = "#1f77b4", "#d95f02"


def plot_comparisons(
    comparisons: Sequence[Comparison],
    path: str | Path,
    *,
    shown: Mapping[str, tuple[str, str]],
    selected: Mapping[str, Collection[int]] | None = None,
) -> None:
    """Draw for every measure the levels by setup with bars of two standard deviations, and measured over predicted.

    Args:
        comparisons: Comparisons of the measures.
        path: Output file, .png or .svg.
        shown: SI unit and display unit by measure.
        selected: Setups that were selected for each measure; they have filled markers, the others hollow ones.
    """
    figure = Figure(figsize=(11, 3.4 * len(comparisons) + 0.4), layout="constrained")
    panels = figure.subplots(len(comparisons), 2, squeeze=False, width_ratios=(1.3, 1.0))
    for (trend, scatter), comparison in zip(panels, comparisons, strict=True):
        si, unit = shown[comparison.measure]
        factor = units.conversion(si, unit)[0]
        own = np.isin(comparison.setups, list((selected or {}).get(comparison.measure, comparison.setups)))
        _trend(trend, comparison, factor)
        _scatter(scatter, comparison, factor, own)
        trend.set_ylabel(f"{comparison.measure} [{unit}]", fontsize=9)
        scatter.set_xlabel(f"predicted [{unit}]", fontsize=9)
        scatter.set_ylabel(f"measured [{unit}]", fontsize=9)
    panels[-1][0].set_xlabel("setup, by predicted level", fontsize=9)
    panels[0][0].legend(frameon=False, fontsize=8)
    panels[0][1].legend(frameon=False, fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _trend(axes: Axes, comparison: Comparison, factor: float) -> None:
    order = np.argsort(comparison.predicted, kind="stable")
    places = np.arange(order.size)
    axes.plot(places, factor * comparison.predicted[order], "s", color=_PREDICTED, ms=5, label="predicted")
    label = f"measured, ± 2 sigma of {'a run' if comparison.run_to_run else 'the scatter'}"
    measured, band = factor * comparison.measured[order], factor * comparison.band
    axes.errorbar(places, measured, band, fmt="o", color=_MEASURED, ms=5, capsize=3, label=label)
    axes.set_xticks(places, [str(number) for number in comparison.setups[order]], rotation=90, fontsize=7)
    axes.grid(alpha=0.3)


def _scatter(axes: Axes, comparison: Comparison, factor: float, own: NDArray[np.bool_]) -> None:
    ends = np.linspace(comparison.predicted.min(), comparison.predicted.max(), 50)
    line = comparison.line.at(ends)
    axes.plot(factor * ends, factor * line, color="black", lw=1.0, label=f"best fit, slope {comparison.line.slope:.3g}")
    for sign in (-1.0, 1.0):
        band = line + sign * comparison.band
        axes.plot(factor * ends, factor * band, "--", color="black", lw=0.8, label="± 2 sigma" if sign > 0.0 else None)
    sure = 2.0 * comparison.line.error_at(ends)
    axes.fill_between(factor * ends, factor * (line - sure), factor * (line + sure), color="black", alpha=0.12, lw=0)
    for kept, fill in ((own, "full"), (~own, "none")):
        predicted, measured = factor * comparison.predicted[kept], factor * comparison.measured[kept]
        axes.plot(predicted, measured, "o", color=_MEASURED, fillstyle=fill)
    ranks = f"Spearman {comparison.spearman:.3f}\nKendall {comparison.kendall:.3f}"
    axes.text(0.03, 0.97, ranks, transform=axes.transAxes, va="top", fontsize=8)
    axes.grid(alpha=0.3)
