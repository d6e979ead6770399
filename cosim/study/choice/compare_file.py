"""Files and plots of comparisons."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.study.choice.compare import Comparison, usable_deviation
from cosim.study.result import StudyResult
from eightpost import __version__, units
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, json_content
from eightpost.report.pictures import Axes, new_figure, panels_of, save
from eightpost.verdict import Verdict, is_intact, sealed

# ---- JSON file of the comparisons of measured with predicted levels -------------------------------------------------

#: Schema version of the files that are written.
SCHEMA = 1


def write_comparisons(
    comparisons: Sequence[Comparison], units: Mapping[str, str], path: str | Path, verdict: Verdict
) -> None:
    """Write comparisons as JSON, levels in SI.

    Args:
        comparisons: Comparisons of the measures.
        units: SI units by measure.
        path: The file.
        verdict: Verdict on all comparisons.
    """
    document = sealed({
        "schema": SCHEMA,
        "kind": "comparison",
        "tool": f"eightpost {__version__}",
        "verdict": verdict.to_json(),
        "measures": [_entry(one, units[one.measure]) for one in comparisons],
    })  # fmt: skip
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_and_plot(
    comparisons: Sequence[Comparison],
    result: StudyResult,
    folder: Path,
    verdict: Verdict,
    selected: Mapping[str, Collection[int]],
) -> Path:
    """Write comparison.json, and comparison.png with the measures of the selection, or else of the objective.

    Args:
        comparisons: Comparisons of the measures.
        result: Result of the study.
        folder: Output folder.
        verdict: Verdict on all comparisons.
        selected: Setups that were selected for each measure; empty if there is no selection.

    Returns:
        The picture.
    """
    write_comparisons(comparisons, result.provenance.measure_units, folder / "comparison.json", verdict)
    first = selected or dict.fromkeys(term.measure for term in result.study.objective)
    drawn = [one for one in comparisons if one.measure in first] or list(comparisons)
    shown = {one.measure: (result.unit(one.measure), result.display(one.measure)) for one in comparisons}
    _plot_comparisons(drawn, folder / "comparison.png", shown=shown, selected=selected)
    return folder / "comparison.png"


def read_run_to_run(path: str | Path) -> dict[str, float]:
    """Return the standard deviation of one rig run by measure [SI], as a comparison found it from repeated runs.

    It is increased for the number of repeats; see `usable_deviation`.

    Raises:
        FileFormatError: The file is not a comparison, was edited after it, or no setup was run twice.
    """
    document = json_content(path, advice="`eightpost compare --measured` writes it")
    try:
        repeats = [(entry, sum(runs - 1 for runs in entry["runs"])) for entry in document["measures"]]
        deviations = {
            str(entry["measure"]): usable_deviation(float(entry["run_to_run"]), freedom) if freedom else 0.0
            for entry, freedom in repeats
        }
    except MALFORMED as error:
        raise FileFormatError(f"is not a comparison of a study with the rig ({error!r})", path=path) from error
    if not is_intact(document):
        raise FileFormatError("was edited after the comparison; run `eightpost compare --measured` again", path=path)
    if not any(deviations.values()):
        raise FileFormatError("contains no run-to-run deviation, because no setup was run twice on the rig", path=path)
    return deviations


def _entry(comparison: Comparison, unit: str) -> dict[str, Any]:
    return {
        "measure": comparison.measure,
        "unit": unit,
        "setups": comparison.setups.tolist(),
        "runs": comparison.runs.tolist(),
        "predicted": comparison.predicted.tolist(),
        "measured": comparison.measured.tolist(),
        "run_to_run": comparison.run_to_run,
        "spearman": comparison.spearman,
        "spearman_attainable": comparison.attainable,
        "kendall": comparison.kendall,
        "slope": comparison.line.slope,
        "slope_interval_95": list(comparison.line.interval()),
        "intercept": comparison.line.intercept,
        "scatter": comparison.line.scatter,
        "band": comparison.band,
        "within_band": int(comparison.within.sum()),
        "interval_95": [[None if np.isnan(end) else end for end in row] for row in comparison.interval.tolist()],
        "within_interval": int(comparison.inside.sum()),
        "judged": comparison.judged,
        "level_error_percent": comparison.level_error,
        "bias_percent": comparison.bias,
    }


# ---- Plot of measured and predicted levels (Fig 7.7) ----------------------------------------------------------------

_PREDICTED, _MEASURED = "#1f77b4", "#d95f02"


def _plot_comparisons(
    comparisons: Sequence[Comparison],
    path: str | Path,
    *,
    shown: Mapping[str, tuple[str, str]],
    selected: Mapping[str, Collection[int]],
) -> None:
    """Draw for every measure the levels by setup with bars of two standard deviations, and measured over predicted.

    Setups that were `selected` for a measure have filled markers, the others hollow ones; `shown` are the SI unit and
    the display unit by measure.
    """
    figure = new_figure(11, 3.4 * len(comparisons) + 0.4)
    panels = panels_of(figure, 2 * len(comparisons), 2, width_ratios=(1.3, 1.0))
    for trend, scatter, comparison in zip(panels[::2], panels[1::2], comparisons, strict=True):
        si, unit = shown[comparison.measure]
        factor = units.conversion(si, unit)[0]
        own = np.isin(comparison.setups, list(selected.get(comparison.measure, comparison.setups)))
        _trend(trend, comparison, factor)
        _scatter(scatter, comparison, factor, own)
        trend.set_ylabel(f"{comparison.measure} [{unit}]", fontsize=9)
        scatter.set_xlabel(f"predicted [{unit}]", fontsize=9)
        scatter.set_ylabel(f"measured [{unit}]", fontsize=9)
    panels[-2].set_xlabel("setup, by predicted level", fontsize=9)
    for panel in panels[:2]:
        panel.legend(frameon=False, fontsize=8)
    save(figure, path)


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
