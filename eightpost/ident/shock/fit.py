"""Fit a shock law to dynamometer tests (3.3)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from eightpost.ident.shock.between_builds import BuildSpread, build_spread
from eightpost.ident.shock.boggs import Boggs
from eightpost.ident.shock.curve import CurveKind, Shape
from eightpost.ident.shock.curve_choice import CurveChooser, fit_with_best_curve
from eightpost.ident.shock.law_choice import LawChoice, best_law
from eightpost.ident.shock.law_fit import models_for
from eightpost.ident.shock.options import AUTO, Choices, CurveChoice, GasTreatment, LawName, RecipeName
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.result import ShockFit, Story, result_of
from eightpost.ident.shock.robust import Robust, screened_runs
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.progress import portion
from eightpost.rig.dyno_test import DynoTest


def fit_shock(
    tests: DynoTest | Sequence[DynoTest],
    law: LawName,
    *,
    recipe: RecipeName = "joint",
    gas: GasTreatment = "estimate",
    shape: Shape = "auto",
    order: int | None = None,
    robust: Robust = "auto",
    curve: CurveChoice = "auto",
    name: str | None = None,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
    transition_speed: float | None = None,
) -> ShockFit:
    """Fit a law to a dynamometer test, or to several runs of one build, or of several builds, together.

    Args:
        tests: Records of velocity and force, for the gas stiffness also displacement; positive in compression. Several
            runs share curve, law and gas stiffness; each has its own gas offset. If they are of several builds
            (`DynoConditions.build`), the fit also states the spread between these.
        law: Name in `LAWS`, or `auto` for a choice by cross-validation (`choose_law`).
        recipe: `joint` or `boggs`; see `Choices` for this and the next five arguments.
        gas: Treatment of the gas force.
        shape: Constraint on the curve.
        order: Order of the inner polynomial.
        robust: Treatment of outliers.
        curve: Kind of the static curve.
        name: Name of the shock; default the build, else the file's name.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
        transition_speed: Transition speed of the curve [m/s]; default 15 in/s, less for a slow record.

    Raises:
        ParameterError: The law or an option is unknown, or an option does not suit the record.
        TooShortError: A record has too few samples.
    """
    choices = Choices(recipe, gas, shape, order, robust, curve, transition_speed is not None)
    choices.check(law)
    started = time.perf_counter()
    given = [tests] if isinstance(tests, DynoTest) else list(tests)

    def prepared(records: Sequence[DynoTest]) -> Runs:
        return prepare_runs(records, segment=segment, cutoff=cutoff, transition_speed=transition_speed)

    # Threads do not speed up matrices this small, and they slow down other work on the same processors.
    with threadpool_limits(1, "blas"):
        with portion(0.0, 0.2):
            runs, spikes, notes = screened_runs(given, prepared) if choices.is_screened else (prepared(given), 0, [])
        with portion(0.2, 0.9):
            solved = _solved(runs, law, choices)
        changes = (*runs.changes, *notes, *solved.notes, *solved.solution.notes)
        spread, unfitted = _between_builds(runs, solved, choices)
        changes = (*changes, *unfitted)
        story = Story(recipe, gas, name, changes, spikes + solved.downweighted, solved.choice, spread)
        result = result_of(given, solved.solution, story, 0.0)
    return replace(result, seconds=time.perf_counter() - started)


@dataclass(frozen=True, slots=True)
class _Solved:
    """A solution with its notes, the number of down-weighted samples, the choice of its law, its law and its curve."""

    solution: Solution
    notes: tuple[str, ...]
    downweighted: int = 0
    choice: LawChoice | None = None
    law: str = ""
    curve: CurveKind = "polynomial"


def _between_builds(runs: Runs, solved: _Solved, choices: Choices) -> tuple[BuildSpread | None, tuple[str, ...]]:
    """Return the spread between the builds of the runs, and notes; None for the runs of one build."""
    if len(runs.builds) < 2:
        return None, ()

    def fit_alone(own: Runs) -> Solution:
        if choices.recipe == "boggs":
            return Boggs().fit(models_for(own, solved.law, choices)[0])
        return CurveChooser(own, replace(choices, curve=solved.curve))(solved.law)[0].fit.solution()

    return build_spread(runs, solved.solution, fit_alone)


def _solved(runs: Runs, law: str, choices: Choices) -> _Solved:
    if choices.recipe == "boggs":
        models, notes = models_for(runs, law, choices)
        return _Solved(Boggs().fit(models), tuple(notes), law=law)
    if law == AUTO:
        choice, fitted, curve = best_law(runs, choices)
    else:
        choice, (fitted, curve) = None, fit_with_best_curve(runs, law, choices)
    solution, (samples, notes) = fitted.solution(), fitted.downweighted()
    reasons = [curve.reason] if curve.reason else []
    return _Solved(solution, (*reasons, *fitted.notes, *notes), samples, choice, fitted.law, curve.kind)
