"""Choice of a study's coupling: once, on the setups with the largest coupling errors, then used for all setups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cosim.session.result import Result, difference
from cosim.session.run import FIRST_STEP, run
from cosim.study.running.error_model import ErrorModel, Pilot, fit_error_model
from cosim.study.running.evaluator import Coupling, Evaluator, local_error
from cosim.study.study import Drive, Setup, Study
from cosim.systems.algorithm import Automatic
from eightpost.errors import DivergedError, EightpostError, StepError
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

    Raises:
        StepError: No setup could be run; the message is that of the first failure.
    """
    pilots = _worst_coupled(evaluator)
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
    model = _error_model(evaluator, [*pilots, *random_setups(evaluator, pilots)], coupling)
    return replace(coupling, errors=model, stated_error=max(errors), notes=notes)


def random_setups(evaluator: Evaluator, known: list[Setup]) -> list[Setup]:
    """Return random setups of the study other than the known ones; they are the same for every call."""
    found = random_indices(evaluator.study, _PILOTS, [setup.index for setup in known])
    return [evaluator.study.space.setup(index) for index in found]


def random_indices(study: Study, count: int, known: Sequence[int] = ()) -> list[int]:
    """Return up to so many numbers of random setups other than the known ones; they are the same for every call."""
    left = np.setdiff1d(study.space.indices, known)
    chosen: list[int] = np.random.default_rng(_SEED).choice(left, min(count, left.size), replace=False).tolist()
    return chosen


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


def _pilot(evaluator: Evaluator, setup: Setup, drive: Drive, coupling: Coupling) -> Pilot:
    names = evaluator.decisive(setup)
    run = evaluator.run(setup, drive, coupling, extra=names)
    fine = evaluator.run(setup, drive, replace(coupling, step=_PILOT_STEP * coupling.step), extra=names)
    found, right = evaluator.measured(run, drive), evaluator.measured(fine, drive)
    apart = difference(run.settled(), fine.settled())
    return Pilot(run, {name: apart[name] for name in sorted(names)}, {m: abs(found[m] - right[m]) for m in found})


def finer(parts: int, excess: float) -> int:
    """Return the next number of coupling steps per record step, given the ratio of the error to its target.

    The estimate uses the third order of the schemes, with a margin so that no sufficient step is skipped.
    """
    guess = _CARE * parts * float(np.cbrt(excess)) if excess < _DOUBLING else 2 * parts
    return max(parts + 1, min(int(guess), 2 * parts))


def _worst_coupled(evaluator: Evaluator) -> list[Setup]:
    """Return the setups whose bonds report the largest local errors on a part of the first drive."""
    found, failure = list[tuple[float, Setup]](), None
    for setup in candidates(evaluator):
        try:
            found.append((_coarse_error(evaluator, setup), setup))
        except EightpostError as error:
            failure = failure or error
    if not found:
        raise StepError(f"no setup could be run; first failure: {failure}")
    found.sort(key=lambda pair: -pair[0])
    return [setup for _, setup in found[:_COMPARED]]


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


def _coarse_error(evaluator: Evaluator, setup: Setup) -> float:
    """Return the local error of a short run with a coarse step [%]; infinite if it diverges."""
    study, drive = evaluator.study, evaluator.study.drives[0]
    short = replace(drive, stop=min(drive.stop, study.settling + _RANKING_TIME))
    coupling = Coupling("gauss-seidel", study.record_step / max(1, round(study.record_step / FIRST_STEP)))
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
