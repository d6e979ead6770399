"""Fit a shock law to dynamometer tests (3.3)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import Bounds, minimize
from threadpoolctl import threadpool_limits

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.curve import CurveBasis, knot_basis, working_basis
from eightpost.ident.shock.dynamics import FadingLag, FullLag, NoLag, best_lag, dynamics_for
from eightpost.ident.shock.force import FORCE, ForceModel, GasTreatment, gas_columns, limits_for
from eightpost.ident.shock.hysteresis import fit_hysteresis
from eightpost.ident.shock.law_fit import (
    Choices,
    CrossValidation,
    HeldOutErrors,
    LawName,
    RecipeName,
    fit_law,
    has_own_recipe,
)
from eightpost.ident.shock.problem import Solution, blocks_of, covariances
from eightpost.ident.shock.result import ShockFit, Story, result_of
from eightpost.ident.shock.runs import PreparedRun, Runs, prepare_runs, slower_peak
from eightpost.ident.shock.verdict import BuildSpread, build_spread
from eightpost.least_squares import NORMAL, Directions, Robust, linear_solution
from eightpost.progress import portion
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS
from eightpost.units import convert

# ==== Recipe boggs (3.3): the curve, then tau on a grid, then LPNL2's parameters by constrained search ===============
# The curve is fitted without lag to the low-passed record and then kept; the model's force is not low-passed again.

#: Spacing of the time constants on the grid [s] (3.3.2).
INCREMENT = 1e-4

#: Starting values of the transition forces, relative to the peak static force.
_STARTS = ((0.1, 0.5), (0.3, 0.9), (0.6, 1.5))

_NEGATIVE = "gas stiffness fixed at 0: the fit to this record would make it negative"


#: Transition speed between low and high speed and its width [m/s]: 15 and 0.5 in/s (3.3.1).
TRANSITION_SPEED, TRANSITION_WIDTH = convert(15.0, "in/s", "m/s"), convert(0.5, "in/s", "m/s")

#: If the slower side of the fastest record peaks below this many transition speeds, the transition moves to this share
#: of the peak.
_SLOW, _MOVED = 1.25, 0.6

#: Minimum number of samples for fitting an outer cubic; with fewer the inner polynomial continues as a straight line.
FEWEST_OUTER = 50


def fit_boggs(runs: Runs, law: str, gas: GasTreatment) -> Solution:
    """Return the dissertation's solution, with the printed bounds and a note for each change.

    Raises:
        ParameterError: The dissertation has no recipe for the law.
    """
    columns, notes = gas_columns(runs, gas)
    dynamics = dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate, ceiling=FORCE[1]))
    if not isinstance(dynamics, NoLag | FullLag | FadingLag):
        raise ParameterError("recipe 'boggs' supports the dissertation's laws only; fit this law with 'joint'")
    curve = _curve(runs)
    straight = _sides_without_data(runs, curve.transition_speed)
    basis = working_basis(curve, runs.velocity, curve.ties(straight))
    static = _static(ForceModel(runs, basis, columns, dynamics))
    if isinstance(dynamics, FullLag):
        static = _on_grid(static, dynamics)
    elif isinstance(dynamics, FadingLag):
        static = _constrained(static, dynamics)
    ends = f"samples beyond the transition, {FEWEST_OUTER} are needed"
    lines = [f"straight line instead of the cubic in {side}: {count} {ends}" for side, count in straight.items()]
    notes = [*_transition_notes(runs, curve), *dynamics.changes(), *lines, *notes]
    return replace(static, notes=(*notes, *static.notes))


def _curve(runs: Runs) -> CurveBasis:
    """Return the basis functions of the curve; the transition moves within the speed of slow records."""
    slower = _slower_peak(runs)
    speed = _MOVED * slower if slower < _SLOW * TRANSITION_SPEED else TRANSITION_SPEED
    return CurveBasis(speed, TRANSITION_WIDTH * speed / TRANSITION_SPEED)


def _slower_peak(runs: Runs) -> float:
    return max(slower_peak(p.record["velocity"][p.inside]) for p in runs.prepared)


def _transition_notes(runs: Runs, curve: CurveBasis) -> list[str]:
    if curve.transition_speed == TRANSITION_SPEED:
        return []
    why = f"the record's slower side reaches {_inch(_slower_peak(runs))}"
    speed, width = _inch(curve.transition_speed), _inch(curve.transition_width)
    return [f"transition moved from 15 in/s to {speed}, its width from 0.5 to {width}: {why}"]


def _inch(speed: float) -> str:
    return f"{convert(speed, 'm/s', 'in/s'):.3g} in/s ({speed:.3g} m/s)"


def _sides_without_data(runs: Runs, transition: float) -> dict[str, int]:
    """Return each side with too few samples beyond the transition for a cubic, with the number of these samples."""
    velocity = runs.velocity[runs.inside]
    sides = {"compression": velocity > transition, "rebound": velocity < -transition}
    counts = {side: int(np.sum(beyond)) for side, beyond in sides.items()}
    return {side: count for side, count in counts.items() if count < FEWEST_OUTER}


def _static(model: ForceModel) -> Solution:
    columns, target = model.linear_columns[model.runs.inside], model.runs.measured
    weights = linear_solution(columns, target)
    if model.gas.size and weights[-1] < 0.0:
        return replace(_static(replace(model, gas=model.gas.without_stiffness())), notes=(_NEGATIVE,))
    at_rows = np.hstack([model.curve_rows(), model.gas_rows])
    error = at_rows @ weights - model.runs.target
    directions = Directions.of(at_rows)
    spread, left_out = covariances(directions, error, model.runs), directions.moves(error, blocks_of(model.runs))
    return Solution(model, weights, spread, True, "linear least squares", left_out=left_out)


def _on_grid(static: Solution, dynamics: FullLag) -> Solution:
    """Return the best of tau = 0.1, 0.2, .. 10 ms within the bounds."""
    lowest, highest = dynamics.limits.time_constant
    first, last = int(np.ceil(lowest / INCREMENT * (1.0 - 1e-9))), int(np.floor(highest / INCREMENT * (1.0 + 1e-9)))
    grid = [number * INCREMENT for number in range(first, last + 1)]
    errors = [_error(static, np.array([tau])) for tau in grid]
    return _with_theta(static, np.array([grid[int(np.argmin(errors))]]), True, f"best of {len(grid)} time constants")


def _constrained(static: Solution, dynamics: FadingLag) -> Solution:
    """Minimise over tau and the transition forces by SLSQP, from LPF1's tau and a few pairs of forces."""
    simple = replace(static, model=static.model.with_dynamics(FullLag(dynamics.limits)))
    tau = float(_on_grid(simple, FullLag(dynamics.limits)).parameters[-1])
    curve = static.parameters[: static.model.curve_count]
    peak = float(np.abs(static.model.basis.columns @ curve).max())
    unit = np.array([1e-3, peak, peak])
    bounds = np.array(dynamics.value_bounds()) / unit[:, None]

    def error(values: Array) -> float:
        return _error(static, dynamics.theta(*(values * unit).tolist()))

    def apart(values: Array) -> float:
        return float(values[2] - values[1]) - dynamics.limits.gap / peak

    results = [
        minimize(
            error,
            np.clip(np.array([tau, full * peak, zero * peak]) / unit, *bounds.T),
            method="SLSQP",
            bounds=Bounds(*bounds.T),
            constraints={"type": "ineq", "fun": apart},
            options={"ftol": 1e-9, "maxiter": 100},
        )
        for full, zero in _STARTS
    ]
    best = min(results, key=lambda result: float(result.fun))
    theta = dynamics.theta(*(best.x * unit).tolist())
    return _with_theta(static, theta, bool(best.success), f"SLSQP: {best.message}")


def _error(static: Solution, theta: Array) -> float:
    """Return the mean square error over the force's variance [1] with a fixed curve."""
    model = static.model
    force = model.force(np.append(static.parameters, theta))[model.runs.inside]
    return float(np.mean((force - model.runs.measured) ** 2)) / model.runs.deviation**2


def _with_theta(static: Solution, theta: Array, converged: bool, status: str) -> Solution:
    """Add theta to the static solution; its covariance is that of theta alone, because the curve was fixed."""
    model, m = static.model, static.parameters.size
    parameters = np.append(static.parameters, theta)
    spread = np.zeros((len(static.covariance), parameters.size, parameters.size))
    spread[:, :m, :m] = static.covariance
    by_theta = Directions.of(model.rows_jacobian(parameters)[:, model.linear_count :])
    error = model.rows(parameters) - model.runs.target
    spread[:, m:, m:] = covariances(by_theta, error, model.runs)
    left_out = np.hstack([static.left_out, by_theta.moves(error, blocks_of(model.runs))])
    return Solution(model, parameters, spread, converged, status, static.notes, left_out)


# ==== Spikes, replaced before the fit ================================================================================


def screened_force(runs: Runs) -> list[Array]:
    """Return the force of a single-lag model (N,) [N] over each run."""
    limits = limits_for(runs.measured, runs.rate)
    basis = knot_basis(runs.velocity, runs.inside)
    model = ForceModel(runs, basis, gas_columns(runs, "estimate")[0], FullLag(limits))
    force = model.force(best_lag(model, limits.time_constant))
    return [np.asarray(force[part]) for part in runs.parts]


#: A raw sample is a spike if it exceeds this many standard deviations of the noise, ...
_SPIKE = 10.0

#: ... and differs by this share of the force's standard deviation from a running median of this many samples. The
#: median follows anything longer than half of its samples; smaller spikes have no effect after the low-pass.
_SPIKES = ((5, 0.1), (7, 0.25))

#: Below this number of samples per period of the cutoff frequency, spikes cannot be distinguished from the motion.
_FINE = 10.0


def _spikes_of(raw: Array, predicted: Array, deviation: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return a raw signal (N,) without its spikes, and which samples (N,) were spikes."""
    left, clean = raw - predicted, raw
    for size, share in _SPIKES:
        rest = left - median_filter(left, size=size, mode="nearest")
        noise = NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, share * deviation)
        clean = np.where(spiked & (clean == raw), raw - rest, clean)
    return clean, clean != raw


def without_spikes(test: DynoTest, prepared: PreparedRun, force: Array) -> tuple[DynoTest, int]:
    """Return a test whose force has no spikes over the prepared segment, and the number of replaced samples."""
    if test.series.sample_rate < _FINE * prepared.cutoff:
        return test, 0
    time = test.series.time - test.series.time[0]
    here = (time >= prepared.record.time[0]) & (time <= prepared.record.time[-1])
    predicted = np.interp(time[here], prepared.record.time, force)
    whole = test.series["force"].copy()
    whole[here], spiked = _spikes_of(whole[here], predicted, prepared.deviation)
    if not spiked.any():
        return test, 0
    return replace(test, series=test.series.with_channel("force", "N", whole)), int(spiked.sum())


def without_motion_spikes(test: DynoTest) -> tuple[DynoTest, dict[str, int]]:
    """Return a test whose motion has no outlying single samples, and the number of replaced samples by channel."""
    found: dict[str, int] = {}
    series = test.series
    for name in ("velocity", "displacement"):
        if name not in series:
            continue
        values = series[name]
        smooth = median_filter(values, size=5, mode="nearest")
        rest = values - smooth
        noise = NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, 0.1 * float(np.ptp(np.quantile(values, (0.01, 0.99)))))
        if spiked.any():
            found[name] = int(spiked.sum())
            series = series.with_channel(name, series.units[series.names.index(name)], np.where(spiked, smooth, values))
    return (replace(test, series=series), found) if found else (test, found)


#: Maximum number of searches for spikes.
_SCREENINGS = 3


def screened_runs(
    tests: Sequence[DynoTest], prepared: Callable[[Sequence[DynoTest]], Runs]
) -> tuple[Runs, int, list[str]]:
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


# ==== Fits of all laws ===============================================================================================

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
            solution, downweighted, held_out, level = _solved(runs, law, choices)
        changes = (*runs.changes, *notes, *solution.notes)
        spread, unfitted = _between_builds(runs, solution, law, choices)
        story = Story(recipe, gas, name, (*changes, *unfitted), spikes + downweighted, held_out, spread, level)
        result = result_of(given, solution, story, 0.0)
    return replace(result, seconds=time.perf_counter() - started)


def _solved(runs: Runs, law: str, choices: Choices) -> tuple[Solution, int, HeldOutErrors | None, float]:
    """Return the solution with notes, the number of down-weighted samples, held-out errors, and `Story.level`."""
    if choices.recipe == "boggs":
        return fit_boggs(runs, law, choices.gas), 0, None, 0.0
    fitted = fit_of([runs], law, choices)
    solution, (samples, notes) = fitted.fit.solution().solution(), fitted.fit.downweighted()
    held_out, more, preload = _held_out(fitted, choices)
    level = 0.0 if preload is None else solution.preload - preload
    return replace(solution, notes=(*fitted.fit.notes, *notes, *solution.notes, *more)), samples, held_out, level


def fit_of(groups: Sequence[Runs], law: str, choices: Choices) -> CrossValidation:
    """Return the joint fit of a law to the runs of one or more settings, ready for cross-validation.

    Raises:
        ValueError: The law or the fit rejects the data.
    """
    if has_own_recipe(law):
        return fit_hysteresis(groups, law, choices)
    return CrossValidation(fit_law(groups, law, choices))


def _held_out(fitted: CrossValidation, choices: Choices) -> tuple[HeldOutErrors | None, tuple[str, ...], float | None]:
    """Return the errors of a law and of LPNL2 on the same left-out parts, a note on what cannot be fitted, and the
    preload of LPNL2 [N] where the runs have one motion.
    """
    runs, law, weights = fitted.fit.runs, fitted.fit.law, fitted.fit.runs.weights
    try:
        own = fitted.errors(weights)
    except ValueError as error:  # raised by laws and fits that reject a part of the data
        return None, (f"no held-out error: a part of the record cannot be fitted: {error}",), None
    if law == _BESIDE:
        return HeldOutErrors(fitted.left_out, own.percent), (), None
    try:
        beside = fit_of([runs.weighted(np.ones_like(weights))], _BESIDE, choices)
        other = beside.errors(weights)
    except ValueError as error:
        return HeldOutErrors(fitted.left_out, own.percent), (f"no held-out error of LPNL2: {error}",), None
    preload = beside.fit.solution().solution().preload if runs.has_one_motion else None
    return HeldOutErrors(fitted.left_out, own.percent, other.percent), (), preload


def _between_builds(
    runs: Runs, solution: Solution, law: str, choices: Choices
) -> tuple[BuildSpread | None, tuple[str, ...]]:
    """Return the spread between the builds of the runs, and notes; None for the runs of one build."""
    if len(runs.builds) < 2:
        return None, ()

    def fit_alone(own: Runs) -> Solution:
        is_boggs = choices.recipe == "boggs"
        return fit_boggs(own, law, choices.gas) if is_boggs else fit_of([own], law, choices).fit.solution().solution()

    return build_spread(runs, solution, fit_alone)
