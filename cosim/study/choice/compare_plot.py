"""Plot of measured and predicted levels (Fig 7.7)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
    for (trend, scatter), found in zip(panels, comparisons, strict=True):
        si, unit = shown[found.measure]
        factor = units.conversion(si, unit)[0]
        own = np.isin(found.setups, list((selected or {}).get(found.measure, found.setups)))
        _trend(trend, found, factor)
        _scatter(scatter, found, factor, own)
        trend.set_ylabel(f"{found.measure} [{unit}]", fontsize=9)
        scatter.set_xlabel(f"predicted [{unit}]", fontsize=9)
        scatter.set_ylabel(f"measured [{unit}]", fontsize=9)
    panels[-1][0].set_xlabel("setup, by predicted level", fontsize=9)
    panels[0][0].legend(frameon=False, fontsize=8)
    panels[0][1].legend(frameon=False, fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _trend(axes: Axes, found: Comparison, factor: float) -> None:
    order = np.argsort(found.predicted, kind="stable")
    places = np.arange(order.size)
    axes.plot(places, factor * found.predicted[order], "s", color=_PREDICTED, ms=5, label="predicted")
    label = f"measured, ± 2 sigma of {'a run' if found.run_to_run else 'the scatter'}"
    measured, band = factor * found.measured[order], factor * found.band
    axes.errorbar(places, measured, band, fmt="o", color=_MEASURED, ms=5, capsize=3, label=label)
    axes.set_xticks(places, [str(number) for number in found.setups[order]], rotation=90, fontsize=7)
    axes.grid(alpha=0.3)


def _scatter(axes: Axes, found: Comparison, factor: float, own: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> None:
    ends = np.linspace(found.predicted.min(), found.predicted.max(), 50)
    line = found.line.at(ends)
    axes.plot(factor * ends, factor * line, color="black", lw=1.0, label=f"best fit, slope {found.line.slope:.3g}")
    for sign in (-1.0, 1.0):
        band = line + sign * found.band
        axes.plot(factor * ends, factor * band, "--", color="black", lw=0.8, label="± 2 sigma" if sign > 0.0 else None)
    sure = 2.0 * found.line.error_at(ends)
    axes.fill_between(factor * ends, factor * (line - sure), factor * (line + sure), color="black", alpha=0.12, lw=0)
    for kept, fill in ((own, "full"), (~own, "none")):
        axes.plot(factor * found.predicted[kept], factor * found.measured[kept], "o", color=_MEASURED, fillstyle=fill)
    axes.text(0.03, 0.97, f"Spearman {found.spearman:.3f}\nKendall {found.kendall:.3f}", transform=axes.transAxes,
              va="top", fontsize=8)  # fmt: skip
    axes.grid(alpha=0.3)
