"""Certainty of a study, as the commands compute and print it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost.app.progress import bar
from eightpost.errors import FileFormatError

if TYPE_CHECKING:
    from cosim.study.certainty import Certainty
    from cosim.study.certainty.assess import Knowledge
    from cosim.study.result import StudyResult
    from cosim.study.running.workers import Workers


def assess(
    console: Console, result: StudyResult, folder: Path, workers: Workers, *, criterion: str | None = None
) -> Certainty:
    """Compute the certainty of a study from what its models state, and write it into the study's folder.

    Rig runs that an earlier certainty of the same study contains are kept.
    """
    from cosim.study.certainty import write_certainty
    from cosim.study.certainty.assess import Knowledge, certainty_of
    from cosim.study.certainty.effects import effects_of, stated_parameters
    from cosim.study.folder import CERTAINTY

    parameters, unstated, notes = stated_parameters(result)
    with bar(console, "uncertain parameters", 1) as advance:
        effects = effects_of(result, parameters, folder, workers, advance)
    known = Knowledge(effects, unstated, measured_noise(folder), notes=notes)
    with console.status("computing how sure the choice is"):
        found = certainty_of(result, with_runs(known, result, folder), criterion=criterion)
    write_certainty(found, folder / CERTAINTY)
    return found


def measured_noise(folder: Path) -> Mapping[str, float]:
    """Return the run-to-run deviations [SI] that `eightpost compare --measured` found; empty without a comparison."""
    from cosim.study.choice.compare_file import read_run_to_run

    path = folder / "compared" / "comparison.json"
    try:
        return read_run_to_run(path) if path.is_file() else {}
    except FileFormatError:  # no setup was run twice
        return {}


def with_runs(known: Knowledge, result: StudyResult, folder: Path) -> Knowledge:
    """Return what is known with the rig runs of the certainty in a study's folder, if it is of this study."""
    from cosim.study.certainty.assess import Knowledge

    earlier = earlier_certainty(result, folder)
    if earlier is None or not earlier.runs:
        return known
    noise = Knowledge.of(earlier).run_to_run
    return replace(known, runs=earlier.runs, run_to_run={**noise, **known.run_to_run})


def earlier_certainty(result: StudyResult, folder: Path) -> Certainty | None:
    """Return the certainty in a study's folder; None if it does not exist or belongs to another study."""
    from cosim.study.certainty import read_certainty
    from cosim.study.folder import CERTAINTY

    try:
        path = folder / CERTAINTY
        return read_certainty(path, digest=result.provenance.digest) if path.is_file() else None
    except FileFormatError:
        return None


def show_certainty(console: Console, result: StudyResult, certainty: Certainty) -> None:
    """Print the summary of a certainty."""
    from cosim.study.certainty.summary import summary_lines

    for place, line in enumerate(summary_lines(result, certainty)):
        style = "bold" if place == 0 else ""
        console.print(escape(line), style=style, highlight=False, soft_wrap=True)
