"""Programs of examples/hosts for MuJoCo, Drake and Exudyn, and the full vehicle: errors and orders of their loops.

They need the packages of the extras host-mujoco, host-drake and host-exudyn.
"""

import math

import numpy as np
import pytest

PACKAGES = {"mujoco_host": "mujoco", "drake_host": "pydrake", "exudyn_host": "exudyn"}

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def error(program, error_of):
    """Errors of the shock velocity and the tire force [%] of a loop at a step."""
    return lambda name, loop, step: error_of(program(name, PACKAGES[name]), loop, step)


@pytest.fixture(scope="module")
def full_vehicle(program):
    return program("full_vehicle", "mujoco")


def order(error, name, loop):
    return math.log2(error(name, loop, 2e-3)[0] / error(name, loop, 1e-3)[0])


@pytest.mark.parametrize(("name", "loop", "velocity", "tire_force"), [
    ("mujoco_host", "A", 1.1, 0.7), ("mujoco_host", "B", 0.3, 0.17), ("mujoco_host", "C", 0.05, 0.03),
    ("drake_host", "A", 1.1, 0.7), ("drake_host", "B", 0.3, 0.17), ("drake_host", "C", 0.05, 0.03),
    ("exudyn_host", "C", 0.22, 0.1), ("exudyn_host", "C, explicit RK44", 0.05, 0.03),
])  # fmt: skip
def test_the_loops_have_the_stated_errors_at_1_ms(error, name, loop, velocity, tire_force):
    found = error(name, loop, 1e-3)
    assert 0.3 * velocity < found[0] < velocity
    assert 0.3 * tire_force < found[1] < tire_force


@pytest.mark.parametrize("name", ["mujoco_host", "drake_host", "exudyn_host"])
def test_a_force_that_is_one_step_late_has_errors_of_several_percent(error, name):
    late, held = error(name, "J", 1e-3), error(name, "A", 1e-3)
    assert late[0] > 2.0 * held[0] and 4.0 < late[0] < 14.0


@pytest.mark.parametrize("name", ["mujoco_host", "drake_host"])
def test_explicit_hosts_keep_first_order_with_loop_a_and_second_with_loop_b(error, name):
    assert 1.0 < order(error, name, "A") < 1.6
    assert 1.8 < order(error, name, "B") < 2.3


def test_in_an_implicit_host_loop_b_is_of_second_order_only_if_it_extrapolates_to_the_end_of_the_step(error):
    assert 0.8 < order(error, "exudyn_host", "B") < 1.3
    assert 1.8 < order(error, "exudyn_host", "B, to the end of the step") < 2.4
    assert 1.6 < order(error, "exudyn_host", "C") < 2.3


def test_mujocos_default_integrator_is_of_first_order_even_with_loop_c(error):
    assert 0.8 < order(error, "mujoco_host", "C, default Euler") < 1.2
    assert error("mujoco_host", "C, implicitfast", 1e-3) == error("mujoco_host", "C, default Euler", 1e-3)


def test_error_control_in_drake_rejects_steps_and_keeps_its_accuracy(error):
    assert error("drake_host", "C, error control 1e-4", 8e-3)[0] < 0.1 * error("drake_host", "C", 8e-3)[0]


@pytest.fixture(scope="module")
def vehicle(full_vehicle, tmp_path_factory):
    """The program of the full vehicle, its FMUs, and the reference with both shocks at the left front."""
    program, seconds = full_vehicle, 1.5
    fmus = program.fmus_in(tmp_path_factory.mktemp("full_vehicle"))
    exact = [program.directly([program.SHOCKS[one] for one in car], seconds, 0.5e-3) for car in program.CARS]
    return program, [[fmus[one] for one in car] for car in program.CARS], exact, seconds


def test_the_full_vehicle_starts_in_equilibrium(full_vehicle):
    car = full_vehicle.Vehicle(1e-3, 1.0)
    tires = car.push()
    full_vehicle.mujoco.mj_forward(car.model, car.data)
    assert np.abs(car.data.qacc).max() < 1e-9
    np.testing.assert_allclose(tires, full_vehicle.static_loads(), rtol=1e-9)


def test_a_shock_fmu_in_the_full_vehicle_is_as_exact_as_in_the_linear_car(vehicle):
    program, fmus, exact, seconds = vehicle
    bounds = {"C": (0.25, 0.15), "A": (3.5, 2.5)}
    found = {loop: program.errors(program.LOOPS[loop](fmus[1], seconds, 2e-3), exact[1]) for loop in bounds}
    for loop, bound in bounds.items():
        assert found[loop][0] < bound[0] and found[loop][1] < bound[1]
    assert found["A"][0] > 8.0 * found["C"][0]


def test_loop_c_predicts_the_effect_of_another_shock_on_its_corner(vehicle):
    program, fmus, exact, seconds = vehicle
    runs = [program.LOOPS["C"](files, seconds, 2e-3) for files in fmus]
    (_, true), (_, found) = program.swap_effect(*exact), program.swap_effect(*runs)
    assert abs(true) > 10.0
    assert found == pytest.approx(true, abs=0.03 * abs(true))
