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
        "measures": [_entry(found, units[found.measure]) for found in comparisons],
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
        found = {str(entry["measure"]): float(entry["run_to_run"]) for entry in document["measures"]}
    except MALFORMED as error:
        raise FileFormatError(f"is not a comparison of a study with the rig ({error!r})", path=path) from error
    if not any(found.values()):
        raise FileFormatError("contains no run-to-run deviation, because no setup was run twice on the rig", path=path)
    return found


def _entry(found: Comparison, unit: str) -> dict[str, Any]:
    return {
        "measure": found.measure,
        "unit": unit,
        "setups": found.setups.tolist(),
        "runs": found.runs.tolist(),
        "predicted": found.predicted.tolist(),
        "measured": found.measured.tolist(),
        "run_to_run": found.run_to_run,
        "spearman": found.spearman,
        "spearman_attainable": found.attainable,
        "kendall": found.kendall,
        "slope": found.line.slope,
        "slope_interval_95": list(found.line.interval()),
        "intercept": found.line.intercept,
        "scatter": found.line.scatter,
        "band": found.band,
        "within_band": int(found.within.sum()),
        "level_error_percent": found.level_error,
        "bias_percent": found.bias,
    }
