"""Choice of the machine's step for a study, and its comparison with the FMUs on a few setups."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from cosim.session.result import difference
from cosim.session.run import run
from cosim.study.running.batches import Batches, BatchRun
from cosim.study.running.choose_coupling import AIM, candidates, choose_coupling, finer, random_indices, random_setups
from cosim.study.running.error_model import Pilot, fit_error_model
from cosim.study.running.evaluator import Check, Coupling, Evaluator, MachineCoupling
from cosim.study.study import Setup
from cosim.systems.algorithm import Automatic
from eightpost.errors import EightpostError
from eightpost.machine.library import instruction_set
from eightpost.machine.reasons import NotInBatchError
from eightpost.signals import TimeSeries
from eightpost.workers.pool import heartbeat

#: First step that is tried, smallest one [s], and the finer step with which each is compared as a share of it.
_FIRST, _SMALLEST, _FINER = 2e-3, 1e-4, 0.25

#: Least reduction of the error by another step, as a share: else the machine does not converge.
_LEAST_REDUCTION = 0.9

#: Largest number of setups that are compared with the FMUs before a study starts.
_MOST_COMPARED = 8

#: Number of random setups among which they are searched.
_SEARCHED = 200


def choose(evaluator: Evaluator) -> Coupling:
    """Return how the setups of a study run: on the machine if it can, and agrees with the FMUs; else through the FMUs.

    Raises:
        StepError: No setup could be run.
    """
    try:
        machine, notes, batches = _choose_machine(evaluator)
        checked, coupling = _compared(evaluator, machine, batches.has)
    except NotInBatchError as reason:
        return through_fmus(evaluator, str(reason))
    if batches.left_out:
        coupling = choose_coupling(evaluator)
        notes = (
            *notes,
            f"setups with these builds run through the FMUs: {'; '.join(batches.left_out)}",
            *coupling.notes,
        )
    return replace(coupling, machine=checked, stated_error=checked.stated_error, notes=notes)


def through_fmus(evaluator: Evaluator, reason: str) -> Coupling:
    """Return the coupling of a study whose setups all run through the FMUs, for a reason.

    Raises:
        StepError: No setup could be run.
    """
    found = choose_coupling(evaluator)
    return replace(found, notes=(*found.notes, f"every setup runs through the FMUs: {reason}"))


# ---- Step -----------------------------------------------------------------------------------------------------------


def _choose_machine(evaluator: Evaluator) -> tuple[MachineCoupling, tuple[str, ...], Batches]:
    """Return the largest step that divides the record step and meets the study's accuracy, notes, and batches at it.

    The baseline, setups with the same build at all corners, and random setups run at a step and at a quarter of it,
    which also calibrates the estimate of a setup's error.
    """
    study = evaluator.study
    parts, tried, pilots = ceil(study.record_step / _FIRST - 1e-9), list[str](), _pilots(evaluator)
    before = inf
    recorded = sorted(evaluator.decisive(pilots[0]))
    while True:
        step = study.record_step / parts
        if step < _SMALLEST:
            raise NotInBatchError(f"the machine needs steps below {1e3 * _SMALLEST:g} ms: {', '.join(tried)}")
        coarse, fine = Batches(evaluator, step, recorded), Batches(evaluator, _FINER * step, recorded)
        found = _compare(evaluator, coarse, fine, pilots)
        worst = max(max(pilot.channels.values()) for pilot in found)
        tried.append(f"{1e3 * step:.4g} ms {worst:.2g} %")
        if worst <= AIM * study.accuracy:
            break
        if worst > _LEAST_REDUCTION * before:
            raise NotInBatchError(f"the machine's error does not fall with its step: {', '.join(tried)}")
        before = worst
        parts = finer(parts, worst / (AIM * study.accuracy))
    width = instruction_set() or "any processor"
    notes = (
        f"{coarse.lanes} setups at once ({width}), step and largest error of {len(found)} setups: {', '.join(tried)}",
    )
    return MachineCoupling(step, fit_error_model(found), worst), notes, coarse


def _pilots(evaluator: Evaluator) -> list[Setup]:
    known = candidates(evaluator)
    return [*known, *random_setups(evaluator, known)]


def _compare(evaluator: Evaluator, coarse: Batches, fine: Batches, setups: Sequence[Setup]) -> list[Pilot]:
    """Return the errors of the setups that both finish, of each drive.

    Raises:
        NotInBatchError: The machine finishes no setup.
    """
    pairs = zip(coarse.runs(setups), fine.runs(setups), strict=True)
    found = [
        _pilot(runs[drive.name], right[drive.name], evaluator.study.settling)
        for (_, runs, _), (_, right, _) in pairs
        if runs is not None and right is not None
        for drive in evaluator.study.drives
    ]
    if not found:
        raise NotInBatchError("the machine finishes none of the setups that were tried")
    return found


def _pilot(run: BatchRun, fine: BatchRun, settling: float) -> Pilot:
    apart = difference(_settled(run, settling), _settled(fine, settling))
    return Pilot(run.summary, apart, {m: abs(run.values[m] - fine.values[m]) for m in run.values})


def _settled(run: BatchRun, settling: float) -> TimeSeries:
    series = run.channels()
    return series.window(settling, float(series.time[-1]))


# ---- Comparison with the FMUs ---------------------------------------------------------------------------------------


class Compared(NamedTuple):
    """A setup that ran on the machine and through the FMUs."""

    check: Check  #: Comparison.
    step: float  #: Smallest coupling step of the runs through the FMUs [s].
    scheme: str  #: Their scheme.


def _compared(
    evaluator: Evaluator, machine: MachineCoupling, has: Callable[[Setup], bool]
) -> tuple[MachineCoupling, Coupling]:
    """Return the machine's coupling with its comparisons, and that of runs through the FMUs.

    Raises:
        NotInBatchError: No setup could be compared, or one does not agree.
    """
    compared = list[Compared]()
    for setup in _with_every_build(evaluator, has):
        try:
            compared.append(check_setup(evaluator, setup, machine))
        except EightpostError:
            continue  # the setup's row states the reason
        if not compared[-1].check.agrees:
            raise NotInBatchError(disagreement(compared[-1].check))
    if not compared:
        raise NotInBatchError("no setup could be compared with the machine")
    record = evaluator.study.record_step
    step = record / ceil(record / min(one.step for one in compared) - 1e-9)
    scheme = "implicit" if any(one.scheme == "implicit" for one in compared) else "gauss-seidel"
    return replace(machine, checks=tuple(one.check for one in compared)), Coupling(scheme, step)


def _with_every_build(evaluator: Evaluator, has: Callable[[Setup], bool]) -> Iterator[Setup]:
    """Yield the baseline, and setups of the machine with all builds of the bank, if not too many."""
    study, seen = evaluator.study, set[str]()
    baseline = [setup for setup in (study.baseline_setup,) if setup and has(setup)]
    left = [*filter(has, map(study.space.setup, random_indices(study, _SEARCHED)))]
    for _ in range(min(_MOST_COMPARED, len(left))):
        chosen = baseline.pop() if baseline else max(left, key=lambda setup: len({*setup.builds.values()} - seen))
        if {*chosen.builds.values()} <= seen:
            return
        seen |= {*chosen.builds.values()}
        yield chosen


def disagreement(check: Check) -> str:
    """Return in words that the machine differs from the FMUs."""
    return (
        f"the machine differs from them by {check.difference:.2g} % at setup {check.setup} "
        f"(machine {check.machine:.2g} %, FMUs {check.fmus:.2g} %)"
    )


def check_setup(evaluator: Evaluator, setup: Setup, machine: MachineCoupling) -> Compared:
    """Compare the machine with the FMUs, at a step at which their error is within the study's accuracy, on all drives.

    Raises:
        NotInBatchError: The machine does not finish the setup.
        StepError: An FMU failed.
    """
    study, names = evaluator.study, sorted(evaluator.decisive(setup))
    runs = evaluator.machine_runs(setup, machine.step, names)
    apart = own = stated = 0.0
    steps, scheme = [study.record_step], "gauss-seidel"
    for drive in study.drives:
        scenario = replace(evaluator.scenario(drive), record=tuple(names))
        right = run(evaluator.system(setup), scenario, algorithm=Automatic(study.accuracy), progress=heartbeat)
        differences = difference(right.settled(), _settled(runs[drive.name], study.settling))
        apart = float(np.max([apart, *differences.values()]))  # NaN if one is
        own = max(own, machine.errors.worst_channel(runs[drive.name].summary))
        stated = max(stated, *right.stated_error.values())
        steps.append(right.step)
        scheme = "implicit" if right.scheme == "implicit" else scheme
    check = Check(setup.index, apart, own, stated, max(own, study.accuracy) + stated)
    return Compared(check, min(steps), scheme)
