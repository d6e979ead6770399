"""Comparison of batches with the FMUs on random setups of a study; a study uses batches only if they agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cosim.study.machine.library import instruction_set
from cosim.study.machine.reasons import NotInBatchError
from cosim.study.measures import Measure
from cosim.study.running.batches import EXACT, Batches, BatchRun
from cosim.study.running.evaluator import Coupling, Evaluator
from cosim.study.setup import Setup
from cosim.study.statistics import Filtered
from cosim.study.study import Drive, Study
from eightpost.errors import EightpostError

#: Least and largest number of random setups that are compared, number among which they are searched, and seed.
_FEWEST, _MOST, _SEARCHED, _SEED = 5, 24, 500, 60221

#: Largest difference between batch and FMUs, relative to a measure's scale.
LARGEST_DIFFERENCE = 1e-12


def with_batch(evaluator: Evaluator, coupling: Coupling) -> Coupling:
    """Return a coupling with batches if the study can run in them and they agree with the FMUs; a note says which.

    Args:
        evaluator: Evaluator of the study.
        coupling: Coupling that was chosen.
    """
    try:
        batches = Batches(evaluator, coupling.scheme, coupling.step, EXACT)
    except (NotInBatchError, EightpostError) as reason:
        return _with_note(coupling, f"every setup runs through the FMUs: {reason}")
    setups = random_setups(evaluator.study, batches)
    worst, compared = largest_difference(evaluator, coupling, batches, setups)
    if not compared:
        return _with_note(coupling, "every setup runs through the FMUs: no random setup could be compared with a batch")
    builds = {build for setup in compared for build in setup.builds.values()}
    allowed = {build for choice in evaluator.study.corners.values() for build in choice}
    found = (
        f"largest difference of a measure from the FMUs {worst:.1e} of its scale, on {len(compared)} random setups "
        f"with {len(builds)} of {len(allowed)} builds"
    )
    if not worst <= LARGEST_DIFFERENCE:
        note = f"every setup runs through the FMUs: the batch does not agree with them, {found}"
        return replace(_with_note(coupling, note), batch_difference=worst if np.isfinite(worst) else None)
    width = instruction_set() or "the instructions of every processor"
    note = f"setups run in batches of {batches.lanes} ({width}); {found}"
    if batches.left_out:
        note += f"; setups with these builds run through the FMUs: {'; '.join(batches.left_out)}"
    return replace(_with_note(coupling, note), batch=EXACT, batch_difference=worst)


def random_setups(study: Study, batches: Batches) -> list[Setup]:
    """Return random setups of a study that batches can run; they are the same for every call.

    They are the first ones, and of the others those with a build that none before them has, so that all builds of a
    bank of common size are compared.
    """
    space = study.space
    chosen = np.random.default_rng(_SEED).choice(space.indices, min(_SEARCHED, len(space)), replace=False)
    found: list[Setup] = []
    compared: set[str] = set()
    for setup in filter(batches.has, (space.setup(int(index)) for index in chosen)):
        builds = set(setup.builds.values())
        if len(found) < _FEWEST or not builds <= compared:
            found.append(setup)
            compared |= builds
    return found[:_MOST]


def largest_difference(
    evaluator: Evaluator, coupling: Coupling, batches: Batches, setups: Sequence[Setup]
) -> tuple[float, list[Setup]]:
    """Return the largest difference of a measure, relative to its scale (NaN if one is), and the setups compared.

    Setups that the FMUs refuse are not compared; one that only the batch does not finish makes no difference, because
    the FMUs run it.
    """
    worst, compared = 0.0, list[Setup]()
    for setup, runs, _ in batches.runs(setups):
        if runs is None:
            continue
        try:
            apart = [_apart(evaluator, setup, drive, coupling, runs[drive.name]) for drive in evaluator.study.drives]
        except EightpostError:
            continue
        worst = float(np.max([worst, *apart]))
        compared.append(setup)
    return worst, compared


def _apart(evaluator: Evaluator, setup: Setup, drive: Drive, coupling: Coupling, found: BatchRun) -> float:
    run = Filtered(evaluator.run(setup, drive, coupling).series)
    settling, worst = evaluator.study.settling, 0.0
    for measure in evaluator.study.measures_of(drive):
        value = measure.drawn_from(run, start=settling)
        apart = abs(found.values[measure.name] - value) / max(abs(value), _scale(measure, run, settling), 1e-300)
        worst = apart if apart > worst or np.isnan(apart) else worst
    return worst


def _scale(measure: Measure, run: Filtered, settling: float) -> float:
    """Return the size of the signals of a measure that is a mean or a sum of them, which may cancel; else 0."""
    if measure.function or measure.statistic not in ("mean", "work"):
        return 0.0
    rows = measure.signals(run, start=settling)
    if measure.statistic == "work":
        return float(np.abs(rows[0] * rows[1]).sum() * run.series.duration / (len(run.series) - 1))
    return float(np.sqrt(np.mean(rows**2)))


def _with_note(coupling: Coupling, note: str) -> Coupling:
    return replace(coupling, notes=(*coupling.notes, note))
