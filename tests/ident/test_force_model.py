"""The Jacobians that the optimiser runs on are derivatives, and its rows are the low-passed force."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import knot_basis
from eightpost.ident.shock.dynamics import FadingLag, SteppedLaw, dynamics_for
from eightpost.ident.shock.force import ForceModel, gas_columns, limits_for
from eightpost.ident.shock.law_fit import _sketched
from eightpost.ident.shock.problem import FitModel, FitProblem
from eightpost.ident.shock.runs import prepare_runs
from eightpost.ident.shock.simulation import RowFilter, lag, lag_sensitivity
from eightpost.least_squares import linear_solution
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, Lpf1, Lpnl2
from eightpost.shock.law import advance
from eightpost.signals import lowpass

THETA = {"polylinear": [], "lpf1": [1.4e-3], "lpnl2": [1.4e-3, 500.0, 0.3]}


@pytest.fixture(scope="module")
def runs(curve, law_record):
    return prepare_runs([law_record(Lpf1(curve, 1.3e-3), 1)])


def model_of(runs, law):
    gas, _ = gas_columns(runs, "estimate")
    dynamics = dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate))
    return ForceModel(runs, knot_basis(runs.velocity, runs.inside), gas, dynamics)


@pytest.fixture(params=THETA)
def case(request, runs):
    model = model_of(runs, request.param)
    linear = linear_solution(np.hstack([model.curve_rows(), model.gas_rows]), runs.target)
    return FitProblem(FitModel((model,))), np.append(linear, THETA[request.param])


@pytest.mark.repeated
def test_the_jacobian_is_the_central_difference(case):
    problem, parameters = case
    found = problem.jacobian(parameters)
    scales = [*np.full(problem.model.first.linear_count, problem.model.runs.deviation), 1e-3, 100.0, 0.1]
    for number, scale in enumerate(scales[: parameters.size]):
        small = np.zeros(parameters.size)
        small[number] = 1e-5 * scale
        expected = (problem.residual(parameters + small) - problem.residual(parameters - small)) / (2e-5 * scale)
        error = np.linalg.norm(found[:, number] - expected) / np.linalg.norm(expected)
        assert error < 2e-3, (number, error)  # alpha has corners: a few samples change sides


@pytest.mark.parametrize("law", THETA)
def test_the_rows_are_the_low_passed_force_of_the_whole_record(runs, law):
    model = model_of(runs, law)
    linear = linear_solution(np.hstack([model.curve_rows(), model.gas_rows]), runs.target)
    parameters = np.append(linear, THETA[law])
    slow = runs.first.filtered(model.force(parameters))[runs.filters[0].rows]
    np.testing.assert_allclose(model.rows(parameters), slow, atol=2e-3 * runs.deviation)
    middle = slice(50, -50)
    np.testing.assert_allclose(model.rows(parameters)[middle], slow[middle], atol=1e-4 * runs.deviation)


def test_values_of_lpnl2_come_back_and_keep_their_order(runs):
    dynamics = dynamics_for(Lpnl2, limits_for(runs.measured, runs.rate))
    np.testing.assert_allclose(dynamics.values(dynamics.theta(1e-3, 400.0, 900.0)), (1e-3, 400.0, 900.0))
    (_, low, _), (_, high, _) = dynamics.bounds()
    for full in (low, 0.5 * (low + high), high):
        for share in (0.0, 0.5, 1.0):
            _, first, second = dynamics.values(np.array([1e-3, full, share]))
            assert dynamics.limits.gap * (1 - 1e-9) <= second - first
            assert second <= dynamics.limits.force[1] * (1 + 1e-12)


@pytest.fixture(scope="module")
def brief(curve, law_record):
    return prepare_runs([law_record(Lpf1(curve, 1.3e-3), 1)], segment=(1.0, 5.0))


def test_a_law_that_is_known_only_by_its_file_has_the_derivatives_of_its_own_form(brief):
    """LPF1 has a form of its own with exact derivatives; the general one takes differences on a thinned record."""
    own = model_of(brief, "lpf1")
    general = own.with_dynamics(SteppedLaw(own.dynamics.limits, Lpf1))
    linear = linear_solution(np.hstack([own.curve_rows(), own.gas_rows]), brief.target)
    exact = own.rows_jacobian(np.append(linear, 1.4e-3))
    exact[:, -1] *= 1.4e-3  # by the logarithm
    found = general.rows_jacobian(np.append(linear, np.log(1.4e-3)))
    error = np.linalg.norm(found - exact, axis=0) / np.linalg.norm(exact, axis=0)
    assert error.max() < 2e-2


def test_a_law_that_is_known_only_by_its_file_starts_with_the_parameter_that_acts_like_the_lag(brief):
    """The scan has nine values over a factor of 900 or less."""
    own = model_of(brief, "lpf1")
    general = own.with_dynamics(SteppedLaw(own.dynamics.limits, Lpf1))
    full_lag = np.append(linear_solution(own.curve_rows(1.3e-3), brief.target), 1.3e-3)
    (found,) = general.dynamics.like_full_lag(general, full_lag)
    assert found == pytest.approx(np.log(1.3e-3), abs=np.log(900.0) / 16.0)


@pytest.fixture(scope="module")
def faulty(digressive_record):
    """Return a record of a digressive valve whose force is constant for 30 ms, twice."""
    test = digressive_record(1)
    force = test.series["force"].copy()
    for start in (4000, 9000):
        force[start : start + 60] = force[start]
    return DynoTest(test.series.with_channel("force", "N", force))


@pytest.mark.nightly
@pytest.mark.parametrize("fault", [False, True])
def test_the_fit_is_that_on_all_samples(fault, digressive_record, faulty, monkeypatch):
    test = faulty if fault else digressive_record(1)
    quick = fit_shock(test, "lpnl2")
    monkeypatch.setattr(FadingLag, "is_costly", False)
    slow = fit_shock(test, "lpnl2")
    assert (quick.downweighted > 0) is fault
    assert quick.percent == pytest.approx(slow.percent, rel=1e-3)
    for parameter in slow.parameters:
        low, high = parameter.interval or (-np.inf, np.inf)
        assert low <= quick.parameter(parameter.name).value <= high


@pytest.fixture(scope="module")
def model(digressive_record):
    runs = prepare_runs([digressive_record(1)])
    dynamics = dynamics_for(LAWS["lpnl2"], limits_for(runs.measured, runs.rate))
    return ForceModel(runs, knot_basis(runs.velocity, runs.inside), gas_columns(runs, "estimate")[0], dynamics)


def test_a_model_at_other_weights_has_the_same_curve(model):
    coarse, weights = model.coarse, np.linspace(0.0, 1.0, model.runs.weights.size)
    weighed = model.weighted(weights)
    assert weighed.basis is model.basis and weighed.coarse.basis is coarse.basis
    np.testing.assert_array_equal(weighed.coarse.runs.weights, weights)
    np.testing.assert_array_equal(weighed.curve_rows(), model.curve_rows())
    assert model.runs.weights.min() == 1.0


def test_a_law_that_is_linear_in_its_curve_is_not_sketched(model):
    whole = FitModel((model,))
    assert _sketched(whole).model.first is model.coarse
    lpf1 = whole.with_dynamics(dynamics_for(LAWS["lpf1"], model.dynamics.limits))
    assert _sketched(lpf1).model is lpf1


forces = arrays(np.float64, 40, elements=st.floats(-3000.0, 3000.0, allow_subnormal=False))


def stepped(static, time_constant, step):
    lagged = [static[0]]
    for start, end in pairwise(static):
        lagged.append(advance(lagged[-1], start, end, time_constant, step))
    return np.array(lagged)


@given(forces, st.floats(1e-4, 5e-2), st.floats(1e-4, 1e-2))
def test_the_filter_is_the_scalar_law_stepped(static, time_constant, step):
    expected = stepped(static.tolist(), time_constant, step)
    np.testing.assert_allclose(lag(static, time_constant, step), expected, rtol=1e-12, atol=1e-12 * 3000.0)


def test_each_column_is_lagged_independently():
    columns = np.random.default_rng(0).normal(size=(300, 4))
    together = lag(columns, 1.3e-3, 5e-4)
    for column, lagged in zip(columns.T, together.T, strict=True):
        np.testing.assert_allclose(lagged, lag(column, 1.3e-3, 5e-4), rtol=1e-14)


@pytest.mark.parametrize("time_constant", [1e-4, 1.3e-3, 2e-2])
def test_the_sensitivity_is_the_central_difference(time_constant):
    static = 1000.0 * np.random.default_rng(2).normal(size=500)
    small = 1e-5 * time_constant
    expected = (lag(static, time_constant + small, 5e-4) - lag(static, time_constant - small, 5e-4)) / (2 * small)
    found = lag_sensitivity(static, lag(static, time_constant, 5e-4), time_constant, 5e-4)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("rate", "cutoff"), [(120.0, 45.0), (300.0, 50.0), (3000.0, 50.0)])
def test_the_rows_are_those_of_the_low_pass(rate, cutoff):
    values = np.cumsum(np.random.default_rng(5).normal(size=(2, 3000)), axis=1)
    inside = np.zeros(3000, dtype=bool)
    inside[400:2500] = True
    rows = RowFilter.of(inside, rate, cutoff)
    expected = lowpass(values, rate, cutoff)[:, rows.rows]
    # Frequencies above half the rate of the rows are left out, where the low-pass leaves 1e-5 of them.
    np.testing.assert_allclose(rows(values), expected, atol=1e-5 * np.abs(values).max())
