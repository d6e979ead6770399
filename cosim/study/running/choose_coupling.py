"""The coupling of a study: chosen once, on the setups that couple worst, then kept for all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.automatic import FIRST_STEP, Automatic, run_automatic
from cosim.difference import difference
from cosim.result import Result
from cosim.study.running.error_model import ErrorModel, Pilot, fit_error_model
from cosim.study.running.evaluator import Coupling, Evaluator, local_error
from cosim.study.running.signs import sign
from cosim.study.setup import Setup
from cosim.study.study import Drive
from eightpost.errors import DivergedError, EightpostError, StepError

#: So many setups are looked at closely, and at most so many roughly to find these.
_CLOSE, _ROUGH = 3, 12

#: Share of the accuracy to which the runs are found that others are compared with.
_REFERENCE = 0.1

#: So many setups, drawn at random besides those that are looked at closely, tell the error of all others.
_PILOTS, _SEED = 9, 20091

#: The runs that tell a pilot's errors have steps of this share of the study's.
_PILOT_STEP = 0.25

#: The rough look is at so much of the first drive [s].
_GLANCE = 8.0

#: Steps are chosen for this share of the accuracy: other setups may couple a little worse.
_AIM = 0.8


#: Share of the number of steps that the order of the error asks for, and excess of error at which it tells nothing.
_CARE, _DOUBLING = 0.8, 1e3


def choose_coupling(evaluator: Evaluator) -> Coupling:
    """Return the largest coupling step that divides the record step and keeps to the study's accuracy.

    Setups with the same build all around, and the baseline, are run roughly; those whose bonds report the largest local
    errors are run to a tenth of the accuracy, and then at one step after another until they agree with that. These and
    setups drawn at random are then run at a quarter of the chosen step; from their errors follows what the local errors
    of any setup's bonds say of its coupling error (cosim.study.running.error_model).

    Raises:
        StepError: No setup could be run; the message is that of the first.
    """
    pilots = _worst_coupled(evaluator)
    references = [_reference(evaluator, setup) for setup in pilots]
    scheme = "implicit" if any(r.scheme == "implicit" for r in references) else references[0].scheme
    least, record = min(r.step for r in references), evaluator.study.record_step
    parts, tried = 1, list[str]()
    while True:
        coupling = Coupling(scheme, record / parts)
        errors = _errors(evaluator, pilots, references, coupling)
        tried.append(f"{1e3 * coupling.step:.4g} ms {max(errors):.2g} %")
        if max(errors) <= _AIM * evaluator.study.accuracy or coupling.step <= least * (1.0 + 1e-9):
            break
        parts = _finer(parts, max(errors) / (_AIM * evaluator.study.accuracy))
    notes = (
        f"{scheme} at {1e3 * coupling.step:.4g} ms; coupling error by comparing runs: {', '.join(tried)}",
        f"chosen on: {'; '.join(map(str, pilots))}",
    )
    model = _error_model(evaluator, [*pilots, *_drawn(evaluator, pilots)], coupling)
    return replace(coupling, errors=model, stated_error=max(errors), notes=notes)


def _drawn(evaluator: Evaluator, known: list[Setup]) -> list[Setup]:
    """Setups of the study drawn at random, always the same, without those that are known."""
    space = evaluator.study.space
    left = np.setdiff1d(space.indices, [setup.index for setup in known])
    chosen = np.random.default_rng(_SEED).choice(left, min(_PILOTS, left.size), replace=False)
    return [space.setup(int(index)) for index in chosen]


def _error_model(evaluator: Evaluator, setups: list[Setup], coupling: Coupling) -> ErrorModel | None:
    """What local errors say of coupling errors; None where no pilot could be run."""
    pilots = []
    for setup in setups:
        for drive in evaluator.study.drives:
            try:
                pilots.append(_pilot(evaluator, setup, drive, coupling))
            except EightpostError:
                continue  # its row says why
    return fit_error_model(pilots) if pilots else None


def _pilot(evaluator: Evaluator, setup: Setup, drive: Drive, coupling: Coupling) -> Pilot:
    names = evaluator.decisive(setup)
    run = evaluator.run(setup, drive, coupling, extra=names)
    fine = evaluator.run(setup, drive, replace(coupling, step=_PILOT_STEP * coupling.step), extra=names)
    found, right = evaluator.measured(run, drive), evaluator.measured(fine, drive)
    apart = difference(run.settled(), fine.settled())
    return Pilot(run, {name: apart[name] for name in sorted(names)}, {m: abs(found[m] - right[m]) for m in found})


def _finer(parts: int, excess: float) -> int:
    """How many steps a recorded one is to have next, where `parts` leave so many times the error that may be.

    By the third order of the schemes, but with care: no step that would do is to be passed by.
    """
    guess = _CARE * parts * float(np.cbrt(excess)) if excess < _DOUBLING else 2 * parts
    return max(parts + 1, min(int(guess), 2 * parts))


def _worst_coupled(evaluator: Evaluator) -> list[Setup]:
    """The setups whose bonds report the largest local errors on a part of the first drive."""
    found, failure = list[tuple[float, Setup]](), None
    for setup in _candidates(evaluator):
        try:
            found.append((_glance(evaluator, setup), setup))
        except EightpostError as error:
            failure = failure or error
    if not found:
        raise StepError(f"no setup could be run; the first: {failure}")
    found.sort(key=lambda pair: -pair[0])
    return [setup for _, setup in found[:_CLOSE]]


def _candidates(evaluator: Evaluator) -> list[Setup]:
    """The baseline and setups with one build all around; where these are many, some from end to end of the bank."""
    study, space = evaluator.study, evaluator.study.space
    builds = [b for b in study.bank if all(b in allowed for allowed in study.corners.values())]
    alike = [space.find(dict.fromkeys(study.corners, build)) for build in builds]
    if not alike:
        indices = space.indices
        alike = [space.setup(int(k)) for k in indices[:: max(1, indices.size // _ROUGH)]]
    every = max(1, -(-len(alike) // _ROUGH))
    baseline = [study.baseline_setup] if study.baseline_setup else []
    return list({setup.index: setup for setup in [*baseline, *alike[::every]]}.values())


def _glance(evaluator: Evaluator, setup: Setup) -> float:
    """Local error of a short run at a rough step [%]; infinite where that diverges."""
    study, drive = evaluator.study, evaluator.study.drives[0]
    short = replace(drive, stop=min(drive.stop, study.settling + _GLANCE))
    coupling = Coupling("gauss-seidel", study.record_step / max(1, round(study.record_step / FIRST_STEP)))
    try:
        return local_error(evaluator.run(setup, short, coupling))
    except DivergedError:
        return float("inf")


def _reference(evaluator: Evaluator, setup: Setup) -> Result:
    """The run that others are compared with."""
    study = evaluator.study
    system, extra = evaluator.system(setup), sorted(evaluator.decisive(setup))
    scenario = replace(evaluator.scenario(study.drives[0], extra=extra), record=tuple(extra))
    return run_automatic(system, scenario, Automatic(_REFERENCE * study.accuracy), "auto", sign)


def _errors(evaluator: Evaluator, pilots: list[Setup], references: list[Result], coupling: Coupling) -> list[float]:
    """Coupling error of each pilot at a step [%]; infinite where it diverges."""
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
