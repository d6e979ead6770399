"""Certainty of a study, as the commands compute and print it."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from eightpost.app.progress import bar
from eightpost.errors import FileFormatError
from eightpost.outputs import replacing

if TYPE_CHECKING:
    from cosim.study.choice.assess import Knowledge
    from cosim.study.choice.certainty import Certainty
    from cosim.study.running.workers import Workers
    from cosim.study.table import StudyResult


def assess(
    console: Console, result: StudyResult, folder: Path, workers: Workers, *, criterion: str | None = None
) -> Certainty:
    """Compute the certainty of a study from what its models state, and write it into the study's folder.

    Rig runs that an earlier certainty of the same study contains are kept.
    """
    from cosim.study.choice.assess import Knowledge, certainty_of
    from cosim.study.choice.certainty import write_certainty
    from cosim.study.choice.sources import effects_of, stated_parameters
    from cosim.study.folder import CERTAINTY

    parameters, unstated, notes = stated_parameters(result)
    with bar(console, "uncertain parameters", 1) as advance:
        effects = effects_of(result, parameters, folder, workers, advance)
    known = Knowledge(effects, unstated, measured_noise(folder), notes=notes)
    with console.status("computing how sure the choice is"):
        found = certainty_of(result, with_runs(console, known, result, folder), criterion=criterion)
    with replacing(folder / CERTAINTY):
        write_certainty(found, folder / CERTAINTY)
    return found


def measured_noise(folder: Path) -> Mapping[str, float]:
    """Return the run-to-run deviations [SI] that `eightpost compare --measured` found; empty without a comparison."""
    from cosim.study.choice.compare import read_run_to_run

    path = folder / "compared" / "comparison.json"
    try:
        return read_run_to_run(path) if path.is_file() else {}
    except FileFormatError:  # no setup was run twice, or the file was edited
        return {}


def with_runs(console: Console, known: Knowledge, result: StudyResult, folder: Path) -> Knowledge:
    """Return what is known with the rig runs of the certainty in a study's folder, if it is of this study.

    A certainty that is damaged or of another study is about to be replaced, so a copy is kept and named.
    """
    from cosim.study.choice.assess import Knowledge
    from cosim.study.folder import CERTAINTY, REPLACED

    try:
        earlier = earlier_certainty(result, folder)
    except FileFormatError as error:
        earlier, why = None, str(error)
    else:
        why = f"{folder / CERTAINTY} belongs to another study or to other FMUs"
    if earlier is None and (folder / CERTAINTY).is_file():
        shutil.copyfile(folder / CERTAINTY, folder / REPLACED)
        console.print(f"[yellow]note[/] {escape(why)}; its rig runs are not taken over: confirm them again. It is kept "
                      f"as {REPLACED}", highlight=False, soft_wrap=True)  # fmt: skip
    if earlier is None or not earlier.runs:
        return known
    noise = Knowledge.of(earlier).run_to_run
    return replace(known, runs=earlier.runs, run_to_run={**noise, **known.run_to_run})


def earlier_certainty(result: StudyResult, folder: Path) -> Certainty | None:
    """Return the certainty in a study's folder; None if it does not exist or belongs to another study.

    Raises:
        FileFormatError: The file is damaged.
    """
    from cosim.study.choice.certainty import read_certainty
    from cosim.study.folder import CERTAINTY, PREVIOUS

    path = folder / CERTAINTY
    if not path.is_file():
        return None
    try:
        found = read_certainty(path)
    except FileFormatError as error:
        previous = f"take {PREVIOUS} instead, or " if (folder / PREVIOUS).is_file() else ""
        advice = f"{previous}run `eightpost study` again and confirm the rig runs again"
        raise FileFormatError(f"{error}; or {advice}") from error
    return found if found.digest == result.provenance.digest else None


def show_certainty(console: Console, result: StudyResult, certainty: Certainty) -> None:
    """Print the summary of a certainty."""
    from cosim.study.choice.certainty import summary_lines

    for place, line in enumerate(summary_lines(result, certainty)):
        style = "bold" if place == 0 else ""
        console.print(escape(line), style=style, highlight=False, soft_wrap=True)
