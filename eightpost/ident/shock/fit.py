"""Fit a shock law to dynamometer tests (3.3)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.ident.shock.between_builds import BuildSpread, build_spread
from eightpost.ident.shock.boggs import fit_boggs
from eightpost.ident.shock.cross_validation import CrossValidation, HeldOutErrors
from eightpost.ident.shock.force import GasTreatment
from eightpost.ident.shock.hysteresis_fit import fit_hysteresis
from eightpost.ident.shock.law_fit import Choices, LawName, RecipeName, fit_law, has_own_recipe
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.result import ShockFit, Story, result_of
from eightpost.ident.shock.robust import Robust, screened_runs
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.progress import portion
from eightpost.rig.dyno_test import DynoTest

#: Law whose held-out error is stated beside that of the fitted law.
_BESIDE = "lpnl2"


def fit_shock(
    tests: DynoTest | Sequence[DynoTest],
    law: LawName | None = None,
    *,
    recipe: RecipeName = "joint",
    gas: GasTreatment = "estimate",
    robust: Robust = "auto",
    name: str | None = None,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
) -> ShockFit:
    """Fit a law to a dynamometer test, or to several runs of one build, or of several builds, together.

    Args:
        tests: Records of velocity and force, for the gas stiffness also displacement; positive in compression. Several
            runs share curve, law and gas stiffness; each has its own gas offset. If they are of several builds
            (`DynoConditions.build`), the fit also states the spread between these.
        law: Name in `LAWS`; default `hysteresis`, with `boggs` `lpnl2`.
        recipe: `joint` or `boggs`; see `Choices` for this and the next two arguments.
        gas: Treatment of the gas force.
        robust: Treatment of outliers.
        name: Name of the shock; default the build, else the file's name.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.

    Raises:
        ParameterError: The law or an option is unknown, or does not suit the record.
        TooShortError: A record has too few samples.
    """
    choices = Choices(recipe, gas, robust)
    law = choices.law(law)
    started = time.perf_counter()
    given = [tests] if isinstance(tests, DynoTest) else list(tests)

    def prepared(records: Sequence[DynoTest]) -> Runs:
        return prepare_runs(records, segment=segment, cutoff=cutoff)

    # Threads do not speed up matrices this small, and they slow down other work on the same processors.
    with threadpool_limits(1, "blas"):
        with portion(0.0, 0.2):
            runs, spikes, notes = screened_runs(given, prepared) if choices.is_screened else (prepared(given), 0, [])
        with portion(0.2, 0.9):
            solution, downweighted, held_out = _solved(runs, law, choices)
        changes = (*runs.changes, *notes, *solution.notes)
        spread, unfitted = _between_builds(runs, solution, law, choices)
        story = Story(recipe, gas, name, (*changes, *unfitted), spikes + downweighted, held_out, spread)
        result = result_of(given, solution, story, 0.0)
    return replace(result, seconds=time.perf_counter() - started)


def _solved(runs: Runs, law: str, choices: Choices) -> tuple[Solution, int, HeldOutErrors | None]:
    """Return the solution with its notes, the number of down-weighted samples, and the errors on left-out parts."""
    if choices.recipe == "boggs":
        return fit_boggs(runs, law, choices.gas), 0, None
    fitted = fit_of(runs, law, choices)
    solution, (samples, notes) = fitted.fit.solution(), fitted.fit.downweighted()
    held_out, more = _held_out(fitted, choices)
    return replace(solution, notes=(*fitted.fit.notes, *notes, *solution.notes, *more)), samples, held_out


def fit_of(runs: Runs, law: str, choices: Choices) -> CrossValidation:
    """Return the joint fit of a law to runs, ready for cross-validation.

    Raises:
        ValueError: The law or the fit rejects the data.
    """
    if has_own_recipe(law):
        return fit_hysteresis(runs, law, choices)
    return CrossValidation(fit_law(runs, law, choices))


def _held_out(fitted: CrossValidation, choices: Choices) -> tuple[HeldOutErrors | None, tuple[str, ...]]:
    """Return the errors of a law and of LPNL2 on the same left-out parts, and a note on what cannot be fitted."""
    runs, law, weights = fitted.fit.runs, fitted.fit.law, fitted.fit.runs.weights
    try:
        own = fitted.errors(weights)
    except ValueError as error:  # raised by laws and fits that reject a part of the data
        return None, (f"no held-out error: a part of the record cannot be fitted: {error}",)
    if law == _BESIDE:
        return HeldOutErrors(fitted.left_out, own.percent), ()
    try:
        other = fit_of(runs.weighted(np.ones_like(weights)), _BESIDE, choices).errors(weights)
    except ValueError as error:
        return HeldOutErrors(fitted.left_out, own.percent), (f"no held-out error of LPNL2: {error}",)
    return HeldOutErrors(fitted.left_out, own.percent, other.percent), ()


def _between_builds(
    runs: Runs, solution: Solution, law: str, choices: Choices
) -> tuple[BuildSpread | None, tuple[str, ...]]:
    """Return the spread between the builds of the runs, and notes; None for the runs of one build."""
    if len(runs.builds) < 2:
        return None, ()

    def fit_alone(own: Runs) -> Solution:
        is_boggs = choices.recipe == "boggs"
        return fit_boggs(own, law, choices.gas) if is_boggs else fit_of(own, law, choices).fit.solution()

    return build_spread(runs, solution, fit_alone)
