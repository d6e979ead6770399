"""Steps of a car with bristles and port springs: their order, their error at 1 ms, and the start in balance."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.vehicle import LinearStepper, friction, read_vehicle, shipped
from eightpost.vehicle.friction import Bristles, PortFriction, advance, equilibrium, named_ports, output

PORTS = {"seven_dof": ("lf.", "rf.", "lr.", "rr."), "quarter_car": ("",)}

#: Bristles without force at four ports.
NO_BRISTLES = Bristles(np.zeros(4), np.full(4, 1e-4), np.ones(4), np.full(4, 0.01))


def car(name, force, reach, *, static_ratio=1.15, spring=0.0):
    model, prefixes = read_vehicle(shipped(name)).with_damper(), PORTS[name]
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    ports, one = (
        named_ports(stepper, (model.input_names, model.output_names), prefixes, prefixes),
        np.ones(len(prefixes)),
    )
    bristles = Bristles(force * one, reach * one, static_ratio * one, 0.01 * one)
    return model, stepper, PortFriction(ports, 0.0 * one, one, bristles, spring * one)


def roads(model, step, seconds, size=1.0):
    """Return inputs (N + 1, m): roads of many sines up to 25 Hz, from zero."""
    time, rng = np.arange(0.0, seconds + 0.5 * step, step), np.random.default_rng(3)
    u = np.zeros((time.size, len(model.inputs)))
    for k, name in enumerate(model.input_names):
        for frequency in np.arange(0.5, 25.0, 0.5) if name.endswith("road") else ():
            wave = np.sin(2 * np.pi * frequency * time + rng.uniform(0.0, 2 * np.pi))
            u[:, k] += size * 0.01 / frequency**1.2 * rng.normal() * wave
    return u - u[0]


def run(model, stepper, rubbing, u, step):
    x, rows = np.zeros(len(model.A) + rubbing.states), []
    for before, after in pairwise(u):
        x = advance(stepper, rubbing, x, before, after, step)
        rows.append(output(stepper, rubbing, x, after))
    return np.array(rows)


def errors(found, exact):
    return np.sqrt(np.mean((found - exact) ** 2, axis=0)) / exact.std(axis=0)


@pytest.mark.nightly
def test_the_error_falls_with_the_square_of_the_sub_step(monkeypatch):
    """On a rough road with many reversals, against steps 16 times finer than the finest."""
    model, stepper, rubbing = car("quarter_car", 200.0, 1e-4, spring=2e5)
    u, found = roads(model, 1e-3, 0.25), {}
    monkeypatch.setattr(friction, "SUB_STEP_ANGLE", 1e3)  # one sub-step per step, so that steps set the sub-steps
    for finer in (1, 2, 4, 64):
        time = np.arange(0, (len(u) - 1) * finer + 1) / finer
        ramps = np.column_stack([np.interp(time, np.arange(len(u)), row) for row in u.T])
        found[finer] = run(model, stepper, rubbing, ramps, 1e-3 / finer)[finer - 1 :: finer]
    velocity = model.output_names.index("velocity")
    size = [errors(found[finer], found[64])[velocity] for finer in (1, 2, 4)]
    orders = np.log2(np.array(size[:-1]) / np.array(size[1:]))
    assert (orders > 1.7).all(), orders
    assert size[0] < 1.5e-3


@pytest.mark.nightly
@pytest.mark.parametrize("force, reach", [(50.0, 1e-4), (200.0, 6e-5)])
def test_a_step_of_1_ms_is_within_a_thousandth(monkeypatch, force, reach):
    model, stepper, rubbing = car("quarter_car", force, reach, spring=2e5)
    u = roads(model, 1e-3, 0.4)
    found = run(model, stepper, rubbing, u, 1e-3)
    monkeypatch.setattr(friction, "SUB_STEP_ANGLE", friction.SUB_STEP_ANGLE / 16)
    worst = dict(zip(model.output_names, errors(found, run(model, stepper, rubbing, u, 1e-3)), strict=True))
    assert worst["velocity"] < 2e-4
    assert worst["tire_force"] < 5e-5
    assert worst["hub_acceleration"] < 1e-3


def test_bristles_without_force_leave_the_step_of_the_other_friction_as_it_is():
    model, stepper, _ = car("seven_dof", 0.0, 1e-4)
    ports = named_ports(stepper, (model.input_names, model.output_names), PORTS["seven_dof"], ())
    force, width = np.array([80.0, 0.0, 20.0, 300.0]), np.full(4, 0.004)
    old, new = PortFriction(ports, force, width), PortFriction(ports, force, width, NO_BRISTLES)
    u, x, y = roads(model, 1e-3, 0.05), np.zeros(len(model.A)), np.zeros(len(model.A) + 4)
    for before, after in pairwise(u):
        x, y = advance(stepper, old, x, before, after, 1e-3), advance(stepper, new, y, before, after, 1e-3)
    np.testing.assert_array_equal(y[:-4], x)
    assert not y[-4:].any()


@settings(max_examples=30)
@given(st.floats(1e-4, 0.1), st.floats(1.0, 1e4), st.floats(1e-6, 1e-3), st.floats(0.0, 1e6))
def test_the_sub_steps_are_the_fewest_within_the_angle(h, force, reach, spring):
    _, _, rubbing = car("quarter_car", force, reach, spring=spring)
    count = rubbing.sub_steps(h)
    angle = h * rubbing.squared_frequency**0.5
    assert angle / count <= friction.SUB_STEP_ANGLE * (1.0 + 1e-12)
    assert count == 1 or angle / (count - 1) >= friction.SUB_STEP_ANGLE * (1.0 - 1e-12)


@settings(max_examples=30)
@given(st.lists(st.floats(-3e5, 3e5), min_size=4, max_size=4), st.integers(0, 1000))
def test_the_start_balances_springs_and_stays(springs, seed):
    model, stepper, rubbing = car("seven_dof", 100.0, 1e-4)
    rubbing = PortFriction(rubbing.ports, rubbing.force, rubbing.width, rubbing.bristles, np.array(springs))
    loads = np.array([0.0 if name.endswith("road") else 300.0 for name in model.input_names])
    u = loads * np.random.default_rng(seed).normal(size=loads.size)
    x = equilibrium(stepper, rubbing, u)
    assert not x[-4:].any()
    own, forced = x[:-4], u + rubbing.inputs(x)
    np.testing.assert_allclose(model.A @ own + model.B @ forced, 0.0, atol=1e-6)
    after = advance(stepper, rubbing, x, u, u, 0.01)
    np.testing.assert_allclose(after, x, rtol=1e-6, atol=1e-9)


def test_a_spring_that_gives_way_has_no_start():
    _, stepper, rubbing = car("quarter_car", 0.0, 1e-4, spring=5e7)
    with pytest.raises(ValueError, match="port springs have no steady state"):
        equilibrium(stepper, rubbing, 3e4 * rubbing.ports.selector[:, 0])
