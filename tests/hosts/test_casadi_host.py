"""CasADi takes our shocks and car.fmu by model exchange: derivatives, Jacobians, and errors of its integrators."""

import math

import numpy as np
import pytest


@pytest.fixture(scope="module")
def host(program):
    return program("casadi_host", "casadi")


@pytest.fixture(scope="module")
def shock(host, case, tmp_path_factory):
    return host.function_of(case(1e-3).shock, tmp_path_factory.mktemp("unpacked"))[1]


def slopes(function, at, size):
    """Return the Jacobian of a function of an array by central differences of fourth order."""
    columns = []
    for k in range(len(at)):
        e = np.zeros(len(at))
        e[k] = size[k]
        ahead, far = function(at + e) - function(at - e), function(at + 2.0 * e) - function(at - 2.0 * e)
        columns.append((8.0 * ahead - far) / (12.0 * size[k]))
    return np.array(columns).T


def law_of(program):
    """Return (lagged force, velocity, displacement) -> (derivative of the lagged force, force), from the equations."""
    law = program("reference").read_shock(program("reference").SHOCK).law

    def response(state):
        static = law.static_force(state[1])
        force = static + law.lag_weight(static) * (state[0] - static)
        return np.array([(static - state[0]) / law.time_constant, force])

    return response


@pytest.mark.parametrize("state", [(100.0, 0.2, 0.01), (-400.0, -0.15, 0.0), (700.0, 0.6, -0.02), (0.0, -0.5, 0.03)])
def test_the_derivative_and_the_jacobian_are_those_of_the_law(host, shock, program, state):
    at, law = np.array(state), law_of(program)
    derivative, force = shock(at[0], at[1:])
    np.testing.assert_allclose([float(derivative), float(force)], law(at), rtol=1e-12)
    parts = shock.factory("slopes", ["x", "u"], ["jac:ode:x", "jac:ode:u", "jac:y:x", "jac:y:u"])(at[0], at[1:])
    found = np.vstack([np.hstack([p.full() for p in parts[:2]]), np.hstack([p.full() for p in parts[2:]])])
    expected = slopes(law, at, (1.0, 1e-4, 1e-3))
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def jacobian_of_a_car(host, shock):
    """Return the largest deviation of CasADi's Jacobian of the car with four shocks, over its largest entry."""
    ca = host.ca
    state, road = ca.MX.sym("x", 18), host.reference.track()(0.4)
    rates = ca.Function("rates", [state], [host.own_car(shock, state, ca.DM(road))])
    found = ca.Function("slopes", [state], [ca.jacobian(rates(state), state)])
    rng = np.random.default_rng(1)
    at = np.concatenate([rng.normal(0.0, 0.01, 7), rng.normal(0.0, 0.1, 7), rng.normal(0.0, 200.0, 4)])
    size = np.concatenate([np.full(7, 1e-3), np.full(7, 1e-4), np.ones(4)])
    expected = slopes(lambda x: np.array(rates(x)).ravel(), at, size)
    return np.abs(found(at).full() - expected).max() / np.abs(expected).max()


def test_the_jacobian_of_a_model_around_the_fmus_is_right(host, shock):
    assert jacobian_of_a_car(host, shock) < 1e-8


def test_the_jacobian_is_wrong_with_casadis_default_options(host, case, tmp_path, monkeypatch):
    """If this fails, CasADi no longer has the fault, and the host program no longer needs its options."""
    monkeypatch.setattr(host, "BY_JACOBIAN", {})
    plain = host.function_of(case(1e-3).shock, tmp_path)[1]
    assert jacobian_of_a_car(host, plain) > 0.1


def test_model_exchange_has_a_small_error_and_keeps_a_high_order(host, error_of):
    fine, finer = (error_of(host, "ME, RK4", step) for step in (2e-3, 1e-3))
    assert fine[0] < 0.02 and fine[1] < 0.005
    assert math.log2(fine[0] / finer[0]) > 3.0


def test_an_implicit_integrator_takes_steps_far_beyond_the_time_constant_of_the_shock(host, error_of):
    with pytest.raises(ArithmeticError, match="diverged"):
        error_of(host, "ME, RK4", 8e-3)
    assert error_of(host, "ME, collocation", 8e-3)[0] < 0.1


def test_the_car_as_an_fmu_moves_as_the_car_in_symbols(host, motion_of):
    ours, other = motion_of(host, "ME, FMUs only, RK4", 2e-3), motion_of(host, "ME, RK4", 2e-3)
    np.testing.assert_allclose(ours.velocity, other.velocity, atol=1e-8)
    np.testing.assert_allclose(ours.tire_force, other.tire_force, atol=1e-3)
