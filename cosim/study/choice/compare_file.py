"""JSON file of the comparisons of measured with predicted levels."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.study.choice.compare import Comparison
from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, json_content
from eightpost.verdict import Verdict

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
    document = {
        "schema": SCHEMA,
        "kind": "comparison",
        "tool": f"eightpost {__version__}",
        "verdict": verdict.to_json(),
        "measures": [_entry(one, units[one.measure]) for one in comparisons],
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_run_to_run(path: str | Path) -> dict[str, float]:
    """Return the standard deviation of one rig run by measure [SI], as a comparison found it from repeated runs.

    Raises:
        FileFormatError: The file is not a comparison, or no setup was run twice.
    """
    document = json_content(path, advice="`eightpost compare --measured` writes it")
    try:
        deviations = {str(entry["measure"]): float(entry["run_to_run"]) for entry in document["measures"]}
    except MALFORMED as error:
        raise FileFormatError(f"is not a comparison of a study with the rig ({error!r})", path=path) from error
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
        "level_error_percent": comparison.level_error,
        "bias_percent": comparison.bias,
    }
