"""CommonRoad's multi-body car takes our shocks: the same car with its own dampers, and the errors of the loops."""

import math

import numpy as np
import pytest

DAMPING = (1786.2, 1649.1)


@pytest.fixture(scope="module")
def host(program):
    return program("commonroad_host", "vehiclemodels")


def driven(host, seed):
    """Return a state in motion: all positions, angles and rates deviate from straight driving."""
    rng = np.random.default_rng(seed)
    state = host.start()
    state[5:23] += rng.uniform(-0.02, 0.02, 18)
    state[[5, 7, 9, 12, 14, 17, 19, 22]] += rng.uniform(-0.5, 0.5, 8)
    return state


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("product", [0.0, 40.0])
def test_forces_act_exactly_as_the_models_own_dampers(host, monkeypatch, seed, product):
    state = driven(host, seed)
    monkeypatch.setattr(host.P, "I_xz_s", product)
    velocity = host.shock_motion(state)[0]
    ours = host.slope(0.3, state, np.repeat(DAMPING, 2) * velocity)
    monkeypatch.setattr(host.P, "K_sdf", DAMPING[0])
    monkeypatch.setattr(host.P, "K_sdr", DAMPING[1])
    own = host.slope(0.3, state, np.zeros(4))
    np.testing.assert_allclose(ours, own, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_shock_velocity_is_the_rate_of_the_displacement(host, seed):
    state = driven(host, seed)
    rates = host.slope(0.0, state, np.zeros(4))
    found = (host.shock_motion(state + 1e-6 * rates)[1] - host.shock_motion(state - 1e-6 * rates)[1]) / 2e-6
    np.testing.assert_allclose(found, host.shock_motion(state)[0], atol=1e-6)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("loop", "step", "velocity"), [("A", 4e-3, 1.2), ("A", 2e-3, 0.5), ("C", 8e-3, 0.8), ("C", 4e-3, 0.3)]
)
def test_the_loops_have_errors_below_the_stated_ones(host, error_of, loop, step, velocity):
    found = error_of(host, loop, step)
    assert 0.01 < found[0] < velocity
    assert found[1] < velocity


@pytest.mark.nightly
def test_loop_a_is_about_first_order_and_worse_than_loop_c(host, error_of):
    coarse, fine = (error_of(host, "A", step)[0] for step in (4e-3, 2e-3))
    assert 0.9 < math.log2(coarse / fine) < 1.7
    assert error_of(host, "C", 4e-3)[0] < 0.4 * coarse
