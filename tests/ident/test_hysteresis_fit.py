"""The fit of the law Hysteresis finds known parameters, and a stop only where the records show one."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from eightpost.ident import evaluate, fit_shock
from eightpost.ident.shock.curve import KnotBasis, curve_forces
from eightpost.ident.shock.force import limits_for
from eightpost.ident.shock.hysteresis import HysteresisProblem, LaggedVelocity, fit_hysteresis
from eightpost.ident.shock.law_fit import Choices
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.simulation import simulate
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Hysteresis, Port, read_shock, write_shock
from eightpost.shock.curve import KNOTS
from eightpost.signals import TimeSeries

RATE = 500.0
#: Range of velocities of the random record [m/s], so that the nodes of ln tau of truth and fit agree.
RANGE = np.array([-0.790, 0.672])
TAUS = (6e-3, 2e-3, 4e-3)
STOP = (4e5, 3e-4, 2e-2)
PORT = Port(gas_preload=150.0, gas_stiffness=900.0)


def hysteresis(*, stop=(), port=PORT, share=0.6):
    """Return a degressive law, asymmetric, with a given share of its slopes behind the lag."""
    basis = KnotBasis.of(RANGE, cells=12)
    knots = np.array(basis.knots)
    slopes = (900.0 + 5000.0 / (1.0 + (knots / 0.15) ** 2)) * np.where(knots > 0.0, 1.0, 1.3)
    lagged = tuple((share * slopes).tolist())
    return Hysteresis(basis.static_curve(slopes), lagged, TAUS, *stop, port=port)


def f1(law, velocity):
    """Return the lagged part of a law's curve [N] at velocities."""
    return KnotBasis(law.curve.knot_velocity).design(velocity) @ np.array(law.lagged_slope)


def sine(law, speed, *, hertz=1.6, duration=6.0):
    """Return the record of a law under a sine of a peak speed [m/s], sampled finely in the simulation."""
    time = np.arange(round(duration * 4.0 * RATE)) / (4.0 * RATE)
    phase = 2.0 * np.pi * hertz * time
    motion = {
        "velocity": ("m/s", speed * np.sin(phase)),
        "displacement": ("m", -speed / (2.0 * np.pi * hertz) * np.cos(phase)),
    }
    series = TimeSeries.from_channels(time, motion)
    force = simulate(law, series) + np.random.default_rng(1).standard_normal(time.size)
    return DynoTest(series.with_channel("force", "N", force).at(slice(None, None, 4)))


@lru_cache
def projection(*, has_stop):
    """Return the problem of a short record, and a point of its search."""
    law = hysteresis(stop=STOP if has_stop else ())
    runs = prepare_runs([sine(law, 1.2, duration=3.0), sine(law, 0.3, duration=3.0)])
    model = fit_hysteresis([runs], "hysteresis", Choices()).fit.model
    model = replace(model, models=(replace(model.first, dynamics=replace(model.dynamics, has_stop=has_stop)),))
    point = np.log([8e-3, 3e-3, 2e-3, 5e-4, 1e-2][: 5 if has_stop else 3])
    return HysteresisProblem(model, is_thin=False), point


# ---- Recovery -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fit(law_record):
    """The fit to a record of a law without a stop."""
    return fit_shock(law_record(hysteresis(), 1, rate=RATE), "hysteresis")


def test_curves_time_constants_and_gas_of_a_known_law_are_found(fit):
    truth, found = hysteresis(), fit.shock.law
    velocity = np.linspace(*(0.9 * RANGE), 200)
    whole, lagged = curve_forces(truth.curve, velocity), f1(truth, velocity)
    assert np.sqrt(np.mean((curve_forces(found.curve, velocity) - whole) ** 2)) < 0.005 * np.std(whole)
    assert np.sqrt(np.mean((f1(found, velocity) - lagged) ** 2)) < 0.05 * np.std(lagged)
    assert found.time_constant == pytest.approx(TAUS, rel=0.12)  # its evenness is rewarded a little
    assert fit.parameter("gas_preload").value == pytest.approx(150.0, abs=15.0)
    assert fit.parameter("gas_stiffness").value == pytest.approx(900.0, rel=0.1)
    assert found.stop_stiffness == 0.0
    assert fit.percent < 0.3
    assert fit.converged


def test_the_intervals_of_the_time_constants_are_narrow_and_close_to_the_truth(fit):
    for number, true in enumerate(TAUS, start=1):
        tau = fit.parameter(f"time_constant[{number}]")
        assert tau.unit == "s"
        assert abs(tau.value - true) < tau.reach * tau.error + 0.1 * true
        assert tau.error < 0.05 * true


@pytest.mark.nightly
def test_the_stated_residual_is_that_of_the_shipped_law_and_that_of_the_search(law_record):
    test = law_record(hysteresis(port=Port()), 1, rate=RATE)
    fit = fit_shock(test, "hysteresis", gas="included", robust="none")
    search = fit_hysteresis([prepare_runs([test])], "hysteresis", Choices(gas="included", robust="none")).fit
    assert evaluate(fit.shock, test).rms == pytest.approx(fit.rms, rel=1e-9)
    assert fit.rms == pytest.approx(np.sqrt(np.mean(search.error**2)), rel=0.02)


@pytest.mark.slow
def test_a_known_stop_is_found_and_noted(law_record):
    fit = fit_shock(law_record(hysteresis(stop=STOP), 1, rate=RATE), "hysteresis", segment=(1.0, 6.0))
    found = [fit.parameter(name) for name in ("stop_stiffness", "stop_yield", "stop_time")]
    assert [one.value for one in found] == pytest.approx(STOP, rel=0.25)
    assert [one.unit for one in found] == ["N/m", "m", "s"]
    assert any(change.startswith("the law has a stop: held-out error") for change in fit.changes)


@pytest.mark.slow
@pytest.mark.parametrize(("speeds", "is_wide"), [((0.3,), True), ((0.3, 0.9), False)])
def test_the_interval_of_the_preload_contains_twice_its_difference_from_that_of_lpnl2_if_there_is_one_motion(
    speeds, is_wide
):
    records = [sine(hysteresis(), speed) for speed in speeds]
    own, other = (fit_shock(records, law).parameter("gas_preload") for law in ("hysteresis", "lpnl2"))
    assert own.value == pytest.approx(150.0, abs=3.0)
    assert (own.reach * own.error > 2.0 * abs(own.value - other.value) > 0.0) is is_wide
    assert own.reach * own.error < 5.0


def test_a_stop_that_hardly_lowers_the_error_is_left_out_without_a_word(fit):
    assert not any("stop" in change for change in fit.changes)
    assert "stop_stiffness" not in {parameter.name for parameter in fit.parameters}


@pytest.mark.slow
def test_a_test_of_one_speed_has_a_stop_of_at_most_a_tenth_of_a_second_if_it_predicts_left_out_parts_better():
    fit = fit_shock(sine(hysteresis(stop=STOP), 0.4), "hysteresis", segment=(0.5, 5.5))
    assert any(change.startswith("the law has a stop: held-out error") for change in fit.changes)
    assert fit.parameter("stop_time").bounds == (3e-4, 0.1)


@pytest.mark.nightly
def test_each_run_has_its_own_offset(law_record):
    one, other = (
        law_record(hysteresis(port=replace(PORT, gas_preload=preload)), 1, rate=RATE) for preload in (100.0, 300.0)
    )
    fit = fit_shock([one, other], "hysteresis", segment=(1.0, 5.0))
    assert fit.percent < 0.5
    assert fit.parameter("gas_preload").value == pytest.approx(200.0, abs=15.0)


def test_a_fit_is_saved_and_read_back(fit, tmp_path):
    write_shock(fit.shock, tmp_path / "shock.json")
    assert read_shock(tmp_path / "shock.json").law == fit.shock.law


# ---- The search -----------------------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("has_stop", [False, True])
def test_the_step_of_the_search_follows_the_gradient_of_the_cost(has_stop):
    problem, point = projection(has_stop=has_stop)
    here = problem.at(point)
    _, right = here.normal_equations
    step = 1e-4
    units = step * np.eye(point.size)
    slopes = [(problem.at(point + unit).cost - problem.at(point - unit).cost) / (2.0 * step) for unit in units]
    assert -2.0 * right == pytest.approx(np.array(slopes), rel=0.02, abs=1e-3 * np.abs(slopes).max())


@pytest.mark.repeated
@pytest.mark.parametrize("has_stop", [False, True])
def test_the_linear_parameters_are_the_best_ones_for_given_states(has_stop):
    problem, point = projection(has_stop=has_stop)
    here, problem = problem.at(point).parts[0], problem.parts[0]
    rows = np.vstack([here.columns, problem.penalty])
    target = np.append(problem.model.runs.target, np.zeros(len(problem.penalty)))
    low = np.where(problem.is_free, -np.inf, 0.0)
    best = lsq_linear(rows, target, bounds=(low, np.inf), method="bvls", tol=1e-14).x
    cost = [float(np.sum((rows @ x - target) ** 2)) for x in (here.linear, best)]
    assert (here.linear[~problem.is_free] >= 0.0).all()
    assert cost[0] <= cost[1] * (1.0 + 1e-6)


@pytest.mark.repeated
@pytest.mark.parametrize("has_stop", [False, True])
def test_the_derivatives_of_the_force_are_those_of_differences(has_stop):
    problem, point = projection(has_stop=has_stop)
    model, generator = problem.model.first, np.random.default_rng(2)
    slopes = 1000.0 + 500.0 * generator.random(25)
    stop = [80.0] * has_stop
    theta = np.concatenate([0.5 * slopes, point[:3], stop, point[3:]])
    parameters = np.concatenate([slopes, 50.0 * np.ones(model.gas.count), theta])
    jacobian = model.rows_jacobian(parameters)
    for number in range(0, parameters.size, 3):
        step = np.zeros(parameters.size)
        step[number] = 1e-4 * max(abs(parameters[number]), 1.0)
        change = (model.rows(parameters + step) - model.rows(parameters - step)) / (2.0 * step[number])
        assert jacobian[:, number] == pytest.approx(change, abs=2e-3 * np.abs(jacobian[:, number]).max() + 1e-9)


@pytest.mark.parametrize("end", [0.0, 150.0, 300.0])
def test_a_curve_that_ends_flat_rises_beyond_the_record_by_a_fifth_of_its_mean_slope(end):
    basis = KnotBasis.of(np.array([-1.0, 1.0]), cells=KNOTS // 2)
    slopes = np.full(KNOTS, 1000.0)
    slopes[[0, -1]] = end
    dynamics = LaggedVelocity.of(Hysteresis, limits_for(np.linspace(-1000.0, 1000.0, 50), RATE), RATE)
    curve = basis.static_curve(slopes)
    found = dynamics.law(curve, Port(), np.append(np.zeros(KNOTS), np.log([5e-3] * 3))).curve
    expected = max(end, 0.2 * curve.knot_force[-1])
    assert (expected > end) is (end < 190.0)
    assert (found.compression_slope, found.rebound_slope) == pytest.approx((expected, expected))
    assert (found.knot_force, found.knot_slope) == (curve.knot_force, curve.knot_slope)
