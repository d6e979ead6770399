"""PathSim hosts our FMUs: its loops have the errors that docs/how_to/hosts.md states, and its pitfalls too."""

import math

import numpy as np
import pytest


@pytest.fixture(scope="module")
def host(program):
    return program("pathsim_host", "pathsim", "pathsim_fmi")


@pytest.mark.nightly
@pytest.mark.parametrize("loop", ["A", "C"])
def test_a_car_in_pathsim_moves_as_with_any_other_runge_kutta_method(host, program, motion_of, loop):
    ours, other = motion_of(host, loop, 2e-3), motion_of(program("python_host"), loop, 2e-3)
    np.testing.assert_allclose(ours.velocity, other.velocity[:, : ours.velocity.shape[1]], atol=1e-9)
    np.testing.assert_allclose(ours.tire_force, other.tire_force[:, : ours.tire_force.shape[1]], atol=1e-4)


@pytest.mark.nightly
def test_model_exchange_has_a_small_error_and_keeps_a_high_order(host, error_of):
    fine, finer = (error_of(host, "ME", step) for step in (2e-3, 1e-3))
    assert fine[0] < 0.02 and fine[1] < 0.005
    assert math.log2(fine[0] / finer[0]) > 3.0


@pytest.mark.nightly
@pytest.mark.parametrize("loop", ["ME, FMUs only", "ME, car.fmu"])
def test_model_exchange_of_the_car_or_with_own_dampers_gives_the_same_motion(host, motion_of, loop):
    ours, other = motion_of(host, loop, 2e-3), motion_of(host, "ME", 2e-3)
    np.testing.assert_allclose(ours.velocity, other.velocity, atol=1e-6)
    np.testing.assert_allclose(ours.tire_force, other.tire_force, atol=0.02)


@pytest.mark.nightly
def test_fmus_that_step_one_after_the_other_are_loop_a_with_a_late_tire_force(host, error_of):
    alone, own = error_of(host, "A, FMUs only", 1e-3), error_of(host, "A", 1e-3)
    assert alone[0] == pytest.approx(own[0], rel=0.2)
    assert 1.5 < alone[1] < 4.0


@pytest.mark.nightly
def test_the_order_of_co_simulation_blocks_does_not_matter(host, motion_of, case, monkeypatch):
    first, simulate = motion_of(host, "A, FMUs only", 1e-3), host.simulate

    def car_last(case, blocks, *others):
        return simulate(case, [blocks[0], *blocks[:0:-1]], *others)

    monkeypatch.setattr(host, "simulate", car_last)
    last = host.LOOPS["A, FMUs only"](case(1e-3))
    deviation = last.velocity[:, 500:] - first.velocity[:, 500:]
    assert np.abs(deviation).max() < 1e-3 * first.velocity.std()


@pytest.mark.nightly
def test_without_a_stated_passthrough_the_force_is_late(host, error_of, case, program, monkeypatch):
    monkeypatch.delattr(host.Exchange, "__len__")
    block = host.block_of(case(2e-3).shock, host.Exchange, 2e-3)
    assert len(block) == 0
    reference = program("reference")
    late = reference.errors(host.LOOPS["ME"](case(2e-3)), case(2e-3).seconds)
    assert late[0] > 20.0 * error_of(host, "ME", 2e-3)[0]


def test_a_step_beyond_the_time_constant_of_the_shock_diverges(host, error_of):
    assert error_of(host, "ME", 8e-3) == (math.inf, math.inf)
