"""Runs of a case: the stated error, the cost, and the true error against the reference."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import cosim
from benchmarks.honesty.cases import Case
from benchmarks.honesty.reference import Answer, solve
from cosim import Algorithm, Automatic, GaussSeidel, Implicit, Jacobi, Result
from cosim.session.result import judged_by
from cosim.session.session import Session
from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.signals import TimeSeries


def reference_scales(values: Array, units: Sequence[str]) -> Array:
    """Return the reference (C,) that errors of channels are divided by, in each channel's own unit.

    Args:
        values: Channels after settling (C, K).
        units: SI units (C,).
    """
    spread = dict(enumerate(np.std(values, axis=1).tolist()))
    return np.array(list(judged_by(spread, dict(enumerate(units))).values()))


def percent(apart: Array, scales: Array) -> Array:
    """Return the root mean squares of differences (C, K) in percent of the references (C,)."""
    return np.asarray(100.0 * np.sqrt(np.mean(apart**2, axis=1)) / scales)


VALUES = ("held", "interpolated", "extrapolated", "parabolic")
STEPS = (4e-3, 2e-3, 1e-3, 5e-4)

#: Schemes at a given step; None: the scheme that `cosim.run(system, scenario, step=...)` chooses.
ALGORITHMS: Mapping[str, Algorithm | None] = {
    "given": None,
    **{f"jacobi {values}": Jacobi(values) for values in VALUES},
    **{f"gauss-seidel {values}": GaussSeidel(values=values) for values in VALUES},
    "implicit": Implicit(),
}

#: Rules of the verdict that are checked; ranges of the models are not part of this campaign.
ABOUT = ("coupling", "energy", "convergence")

#: Number of coupling steps above which a run is compared with the reference at every third, fifth ... step only.
MOST_POINTS = 30_000

#: Tolerances of the reference, tried until two solutions agree, and their allowed difference [%].
TOLERANCES = (1e-7, 1e-9, 1e-11, 1e-12)
AGREED = 0.001


@dataclass(frozen=True)
class Trial:
    """Run that the product made to obtain its result."""

    algorithm: Algorithm
    step: float
    scenario: cosim.Scenario
    result: Result | None  #: None if the run ended with an error.


@dataclass(frozen=True)
class Finding:
    """Result of one scheme for a case, before the comparison."""

    scheme: str  #: `default`, or an algorithm and a step.
    result: Result | None  #: Result of the product; None if it raised an error.
    fine: TimeSeries | None  #: The same run, recorded at (almost) every coupling step.
    error: str  #: Message of the error that the product raised.
    seconds: float  #: Processor time [s].


def compare(case: Case, folder: Path, schemes: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Run a case with every scheme and return a row for each.

    Args:
        case: Case to run.
        folder: Folder of the FMUs.
        schemes: Arguments of `cosim.run` by name.
    """
    system = case.system(folder)
    findings = [_find(system, case, name, options) for name, options in schemes.items()]
    answer, doubt = _answer(case, findings)
    return [_row(case, finding, answer, doubt, system.decisive) for finding in findings]


def schemes_of(seed: int, which: str) -> dict[str, dict[str, Any]]:
    """Return the arguments of `cosim.run` by scheme: `default`, `given` (eight of forty, drawn), or `all` of these."""
    found: dict[str, dict[str, Any]] = {} if which == "given" else {"default": {}}
    if which == "default":
        return found
    given = {
        f"{name}, {1e3 * step:g} ms": {"step": step} | ({"algorithm": algorithm} if algorithm else {})
        for name, algorithm in ALGORITHMS.items()
        for step in STEPS
    }
    chosen = np.random.default_rng((seed, 40)).choice(sorted(given), size=8, replace=False)
    return found | {str(name): given[str(name)] for name in chosen}


@contextmanager
def trials_logged() -> Iterator[list[Trial]]:
    """Record every run that the product makes within the block."""
    log: list[Trial] = []
    original = Session.run

    def run(self: Session, *arguments: Any, **options: Any) -> Result:
        setup, result = self._setup, None
        try:
            result = original(self, *arguments, **options)
        finally:
            log.append(Trial(setup.algorithm, setup.step, setup.scenario, result))
        return result

    with patch.object(Session, "run", run):
        yield log


def _find(system: cosim.System, case: Case, name: str, options: dict[str, Any]) -> Finding:
    scenario, began, result = case.scenario, clock.process_time(), None
    if "step" in options and scenario.record_step is not None:  # a whole number of steps
        parts = max(1, round(scenario.record_step / options["step"]))
        scenario = replace(scenario, record_step=parts * options["step"])
    with trials_logged() as log:
        try:
            result = cosim.run(system, scenario, **options)
        except EightpostError as error:
            return Finding(name, None, None, str(error), clock.process_time() - began)
    spent = clock.process_time() - began
    try:
        fine = _recorded_finely(system, result, log)
    except EightpostError as error:
        return Finding(name, result, None, f"a second run failed: {error}", spent)
    return Finding(name, result, fine, "", spent)


def _recorded_finely(system: cosim.System, result: Result, log: list[Trial]) -> TimeSeries:
    """Repeat the run that gave the result, recorded at every step or every odd number of them."""
    taken = (result.scheme or result.algorithm, result.step)
    final = [trial for trial in log if trial.result is not None and (trial.algorithm.name, trial.step) == taken][-1]
    assert final.result is not None
    every = ceil(final.result.steps / MOST_POINTS)
    every += 1 - every % 2
    if final.scenario.record_step in (None, every * final.step) and not final.scenario.record:
        return final.result.series
    scenario = replace(final.scenario, record=(), record_step=every * final.step)
    return Session(system, scenario, final.algorithm, final.step).run().series


def _repeats(finding: Finding) -> bool:
    """Return whether two recordings of a run agree to the bit at the times that both have."""
    if finding.result is None or finding.fine is None:
        return not finding.error.startswith("a second run failed")
    series, fine = finding.result.series, finding.fine
    _, first, second = np.intersect1d(series.time, fine.time, assume_unique=True, return_indices=True)
    return all(np.array_equal(series[name][first], fine[name][second]) for name in series.names)


def _answer(case: Case, findings: list[Finding]) -> tuple[Answer, Answer]:
    """Return the reference at all compared times, and a coarser one; their difference estimates the error."""
    times = [finding.fine.time for finding in findings if finding.fine is not None] or [np.zeros(1)]
    wanted = np.unique(np.concatenate([[0.0], *times]))
    coarse = solve(case, wanted, TOLERANCES[0])
    for tolerance in TOLERANCES[1:]:
        fine = solve(case, wanted, tolerance)
        after = wanted >= case.scenario.settling
        scales = reference_scales(fine.values[:, after], fine.units)
        if np.max(percent((fine.values - coarse.values)[:, after], scales)) <= AGREED or tolerance == TOLERANCES[-1]:
            break
        coarse = fine
    return fine, coarse


def _row(case: Case, finding: Finding, answer: Answer, doubt: Answer, chosen: frozenset[str]) -> dict[str, Any]:
    result = finding.result
    row: dict[str, Any] = {
        "seed": case.seed,
        "scheme": finding.scheme,
        "case": case.description,
        "error": finding.error,
        "seconds": round(finding.seconds, 4),
        "repeats": _repeats(finding),
    }
    if result is None or finding.fine is None:
        return row
    return row | {
        "acceptable": result.verdict.about(*ABOUT).is_acceptable,
        "step": result.step,
        "taken": result.scheme or result.algorithm,
        "coupled": max((bond.percent for bond in result.coupled.values()), default=0.0),
        "tolerance": result.tolerance or Automatic().tolerance,
        "channels": _channels(result, finding.fine, answer, doubt, case.scenario.settling, chosen),
    }


def _channels(
    result: Result, fine: TimeSeries, answer: Answer, doubt: Answer, settling: float, chosen: frozenset[str]
) -> dict[str, dict[str, Any]]:
    """Return the stated and the true error per channel, and the reference's own error [%]."""
    at = np.searchsorted(answer.time, fine.time)
    after = fine.time >= settling
    truth, other = answer.values[:, at[after]], doubt.values[:, at[after]]
    scales = reference_scales(truth, answer.units)
    found = np.stack([fine[name] for name in answer.names])[:, after]
    true, own = percent(found - truth, scales), percent(other - truth, scales)
    given = {name: value for name, value in result.stated_error.items() if value is not None}
    stated = {name: min(float(value), 1e300) for name, value in given.items()}  # JSON has no infinity
    return {
        name: {
            "stated": stated.get(name),
            "true": float(true[k]),
            "reference": float(own[k]),
            "decisive": name in chosen,
            "unit": answer.units[k],
        }
        for k, name in enumerate(answer.names)
    }
