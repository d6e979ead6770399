"""The page of a study, with what was chosen from it so far."""

from __future__ import annotations

from pathlib import Path

from cosim.study.report import write_study_report
from cosim.study.result import StudyResult
from cosim.study.robust_table import read_spreads
from cosim.study.selection_file import read_selection
from cosim.study.trace import traces

#: Names in a study's folder.
RESULTS, SELECTION, SPREADS = "results.parquet", "selection.csv", "robust.parquet"


def write_page(result: StudyResult, folder: Path, *, trace_command: str = "") -> Path:
    """Write the report of a study with the selection and the spreads that its folder has; return the page.

    Traces are of the best, the worst, the baseline and the selected setups, which are run once more.
    """
    selection = read_selection(folder / SELECTION, result) if (folder / SELECTION).is_file() else None
    spreads = read_spreads(folder / SPREADS) if (folder / SPREADS).is_file() else ()
    ranked = result.setups[result.ranking()].tolist()
    baseline = result.study.baseline_setup
    asked = [*ranked[:1], *ranked[-1:], *([] if baseline is None else [baseline.index])]
    asked += [selected.setup.index for selected in selection.chosen] if selection else []
    done = set(result.setups[result.done].tolist())
    recorded = traces(result, dict.fromkeys(index for index in asked if index in done))
    paths = write_study_report(
        result, folder, traces=recorded, selection=selection, bands=spreads, trace_command=trace_command
    )
    return paths.page
