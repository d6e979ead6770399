"""Fit a shock law to dynamometer tests (3.3)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.boggs import Boggs
from eightpost.ident.shock.closed import dynamics_for
from eightpost.ident.shock.curve import Shape
from eightpost.ident.shock.force import Models, limits_for
from eightpost.ident.shock.gas import gas_columns
from eightpost.ident.shock.joint import Joint, Sketch
from eightpost.ident.shock.problem import Solution
from eightpost.ident.shock.result import ShockFit, Story, result_of
from eightpost.ident.shock.robust import (
    Robust,
    downweighted_rows,
    screened_force,
    weights_for,
    without_motion_spikes,
    without_spikes,
)
from eightpost.ident.shock.runs import Runs, prepare_runs
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS
from eightpost.shock.curve import INNER_ORDER

#: A name in `LAWS`.
LawName = str
RecipeName = Literal["joint", "boggs"]
GasTreatment = Literal["estimate", "included", "subtracted"]

#: Maximum number of searches for spikes, and of reweightings.
_SCREENINGS, _WEIGHINGS = 3, 4


@dataclass(frozen=True, slots=True)
class Choices:
    """Options of a fit.

    Attributes:
        recipe: `joint` (all parameters together) or `boggs` (one after the other, as in 3.3).
        gas: Treatment of the gas force F_0 + K (x - x_ref), x_ref the mean displacement: `estimate` fits it and
            makes it part of the shock; `included` fits it and leaves it out of the shock, because the car's static load
            includes it; `subtracted`: the dynamometer has already subtracted it.
        shape: Constraint on the curve: `auto`, `free`, `monotone`, `passive`.
        order: Order of the inner polynomial, 1 to 15; None: by cross-validation (boggs: always 15).
        robust: Treatment of outliers: `auto`, `none`, `huber`, `tukey` (boggs: always none).
    """

    recipe: RecipeName = "joint"
    gas: GasTreatment = "estimate"
    shape: Shape = "auto"
    order: int | None = None
    robust: Robust = "auto"

    def check(self, law: str) -> None:
        """Check that all options are known.

        Raises:
            ParameterError: An option or the law is unknown.
        """
        options = (
            ("law", law, tuple(LAWS)),
            ("recipe", self.recipe, get_args(RecipeName)),
            ("gas treatment", self.gas, get_args(GasTreatment)),
            ("shape", self.shape, get_args(Shape)),
            ("robust", self.robust, get_args(Robust)),
        )
        for what, value, choices in options:
            if value not in choices:
                raise ParameterError(f"unknown {what} {value!r}; it must be one of {', '.join(choices)}")
        if self.order is not None and not 1 <= self.order <= INNER_ORDER:
            raise ParameterError(f"the order of the inner polynomial must be 1 to {INNER_ORDER}, not {self.order!r}")

    @property
    def ceiling(self) -> float:
        """The upper bound of the transition forces for any record [N]."""
        return Boggs.ceiling if self.recipe == "boggs" else Joint.ceiling


def fit_shock(
    tests: DynoTest | Sequence[DynoTest],
    law: LawName,
    *,
    recipe: RecipeName = "joint",
    gas: GasTreatment = "estimate",
    shape: Shape = "auto",
    order: int | None = None,
    robust: Robust = "auto",
    name: str | None = None,
    segment: tuple[float, float] | None = None,
    cutoff: float | None = None,
    transition_speed: float | None = None,
) -> ShockFit:
    """Fit a law to a dynamometer test, or to several runs of one build together.

    Args:
        tests: Records of velocity and force, for the gas stiffness also displacement; positive in compression. Several
            runs share curve, law and gas stiffness; each has its own gas offset.
        law: Name in `LAWS`.
        recipe: `joint` or `boggs`; see `Choices` for this and the next four arguments.
        gas: Treatment of the gas force.
        shape: Constraint on the curve.
        order: Order of the inner polynomial.
        robust: Treatment of outliers.
        name: Name of the shock; default the build, else the file's name.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
        transition_speed: Transition speed of the curve [m/s]; default 15 in/s, less for a slow record.

    Raises:
        ParameterError: The law or an option is unknown, or an option does not suit the record.
        TooShortError: A record has too few samples.
    """
    choices = Choices(recipe, gas, shape, order, robust)
    choices.check(law)
    started = time.perf_counter()
    given = [tests] if isinstance(tests, DynoTest) else list(tests)

    def prepared(records: Sequence[DynoTest]) -> Runs:
        return prepare_runs(records, segment=segment, cutoff=cutoff, transition_speed=transition_speed)

    # Threads do not speed up matrices this small, and they slow down other work on the same processors.
    with threadpool_limits(1, "blas"):
        if recipe == "boggs" or robust == "none":
            runs, spikes, notes = prepared(given), 0, list[str]()
        else:
            runs, spikes, notes = _screened(given, prepared)
        solution, notes_of_fit, down = _solved(runs, law, choices)
        changes = (*runs.changes, *notes, *notes_of_fit, *solution.notes)
        story = Story(recipe, gas, name, changes, spikes + down)
        result = result_of(given, solution, story, 0.0)
    return replace(result, seconds=time.perf_counter() - started)


def _screened(tests: Sequence[DynoTest], prepared: Callable[[Sequence[DynoTest]], Runs]) -> tuple[Runs, int, list[str]]:
    """Return runs without spikes, the number of replaced samples, and notes on what was replaced."""
    cleaned, notes = [], []
    total = 0
    for test in tests:
        clean, found = without_motion_spikes(test)
        cleaned.append(clean)
        total += sum(found.values())
        notes += [f"{count} outlying samples of {name} were replaced" for name, count in found.items()]
    runs, counts = prepared(cleaned), [0] * len(cleaned)
    for _ in range(_SCREENINGS):
        forces = screened_force(runs)
        found_now = [without_spikes(t, p, f) for t, p, f in zip(cleaned, runs.prepared, forces, strict=True)]
        if [count for _, count in found_now] == counts:
            break
        counts = [count for _, count in found_now]
        runs = prepared([test for test, _ in found_now])
    spikes = sum(counts)
    if spikes:
        notes.append(f"{spikes} samples of the force were replaced: spikes, far from the model, and their neighbours")
    return runs, total + spikes, notes


def _solved(runs: Runs, law: str, choices: Choices) -> tuple[Solution, list[str], int]:
    """Return the solution, notes on fixed parameters, and the number of down-weighted samples."""
    limits = limits_for(runs.measured, runs.rate, ceiling=choices.ceiling)
    gas, gas_notes = gas_columns(runs, choices.gas)
    dynamics = dynamics_for(LAWS[law], limits)
    models = Models(runs, gas, dynamics)
    notes = [*dynamics.changes(), *models.changes, *gas_notes]
    if choices.recipe == "boggs":
        return Boggs().fit(models), notes, 0
    solution = _robust_solution(Joint(choices.shape, choices.order), models, weights_for(choices.robust))
    down = downweighted_rows(solution.model.runs.weights)
    samples = round(down * runs.measured.size / runs.weights.size)
    if samples:
        notes.append(f"{samples} samples ({100.0 * down / runs.weights.size:.2g} %) were down-weighted as outliers")
    return solution, notes, samples


def _robust_solution(joint: Joint, models: Models, weigh: Callable[[Array, float], Array] | None) -> Solution:
    """Return the solution with weights that follow its own residuals; without `weigh` all samples have equal weight."""
    if weigh is None:
        return joint.fit(models)
    sketch = _reweighted(joint, joint.sketch(models), weigh)
    whole = joint.finished(sketch)
    if not sketch.is_final and (sketch.weights < 1.0).any():
        weights = weigh(whole.error, models.runs.deviation)
        whole = whole if _nearly_equal(weights, whole.weights) else joint.reweighted(whole, weights)
    return joint.solution(whole)


def _reweighted(joint: Joint, first: Sketch, weigh: Callable[[Array, float], Array]) -> Sketch:
    """Return a sketch with weights that follow its own residuals; the last reweighting is done on the whole record."""
    sketch = first
    for count in range(_WEIGHINGS if first.is_final else _WEIGHINGS - 1):
        weights = weigh(sketch.error, sketch.models.runs.deviation)
        if _nearly_equal(weights, sketch.weights):
            break
        if count and (weights == first.weights).all():
            return first  # no outliers after all; further reweighting would alternate between two results
        # The order of the curve may change at the first reweighting only.
        sketch = joint.reweighted(sketch, weights) if count else joint.reordered(sketch, weights)
    return sketch


def _nearly_equal(weights: Array, others: Array) -> bool:
    """Return whether weights (R,) are so close to others that a fit with them would be the same."""
    return bool(np.abs(weights - others).max() < 0.05)
