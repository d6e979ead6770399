"""Choice of a study's coupling: once, on the setups with the largest coupling errors, then used for all setups."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from cosim.session.result import Result, difference
from cosim.session.run import FIRST_STEP, run
from cosim.study.definition import Drive, Setup, Study
from cosim.study.running.batches import Batches, BatchRun, ErrorModel, Pilot, fit_error_model, local_errors
from cosim.study.running.evaluator import Check, Coupling, Evaluator, MachineCoupling, Rounding, local_error
from cosim.systems.algorithm import Automatic
from eightpost.errors import DivergedError, EightpostError, StepError, WiringError
from eightpost.machine.car import NotInBatchError, instruction_set
from eightpost.signals import TimeSeries
from eightpost.workers.pool import heartbeat

#: Number of setups that are compared with references, and largest number of candidates for them.
_COMPARED, _CANDIDATES = 3, 12

#: Accuracy of the reference runs, as a share of the study's accuracy.
_REFERENCE = 0.1

#: Number of random setups, in addition to the compared ones, that calibrate the error estimate, and their seed.
_PILOTS, _SEED = 9, 20091

#: Step of the pilots' fine runs, as a share of the study's step.
_PILOT_STEP = 0.25

#: Duration of the runs that rank the candidates, after the settling time [s].
_RANKING_TIME = 8.0

#: Target error for the choice of the step, as a share of the accuracy: other setups may have larger errors.
AIM = 0.8


#: Reduction of the step count expected from the order of the error, and error excess above which the count is doubled.
_CARE, _DOUBLING = 0.8, 1e3


def choose_coupling(evaluator: Evaluator) -> Coupling:
    """Return the largest coupling step that divides the record step and meets the study's accuracy.

    The baseline and setups with the same build at all corners are run with a coarse step. Those whose bonds report the
    largest local errors are run to a tenth of the accuracy, and then with one step after another until they agree with
    that. These and random setups are then run at a quarter of the chosen step; their errors calibrate the estimate of a
    setup's coupling error from the local errors of its bonds (cosim.study.running.evaluator).

    With an FMU that makes steps of one size only, that size is the step, and coupling errors are unknown.

    Raises:
        StepError: No setup could be run; the message is that of the first failure.
        WiringError: FMUs make steps of one size only, and of different sizes.
    """
    if (only := _only_step(evaluator)) is not None:
        return _at_only_step(evaluator, only)
    pilots = [setup for _, setup in _by_local_error(evaluator)[:_COMPARED]]
    references = [_reference(evaluator, setup) for setup in pilots]
    scheme = "implicit" if any(r.scheme == "implicit" for r in references) else references[0].scheme
    smallest, record = min(r.step for r in references), evaluator.study.record_step
    parts, steps = 1, list[str]()
    while True:
        coupling = Coupling(scheme, record / parts)
        errors = _errors(evaluator, pilots, references, coupling)
        steps.append(f"{1e3 * coupling.step:.4g} ms {max(errors):.2g} %")
        if max(errors) <= AIM * evaluator.study.accuracy or coupling.step <= smallest * (1.0 + 1e-9):
            break
        parts = finer(parts, max(errors) / (AIM * evaluator.study.accuracy))
    notes = (
        f"{scheme} at {1e3 * coupling.step:.4g} ms; coupling error from compared runs: {', '.join(steps)}",
        f"chosen on: {'; '.join(map(str, pilots))}",
    )
    model = _error_model(evaluator, [*pilots, *_random_setups(evaluator.study, _PILOTS, pilots)], coupling)
    return replace(coupling, errors=model, stated_error=max(errors), notes=notes)


def _only_step(evaluator: Evaluator) -> float | None:
    """Return the size of the steps [s] of FMUs that make steps of one size only and state it (stepSize)."""
    sizes = {fmu.capabilities.only_step: path for path, fmu in evaluator.fmus.items() if fmu.capabilities.only_step}
    if len(sizes) > 1:
        stated = " and ".join(f"{path} of {1e3 * size:g} ms" for size, path in sizes.items())
        raise WiringError(f"no coupling step suits all FMUs: {stated} only (stepSize); export one of them again")
    return next(iter(sizes), None)


def _at_only_step(evaluator: Evaluator, step: float) -> Coupling:
    diverged = _by_local_error(evaluator, step)[0][0] == inf
    scheme = "implicit" if diverged else "gauss-seidel"
    text = (
        f"{scheme} at {1e3 * step:.4g} ms, the only step of an FMU (stepSize): no other step shows the coupling error"
    )
    return Coupling(scheme, step, notes=(text,))


def _random_setups(study: Study, count: int, known: Sequence[Setup] = ()) -> list[Setup]:
    """Return up to so many random setups other than the known ones; they are the same for every call."""
    left = np.setdiff1d(study.space.indices, [setup.index for setup in known])
    chosen = np.random.default_rng(_SEED).choice(left, min(count, left.size), replace=False)
    return [study.space.setup(index) for index in chosen.tolist()]


def _error_model(evaluator: Evaluator, setups: list[Setup], coupling: Coupling) -> ErrorModel | None:
    """Return the model of coupling errors from local errors; None if no pilot could be run."""
    pilots = []
    for setup in setups:
        for drive in evaluator.study.drives:
            try:
                pilots.append(_pilot(evaluator, setup, drive, coupling))
            except EightpostError:
                continue  # the setup's row states the reason
    return fit_error_model(pilots) if pilots else None


def calibrated(evaluator: Evaluator, coupling: Coupling) -> Coupling:
    """Return a coupling that was chosen for the machine with an estimate of the errors of runs through the FMUs."""
    if coupling.machine is None or coupling.errors is not None:
        return coupling
    return replace(coupling, errors=_error_model(evaluator, _random_setups(evaluator.study, _PILOTS), coupling))


def _pilot(evaluator: Evaluator, setup: Setup, drive: Drive, coupling: Coupling) -> Pilot:
    names = evaluator.decisive(setup)
    run = evaluator.run(setup, drive, coupling, extra=names)
    fine = evaluator.run(setup, drive, replace(coupling, step=_PILOT_STEP * coupling.step), extra=names)
    found, right = evaluator.measured(run, drive), evaluator.measured(fine, drive)
    apart = difference(run.settled(), fine.settled())
    return Pilot(
        local_errors(run), {name: apart[name] for name in sorted(names)}, {m: abs(found[m] - right[m]) for m in found}
    )


def finer(parts: int, excess: float) -> int:
    """Return the next number of coupling steps per record step, given the ratio of the error to its target.

    The estimate uses the third order of the schemes, with a margin so that no sufficient step is skipped.
    """
    guess = _CARE * parts * float(np.cbrt(excess)) if excess < _DOUBLING else 2 * parts
    return max(parts + 1, min(int(guess), 2 * parts))


def _by_local_error(evaluator: Evaluator, step: float = FIRST_STEP) -> list[tuple[float, Setup]]:
    """Return setups with the largest local error of a bond [%] on a part of the first drive, worst first."""
    found, failure = list[tuple[float, Setup]](), None
    for setup in candidates(evaluator):
        try:
            found.append((_coarse_error(evaluator, setup, step), setup))
        except EightpostError as error:
            failure = failure or error
    if not found:
        raise StepError(f"no setup could be run; first failure: {failure}")
    return sorted(found, key=lambda pair: -pair[0])


def candidates(evaluator: Evaluator) -> list[Setup]:
    """Return the baseline and the setups with one build at all corners; of a large bank, every n-th of these."""
    study, space = evaluator.study, evaluator.study.space
    builds = [b for b in study.bank if all(b in allowed for allowed in study.corners.values())]
    alike = [space.find(dict.fromkeys(study.corners, build)) for build in builds]
    if not alike:
        indices = space.indices
        alike = [space.setup(int(k)) for k in indices[:: max(1, indices.size // _CANDIDATES)]]
    every = max(1, -(-len(alike) // _CANDIDATES))
    baseline = [study.baseline_setup] if study.baseline_setup else []
    return list({setup.index: setup for setup in [*baseline, *alike[::every]]}.values())


def _coarse_error(evaluator: Evaluator, setup: Setup, step: float) -> float:
    """Return the local error [%] of a short run with about this step [s]; infinite if it diverges."""
    study, drive = evaluator.study, evaluator.study.drives[0]
    short = replace(drive, stop=min(drive.stop, study.settling + _RANKING_TIME))
    coupling = Coupling("gauss-seidel", study.record_step / max(1, round(study.record_step / step)))
    try:
        return local_error(evaluator.run(setup, short, coupling))
    except DivergedError:
        return float("inf")


def _reference(evaluator: Evaluator, setup: Setup) -> Result:
    """Return the reference run of a setup."""
    study = evaluator.study
    system, extra = evaluator.system(setup), sorted(evaluator.decisive(setup))
    scenario = replace(evaluator.scenario(study.drives[0], extra=extra), record=tuple(extra))
    return run(system, scenario, algorithm=Automatic(_REFERENCE * study.accuracy), progress=heartbeat)


def _errors(evaluator: Evaluator, pilots: list[Setup], references: list[Result], coupling: Coupling) -> list[float]:
    """Return the coupling error of each pilot at a step [%]; infinite if it diverges."""
    errors = []
    for setup, reference in zip(pilots, references, strict=True):
        try:
            run = evaluator.run(setup, evaluator.study.drives[0], coupling, extra=reference.series.names)
        except DivergedError:
            errors.append(float("inf"))
            continue
        stated = max(reference.stated_error.values(), default=0.0)
        apart = difference(run.settled(), reference.settled())
        errors.append(max(apart[name] for name in reference.series.names) + stated)
    return errors


# ==== Choice of the machine's step for a study, and its comparison with the FMUs on a few setups =====================

#: First step that is tried, smallest one [s], and the finer step with which each is compared as a share of it.
_FIRST, _SMALLEST, _FINER = 2e-3, 1e-4, 0.25

#: Least reduction of the error by another step, as a share: else the machine does not converge.
_LEAST_REDUCTION = 0.9

#: Largest number of setups that are compared with the FMUs before a study starts.
_MOST_COMPARED = 8

#: Number of random setups among which they are searched.
_SEARCHED = 200


def coupling_for(evaluator: Evaluator) -> Coupling:
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
    parts, tried, pilots = ceil(study.record_step / _FIRST - 1e-9), list[str](), candidates(evaluator)
    pilots += _random_setups(study, _PILOTS, pilots)
    before = inf
    recorded = sorted(evaluator.decisive(pilots[0]))
    while True:
        step = study.record_step / parts
        if step < _SMALLEST:
            raise NotInBatchError(f"the machine needs steps below {1e3 * _SMALLEST:g} ms: {', '.join(tried)}")
        coarse, fine = (Batches(evaluator, part * step, recorded) for part in (1.0, _FINER))
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


def _compare(evaluator: Evaluator, coarse: Batches, fine: Batches, setups: Sequence[Setup]) -> list[Pilot]:
    """Return the errors of the setups that both finish, of each drive."""
    pairs = zip(coarse.runs(setups), fine.runs(setups), strict=True)
    found = [
        _machine_pilot(runs[drive.name], right[drive.name], evaluator.study.settling)
        for (_, runs, _), (_, right, _) in pairs
        if runs is not None and right is not None
        for drive in evaluator.study.drives
    ]
    if not found:
        raise NotInBatchError("the machine finishes none of the setups that were tried")
    return found


def _machine_pilot(run: BatchRun, fine: BatchRun, settling: float) -> Pilot:
    apart = difference(_settled(run, settling), _settled(fine, settling))
    return Pilot(run.local, apart, {m: abs(run.values[m] - fine.values[m]) for m in run.values})


def _settled(run: BatchRun, settling: float) -> TimeSeries:
    series = run.channels()
    return series.window(settling, float(series.time[-1]))


# ---- Single precision -----------------------------------------------------------------------------------------------

#: Largest difference of single from double precision, as a share of the study's accuracy, and number of random setups
#: that run in both.
_ROUNDING, _ROUNDED = 0.1, 100


def with_rounding(evaluator: Evaluator, coupling: Coupling) -> Coupling:
    """Return the coupling with the differences of single precision, if setups may run in it; a note says so or why not.

    They are those of the baseline, setups with the same build at all corners, and random ones.
    """
    machine, study = coupling.machine, evaluator.study
    if machine is None:
        return coupling
    pilots = candidates(evaluator)
    pilots += _random_setups(study, _ROUNDED, pilots)
    recorded = sorted(evaluator.decisive(pilots[0]))
    try:
        single, double = (evaluator.batches_at(machine.step, recorded, single=own) for own in (True, False))
        found = _compare(evaluator, single, double, pilots)
    except NotInBatchError as reason:
        return replace(coupling, notes=(*coupling.notes, f"all setups run in double precision: {reason}"))
    names = dict.fromkeys(name for pilot in found for name in pilot.measures)
    measures = {name: max(pilot.measures.get(name, 0.0) for pilot in found) for name in names}
    rounding = Rounding(max(max(pilot.channels.values()) for pilot in found), measures)
    apart = f"single precision differs by {rounding.percent:.2g} % in {len(found)} setups"
    if not rounding.percent <= _ROUNDING * study.accuracy:
        return replace(coupling, notes=(*coupling.notes, f"all setups run in double precision: {apart}"))
    notes = (*coupling.notes, f"{apart}: all setups run in it, and the best ones again in double precision")
    return replace(coupling, machine=replace(machine, rounding=rounding), notes=notes)


# ---- Comparison with the FMUs ---------------------------------------------------------------------------------------


class Compared(NamedTuple):
    """A setup that ran on the machine and through the FMUs."""

    check: Check  #: Comparison.
    step: float  #: Smallest coupling step of the runs through the FMUs [s].
    scheme: str  #: Their scheme.


def _compared(
    evaluator: Evaluator, machine: MachineCoupling, has: Callable[[Setup], bool]
) -> tuple[MachineCoupling, Coupling]:
    """Return the machine's coupling with its comparisons, and that of runs through the FMUs."""
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
    left = [*filter(has, _random_setups(study, _SEARCHED))]
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
    ((_, runs, _),) = evaluator.batches_at(machine.step, names, measured=False).runs([setup])
    if runs is None:
        raise NotInBatchError(f"the machine does not finish setup {setup.index}")
    apart = own = stated = 0.0
    steps, scheme = [study.record_step], "gauss-seidel"
    for drive in study.drives:
        scenario = replace(evaluator.scenario(drive), record=tuple(names))
        right = run(evaluator.system(setup), scenario, algorithm=Automatic(study.accuracy), progress=heartbeat)
        differences = difference(right.settled(), _settled(runs[drive.name], study.settling))
        apart = float(np.max([apart, *differences.values()]))  # NaN if one is
        own = max(own, float(machine.errors.of(runs[drive.name].local)[0]))
        stated = max(stated, *right.stated_error.values())
        steps.append(right.step)
        scheme = "implicit" if right.scheme == "implicit" else scheme
    check = Check(setup.index, apart, own, stated, max(own, study.accuracy) + stated)
    return Compared(check, min(steps), scheme)
