"""Files, tables and plots of comparisons and of robustness."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from cosim.study.choice.compare import Comparison, usable_deviation
from cosim.study.choice.robust import Spread, Uncertain
from cosim.study.result import StudyResult
from eightpost import __version__, units
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, json_content, read_text
from eightpost.signals.parquet_file import read_table
from eightpost.toml_document import parse_model
from eightpost.verdict import Verdict, is_intact, sealed

if TYPE_CHECKING:
    from eightpost.report.pictures import Axes

# ==== Comparisons ====================================================================================================

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
    from eightpost.report.pictures import new_figure, panels_of, save  # noqa: PLC0415 -- matplotlib takes long to load

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


# ==== Robustness =====================================================================================================

# ---- File of the spreads of a study's measures, including all draws -------------------------------------------------

_COLUMNS = pa.schema(
    [
        ("measure", pa.string()),
        ("setups", pa.list_(pa.int64())),
        ("values", pa.list_(pa.float64())),
        ("draws", pa.list_(pa.list_(pa.float64()))),
        ("run_to_run", pa.float64()),
        ("runs", pa.int64()),
    ]
)


_STUDY = b"study"


def write_spreads(spreads: Sequence[Spread], path: str | Path, *, digest: str) -> None:
    """Write spreads, one row per measure [SI]; an existing file is replaced only after the new one is complete.

    Args:
        spreads: Spreads of the measures.
        path: Output file.
        digest: Digest of the study.
    """
    rows = [
        {
            "measure": spread.measure,
            "setups": spread.setups.tolist(),
            "values": spread.values.tolist(),
            "draws": spread.draws.tolist(),
            "run_to_run": spread.run_to_run,
            "runs": spread.runs,
        }
        for spread in spreads
    ]
    with atomic_path(path) as temporary:
        table = pa.Table.from_pylist(rows, schema=_COLUMNS.with_metadata({_STUDY: digest.encode()}))
        pyarrow.parquet.write_table(table, temporary, compression="zstd")


def read_spreads(path: str | Path, *, digest: str) -> tuple[Spread, ...]:
    """Read a file of `write_spreads` for the study with this digest.

    Raises:
        FileFormatError: The file cannot be read, or belongs to another study.
    """
    table = read_table(path, schema=_COLUMNS, advice="run `eightpost robust` first")
    if (table.schema.metadata or {}).get(_STUDY, b"") != digest.encode():
        raise FileFormatError("belongs to another study or to other FMUs; run `eightpost robust` again", path=path)
    try:
        return tuple(_spread(row) for row in table.to_pylist())
    except MALFORMED as error:
        raise FileFormatError(f"is not a file of spreads ({error}); run `eightpost robust` again", path=path) from error


def _spread(row: Mapping[str, Any]) -> Spread:
    return Spread(
        row["measure"],
        np.array(row["setups"], dtype=np.int64),
        np.array(row["values"], dtype=np.float64),
        np.array(row["draws"], dtype=np.float64).reshape(-1, len(row["setups"])),
        row["run_to_run"],
        row["runs"],
    )


# ---- Reader of uncertainty files (TOML, docs/how_to/study_choice.md) ------------------------------------------------


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainties of a study's parts and of the rig."""

    parts: tuple[Uncertain, ...] = ()  #: Uncertain parameters with their covariance.
    #: Shock files by build; the uncertainty is read from the fit in the file.
    fits: Mapping[str, Path] = field(default_factory=dict)
    vehicles: tuple[Path, ...] = ()  #: FMUs of equivalent vehicles, such as fits of other records.
    run_to_run: Mapping[str, float] = field(default_factory=dict)  #: Standard deviation of one rig run by measure [SI].
    runs: int = 1  #: Number of rig runs of each setup that would be averaged.


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Known(_Strict):
    value: float
    deviation: float = Field(ge=0.0)
    lowest: float = -inf
    highest: float = inf


class _Part(_Strict):
    part: str
    parameters: dict[str, _Known] = Field(min_length=1)
    correlation: list[list[float]] | None = None


class _File(_Strict):
    schema_: int = Field(alias="schema")
    uncertain: list[_Part] = Field(default_factory=list)
    fits: dict[str, str] = Field(default_factory=dict)
    vehicles: list[str] = Field(default_factory=list)
    run_to_run: dict[str, float | str] = Field(default_factory=dict)
    compared: str = ""
    runs: int = Field(default=1, ge=1)


def read_uncertainty(path: str | Path, result: StudyResult) -> Uncertainty:
    """Read an uncertainty file for a study; paths in it are relative to the file.

    Raises:
        FileFormatError: The file cannot be read, or an entry is unknown, missing or invalid; the message has its line.
    """
    path = Path(path)
    text = read_text(path, advice="name an uncertainty file (docs/how_to/study_choice.md)")
    document = parse_model(_File, text, path, SCHEMA)
    try:
        return _uncertainty(document, path.parent, result)
    except InputError as error:
        raise FileFormatError(str(error), path=path) from error


def _uncertainty(document: _File, folder: Path, result: StudyResult) -> Uncertainty:
    for build in document.fits:
        if build not in result.study.bank:
            raise InputError(f"fits: there is no build {build!r}; the builds are {', '.join(result.study.bank)}")
    measured = read_run_to_run(folder / document.compared) if document.compared else {}
    return Uncertainty(
        parts=tuple(_part(entry) for entry in document.uncertain),
        fits={build: folder / file for build, file in document.fits.items()},
        vehicles=tuple(folder / file for file in document.vehicles),
        run_to_run=measured | {name: _noise(name, value, result) for name, value in document.run_to_run.items()},
        runs=document.runs,
    )


def _part(entry: _Part) -> Uncertain:
    known = list(entry.parameters.values())
    deviation = np.array([k.deviation for k in known])
    rows = np.eye(len(known)).tolist() if entry.correlation is None else entry.correlation
    if [len(row) for row in rows] != [len(known)] * len(known):
        raise InputError(
            f"{entry.part}: the correlation of {len(known)} parameters must be a matrix of {len(known)} rows and "
            "columns"
        )
    return Uncertain(
        entry.part,
        tuple(entry.parameters),
        np.array([k.value for k in known]),
        np.array(rows) * np.outer(deviation, deviation),
        np.array([k.lowest for k in known]),
        np.array([k.highest for k in known]),
    )


def _noise(name: str, value: float | str, result: StudyResult) -> float:
    """Return a run-to-run deviation in SI; numbers without a unit are in SI."""
    result.study.measure(name)
    if not isinstance(value, str):
        return value
    number, unit = units.quantity(value)
    return abs(float(units.convert(number, unit, result.unit(name))))
