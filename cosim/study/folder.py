"""Folder of a study: the names of its files, what was chosen so far, and its page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cosim.study.choice.certainty import Certainty, read_certainty
from cosim.study.choice.robust import Spread, read_spreads
from cosim.study.choice.selection import Selection, read_selection
from cosim.study.page import write_study_report
from cosim.study.running.evaluator import traces
from cosim.study.sheet import AimPage, copy_shock_pages, shock_curves
from cosim.study.table import StudyResult
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, json_content
from eightpost.verdict import is_intact

#: File names in the folder of a study.
RESULTS, SELECTION, SPREADS = "results.parquet", "selection.csv", "robust.parquet"

#: Certainty of the study, and the one before the last `eightpost confirm`.
CERTAINTY, PREVIOUS, REPLACED = "certainty.parquet", "certainty.previous.parquet", "certainty.replaced.parquet"


#: Content and page of the curves to aim at, which `eightpost shapes` writes.
AIM, AIM_PAGE = "shapes.json", "shapes.html"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Selection and spreads of a study so far."""

    selection: Selection | None  #: Setups to confirm on the rig; None without a selection.
    spreads: tuple[Spread, ...]  #: Uncertainty of the measures of the leading setups.
    notes: tuple[str, ...]  #: Sentences about files in the folder that belong to another study.
    certainty: Certainty | None = None  #: Certainty of the study; None if the folder has none.


def chosen_so_far(result: StudyResult, folder: Path) -> Chosen:
    """Return the selection, the spreads and the certainty in a study's folder.

    Files of another study are named in the notes.
    """
    selection, spreads, certainty, notes = None, tuple[Spread, ...](), None, list[str]()
    try:
        if (folder / SELECTION).is_file():
            selection = read_selection(folder / SELECTION, result)
    except FileFormatError as error:
        notes.append(f"left out of the page: {error}")
    try:
        if (folder / SPREADS).is_file():
            spreads = read_spreads(folder / SPREADS, digest=result.provenance.digest)
    except FileFormatError as error:
        notes.append(f"left out of the page: {error}")
    try:
        if (folder / CERTAINTY).is_file():
            certainty = read_certainty(folder / CERTAINTY, digest=result.provenance.digest)
    except FileFormatError as error:
        notes.append(f"left out of the page: {error}")
    return Chosen(selection, spreads, tuple(notes), certainty)


def aim_so_far(result: StudyResult, folder: Path) -> AimPage | None:
    """Return the page of the curves to aim at in a study's folder; None if it has none of this study, unedited."""
    if not (folder / AIM_PAGE).is_file():
        return None
    try:
        found = json_content(folder / AIM, advice="run eightpost shapes again")
        if found["digest"] != result.provenance.digest or not is_intact(found):
            return None
        gain, best = found["gain"], abs(found["objective"]["best_of_bank"])
        return AimPage(AIM_PAGE, gain["predicted"] / best, gain["assured"] / best, bool(gain["includes_car"]))
    except (FileFormatError, *MALFORMED):
        return None


def page_of(result: StudyResult, folder: Path, chosen: Chosen, *, trace_command: str = "") -> Path:
    """Write the report of a study and return its page.

    The page has traces of the best, the worst, the baseline and the selected setups, which are run again for them.
    """
    ranked = result.setups[result.ranking()].tolist()
    baseline = result.study.baseline_setup
    traced = [*ranked[:1], *ranked[-1:], *([] if baseline is None else [baseline.index])]
    traced += [selected.setup.index for selected in chosen.selection.chosen] if chosen.selection else []
    done = set(result.setups[result.done].tolist())
    return write_study_report(
        result,
        folder,
        traces=traces(result, dict.fromkeys(index for index in traced if index in done)),
        selection=chosen.selection,
        certainty=chosen.certainty,
        curves=shock_curves(result.study),
        shock_pages=copy_shock_pages(result.study, folder),
        aim=aim_so_far(result, folder),
        trace_command=trace_command,
    ).page
