"""Tests of the monolithic reference: against closed loops of python-control, and convergence."""

from __future__ import annotations

import control
import numpy as np
import pytest

RATE = 2000.0  # N.s/m


@pytest.fixture(scope="module")
def drive():
    """Return half a second of random values at 500 Hz for all seven inputs, moving from the start."""
    random = np.random.default_rng(7)
    t = np.arange(0.0, 0.5, 0.002)
    shape = np.array([[np.sin(2 * np.pi * f * t + p) for f in (1.3, 4.1, 9.7)] for p in random.uniform(0, 6, 7)])
    inputs = shape.sum(axis=1) * np.array([[0.004]] * 4 + [[800.0], [500.0], [700.0]])
    return t, inputs[:4], inputs[4:]


def open_loop(monolithic, car):
    """Return the plant from force to velocity in python-control, from the matrices of the reference."""
    S, m = monolithic.struts(car), monolithic.mass(car)[:, None]
    K = monolithic.stiffness(car)
    load = np.zeros((7, 11))
    load[3:, :4], load[:3, 4:7], load[:, 7:] = np.diag(car.tire_stiffness), np.eye(3), -S.T
    A = np.block([[np.zeros((7, 7)), np.eye(7)], [-K / m, np.zeros((7, 7))]])
    B = np.vstack([np.zeros((7, 11)), load / m])
    C = np.hstack([np.zeros((4, 7)), S])
    return control.ss(A, B, np.vstack([C, np.eye(14)]), 0)


@pytest.mark.parametrize("tau", [None, 0.0013])
def test_linear_shocks_agree_with_python_controls_closed_loop(monolithic, drive, tau):
    t, road, external = drive
    car = monolithic.Car()
    weight = monolithic.no_lag if tau is None else monolithic.full_lag
    shock = monolithic.Shock(lambda v: RATE * v, weight, tau or 1.0)
    found = monolithic.coupled_run(car, shock, t, road, external)

    damper = control.ss([], [], [], RATE * np.eye(4))
    if tau is not None:
        damper = control.ss(-np.eye(4) / tau, np.eye(4) / tau, RATE * np.eye(4), 0)
    plant = open_loop(monolithic, car)
    # Positive feedback of the first four outputs into the last four inputs.
    pick, place = np.eye(4, 18), np.vstack([np.zeros((7, 4)), np.eye(4)])
    loop = control.feedback(plant, control.ss([], [], [], place) * damper * control.ss([], [], [], pick), sign=1)
    u = np.vstack([road, external, np.zeros((4, len(t)))])
    q0 = np.linalg.solve(plant.A, -plant.B @ u[:, 0])
    start = np.concatenate([q0, np.zeros(loop.nstates - 14)])
    expected = control.forced_response(loop, t, u, start).outputs
    scale = np.abs(expected[:4]).max()
    np.testing.assert_allclose(found.shock_velocity, expected[:4], atol=1e-8 * scale)
    wheels = expected[4 + 3 : 4 + 7]
    tire = np.array(car.tire_stiffness)[:, None] * (road - wheels)
    np.testing.assert_allclose(found.tire_force, tire, atol=1e-8 * np.abs(tire).max())


def test_the_car_remains_at_rest_under_constant_inputs_with_a_gas_spring(monolithic):
    t = np.linspace(0.0, 0.2, 11)
    steady = np.ones(11)
    shock = monolithic.Shock(lambda v: 900.0 * v, monolithic.full_lag, 1e-3, gas_stiffness=700.0, gas_preload=600.0)
    run = monolithic.coupled_run(
        monolithic.Car(), shock, t, 0.01 * np.ones((4, 11)), np.outer([-2000.0, 300.0, 100.0], steady)
    )
    assert np.abs(run.shock_velocity).max() < 1e-9
    assert run.tire_force.sum(axis=0) == pytest.approx(2000.0 * steady)  # vertical balance
    assert np.abs(run.hub_acceleration).max() < 1e-6
