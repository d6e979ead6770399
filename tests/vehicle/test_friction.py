"""Friction, bristles and springs at the ports: order of the steps, no effect without force, dissipation, balance."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from eightpost.vehicle import LinearStepper, add_port_damping, read_vehicle, shipped
from eightpost.vehicle import friction as module
from eightpost.vehicle.friction import Bristles, PortFriction, advance, equilibrium, named_ports, output, ports_of

QUARTER = read_vehicle(shipped("quarter_car"))
SEVEN = read_vehicle(shipped("seven_dof"))
MODELS = {
    "quarter_car": QUARTER.coupled(),
    "quarter_car with damper": QUARTER.with_damper(),
    "seven_dof": SEVEN.coupled(),
    "seven_dof with damper": SEVEN.with_damper(),
}


def with_friction(name, force, width):
    """Return a car's stepper and its friction, with the same values at all ports or one per port."""
    model = MODELS[name]
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    names = [n.removesuffix("velocity") for n in model.output_names if n.endswith("velocity")]
    forces = [model.input_names.index(f"{n}force") for n in names]
    velocities = [model.output_names.index(f"{n}velocity") for n in names]
    ports = ports_of(stepper, forces, velocities)
    return stepper, PortFriction(ports, np.broadcast_to(force, len(names)), np.broadcast_to(width, len(names)))


def run(stepper, friction, x, u, h):
    """Return the states (K + 1, n) for inputs (K + 1, m) that are linear between their times."""
    states = [x]
    for before, after in pairwise(u):
        states.append(advance(stepper, friction, states[-1], before, after, h))
    return np.array(states)


def integrate(model, friction, x, u0, u1, h, *, rtol=1e-11):
    """Return the state after one step by an adaptive integrator, with independently written equations."""
    places = [(name, name.removesuffix("velocity") + "force") for name in model.output_names if "velocity" in name]
    rows = np.array([model.C[model.output_names.index(velocity)] for velocity, _ in places])
    columns = np.array([model.B[:, model.input_names.index(force)] for _, force in places]).T

    def slope(t, y):
        drag = friction.force * np.tanh(rows @ y / friction.width)
        return model.A @ y + model.B @ (u0 + (u1 - u0) * t / h) + columns @ drag

    return solve_ivp(slope, (0.0, h), x, method="DOP853", rtol=rtol, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("name", MODELS)
def test_without_friction_step_and_outputs_are_bitwise_those_of_the_linear_model(name):
    stepper, friction = with_friction(name, 0.0, 0.005)
    rng = np.random.default_rng(1)
    x, u0, u1 = (rng.normal(size=size) for size in (len(stepper.A), stepper.B.shape[1], stepper.B.shape[1]))
    for h in (1e-7, 1e-3, 0.05):
        np.testing.assert_array_equal(advance(stepper, friction, x, u0, u1, h), stepper.advance(x, u0, u1, h))
    np.testing.assert_array_equal(output(stepper, friction, x, u1), stepper.output(x, u1))


@pytest.mark.parametrize(("name", "force"), [("quarter_car with damper", 1000.0), ("seven_dof", (400, 100, 0, 900))])
def test_the_scheme_is_of_second_order(name, force):
    """With smooth friction and no sub-steps, each halving of the step reduces the error by a factor of four."""
    stepper, friction = with_friction(name, force, 0.5)
    n, m = stepper.B.shape
    x, u0, u1 = np.random.default_rng(2).normal(size=n) * 0.02, np.zeros(m), np.full(m, 0.004)
    span = 0.016
    exact = integrate(MODELS[name], friction, x, u0, u1, span)
    errors = []
    for count in (64, 128, 256, 512):
        assert friction.sub_steps(span / count) == 1
        end = run(stepper, friction, x, np.linspace(u0, u1, count + 1), span / count)[-1]
        errors.append(np.linalg.norm(end - exact))
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


@pytest.mark.nightly
def test_a_quarter_car_follows_its_equations_of_motion_with_friction():
    """m1 w1'' = k d + F,  m2 w2'' = k_t (y - w2) - k d - F,  d = w2 - w1,  F = F_c tanh(d' / v_f) + c d'."""
    p, force, width, c = QUARTER.parameters, 180.0, 0.004, 900.0
    damped = add_port_damping(QUARTER.coupled(), {"": c})
    stepper = LinearStepper(damped.A, damped.B, damped.C, damped.D)
    ports = ports_of(stepper, [damped.input_names.index("force")], [damped.output_names.index("velocity")])
    friction = PortFriction(ports, np.array([force]), np.array([width]))
    h = 2.5e-4
    time = np.arange(1201) * h
    u = np.zeros((time.size, 3))
    u[:, damped.input_names.index("road")] = 0.008 * np.sin(2 * np.pi * 3.0 * time)

    def slope(t, y):
        w1, w2, v1, v2 = y
        d, v = w2 - w1, v2 - v1
        pushed = p.suspension_stiffness * d + force * np.tanh(v / width) + c * v
        tire = p.tire_stiffness * (0.008 * np.sin(2 * np.pi * 3.0 * t) - w2)
        return [v1, v2, pushed / p.sprung_mass, (tire - pushed) / p.unsprung_mass]

    exact = solve_ivp(slope, (0.0, time[-1]), np.zeros(4), method="Radau", rtol=1e-8, atol=1e-11, t_eval=time).y
    states = run(stepper, friction, stepper.equilibrium(u[0]), u, h)
    y = np.array([output(stepper, friction, x, now) for x, now in zip(states, u, strict=True)]).T
    got = dict(zip(damped.output_names, y, strict=True))
    accelerations = np.array([slope(t, state)[2:] for t, state in zip(time, exact.T, strict=True)]).T
    expected = {
        "velocity": exact[3] - exact[2],
        "displacement": exact[1] - exact[0],
        "chassis_position": exact[0],
        "tire_force": p.tire_stiffness * (u[:, 0] - exact[1]),
        "chassis_acceleration": accelerations[0],  # friction is also in the direct terms
        "hub_acceleration": accelerations[1],
    }
    assert damped.input_names[0] == "road"
    for name, values in expected.items():
        # When the port changes direction, the error of an acceleration is F_c / (v_f m) times that of the velocity.
        tolerance = 5e-3 if name.endswith("acceleration") else 1e-3
        assert np.abs(got[name] - values).max() < tolerance * np.abs(values).max(), name


@pytest.mark.slow
def test_friction_dissipates_energy_at_every_instant_and_port():
    stepper, friction = with_friction("seven_dof with damper", 300.0, 0.005)
    h = 1e-3
    time = np.arange(251) * h
    u = np.zeros((time.size, stepper.B.shape[1]))
    road = [k for k, name in enumerate(MODELS["seven_dof"].input_names) if name.endswith("road")]
    u[:, road] = 0.01 * np.sin(2 * np.pi * 4.0 * time)[:, None] * np.array([1.0, -1.0, 0.5, 0.8])
    v = run(stepper, friction, stepper.equilibrium(u[0]), u, h) @ friction.ports.velocity.T
    power = 300.0 * np.tanh(v / 0.005) * v
    assert (power >= 0.0).all()
    assert (power[:250].sum(axis=0) * h > 1.0).all()  # J per period and port


@pytest.mark.nightly
def test_the_port_creeps_below_the_coulomb_force_and_slides_above_it():
    """A load of F_c / 2 at the port gives v = -v_f atanh(1/2), independent of the rest of the car; 2 F_c slides."""
    force, width, h = 2000.0, 4e-3, 1e-3
    stepper, friction = with_friction("quarter_car", force, width)
    model = MODELS["quarter_car"]
    velocity, displacement = (model.C[model.output_names.index(name)] for name in ("velocity", "displacement"))
    load = np.array([0.0, 0.0, 0.5 * force])  # road, aero_force, force: the port is pushed apart
    x = run(stepper, friction, np.zeros(4), np.tile(load, (151, 1)), h)
    creep = width * np.arctanh(0.5)
    assert np.abs(x @ velocity).max() < 3.0 * creep
    assert np.abs(x @ displacement).max() < 2.0 * creep * 0.15
    assert -1.4 * creep < float(np.mean(x[50:] @ velocity)) < -0.4 * creep
    free = run(stepper, friction, np.zeros(4), np.tile(4.0 * load, (21, 1)), h)
    assert np.abs(free @ displacement).max() > 20.0 * creep * 0.02


@given(
    force=st.lists(st.floats(0.0, 1e4), min_size=4, max_size=4).filter(any),
    width=st.lists(st.floats(1e-4, 0.1), min_size=4, max_size=4),
)
def test_the_rate_is_an_upper_bound_of_the_rates_at_which_friction_alone_settles_the_car(force, width):
    stepper, friction = with_friction("seven_dof", force, width)
    ports = friction.ports
    feedback = (stepper.B @ ports.selector) * (friction.force / friction.width) @ ports.velocity
    fastest = float(np.abs(np.linalg.eigvals(feedback)).max())
    assert fastest <= friction.rate * (1.0 + 1e-9)
    assert friction.rate <= 4.0 * fastest * (1.0 + 1e-9)  # and it is not far above them


def test_the_mobility_of_a_port_follows_from_its_two_masses():
    _, friction = with_friction("quarter_car", 1.0, 1.0)
    p = QUARTER.parameters
    np.testing.assert_allclose(friction.ports.mobility, [1.0 / p.sprung_mass + 1.0 / p.unsprung_mass], rtol=1e-14)


def test_a_long_step_is_divided_into_sub_steps():
    stepper, friction = with_friction("quarter_car with damper", 200.0, 0.005)
    h = 0.008
    count = friction.sub_steps(h)
    assert count == int(np.ceil(h * friction.rate / 0.0625)) > 10
    x, u = np.array([0.0, 0.001, 0.2, -0.3]), np.linspace(np.zeros(3), [0.003, 100.0, -300.0], count + 1)
    whole = advance(stepper, friction, x, u[0], u[-1], h)
    parts = run(stepper, friction, x, u, h / count * (1.0 - 1e-12))[-1]
    np.testing.assert_allclose(whole, parts, rtol=1e-8, atol=1e-10)


def test_a_step_with_too_many_sub_steps_is_rejected_with_the_reason():
    stepper, friction = with_friction("quarter_car", 1e5, 1e-4)
    with pytest.raises(ValueError, match=r"too stiff for a step of 0.05 s.*smaller step.*friction_velocity"):
        advance(stepper, friction, np.zeros(4), np.zeros(3), np.zeros(3), 0.05)


@pytest.mark.parametrize(
    ("force", "width", "message"),
    [(-1.0, 0.005, "force of port 0"), (np.nan, 0.005, "force"), (1.0, 0.0, "velocity"), (1.0, np.inf, "velocity")],
)
def test_invalid_values_are_rejected(force, width, message):
    with pytest.raises(ValueError, match=message):
        with_friction("quarter_car", force, width)


def test_the_friction_needs_numpy_only():
    """The python FMU contains the file and the bristle's, so they are loaded in a process without eightpost."""
    code = (
        "import importlib, sys, types; sys.modules['eightpost'] = None; sys.modules['scipy'] = None;"
        f"alone = types.ModuleType('alone'); alone.__path__ = [{str(Path(module.__file__).parent)!r}];"
        "sys.modules['alone'] = alone; print(importlib.import_module('alone.friction').SUB_STEP_SHARE)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == 0.0625


# ---- Bristles and springs --------------------------------------------------------------------------------------------

PORTS = {"seven_dof": ("lf.", "rf.", "lr.", "rr."), "quarter_car": ("",)}


def bristled(name, force, reach, *, spring=0.0):
    """Return a damped car, its stepper, and bristles and springs at its ports."""
    model = MODELS[f"{name} with damper"]
    stepper, bare = with_friction(f"{name} with damper", 0.0, 1.0)
    one = np.ones(bare.force.size)
    bristles = Bristles(force * one, reach * one, 1.15 * one, 0.01 * one)
    ports = named_ports(stepper, (model.input_names, model.output_names), PORTS[name], PORTS[name])
    return model, stepper, PortFriction(ports, bare.force, one, bristles, spring * one)


def roads(model, step, seconds):
    """Return inputs (N + 1, m): roads of many sines up to 25 Hz, from zero."""
    time, rng = np.arange(0.0, seconds + 0.5 * step, step), np.random.default_rng(3)
    u = np.zeros((time.size, len(model.inputs)))
    for k, name in enumerate(model.input_names):
        for frequency in np.arange(0.5, 25.0, 0.5) if name.endswith("road") else ():
            wave = np.sin(2 * np.pi * frequency * time + rng.uniform(0.0, 2 * np.pi))
            u[:, k] += 0.01 / frequency**1.2 * rng.normal() * wave
    return u - u[0]


def outputs(stepper, rubbing, u, step):
    """Return the outputs (N, p) after each step from zero."""
    states = run(stepper, rubbing, np.zeros(len(stepper.A) + rubbing.states), u, step)
    return np.array([output(stepper, rubbing, x, now) for x, now in zip(states[1:], u[1:], strict=True)])


def errors(found, exact):
    return np.sqrt(np.mean((found - exact) ** 2, axis=0)) / exact.std(axis=0)


@pytest.mark.nightly
def test_the_error_falls_with_the_square_of_the_sub_step(monkeypatch):
    """On a rough road with many reversals, against steps 16 times finer than the finest."""
    model, stepper, rubbing = bristled("quarter_car", 200.0, 1e-4, spring=2e5)
    u, found = roads(model, 1e-3, 0.25), {}
    monkeypatch.setattr(module, "SUB_STEP_ANGLE", 1e3)  # one sub-step per step, so that steps set the sub-steps
    for finer in (1, 2, 4, 64):
        time = np.arange(0, (len(u) - 1) * finer + 1) / finer
        ramps = np.column_stack([np.interp(time, np.arange(len(u)), row) for row in u.T])
        found[finer] = outputs(stepper, rubbing, ramps, 1e-3 / finer)[finer - 1 :: finer]
    velocity = model.output_names.index("velocity")
    size = [errors(found[finer], found[64])[velocity] for finer in (1, 2, 4)]
    orders = np.log2(np.array(size[:-1]) / np.array(size[1:]))
    assert (orders > 1.7).all(), orders
    assert size[0] < 1.5e-3


@pytest.mark.nightly
@pytest.mark.parametrize("force, reach", [(50.0, 1e-4), (200.0, 6e-5)])
def test_a_step_of_1_ms_is_within_a_thousandth(monkeypatch, force, reach):
    model, stepper, rubbing = bristled("quarter_car", force, reach, spring=2e5)
    u = roads(model, 1e-3, 0.4)
    found = outputs(stepper, rubbing, u, 1e-3)
    monkeypatch.setattr(module, "SUB_STEP_ANGLE", module.SUB_STEP_ANGLE / 16)
    worst = dict(zip(model.output_names, errors(found, outputs(stepper, rubbing, u, 1e-3)), strict=True))
    assert worst["velocity"] < 2e-4
    assert worst["tire_force"] < 5e-5
    assert worst["hub_acceleration"] < 1e-3


def test_bristles_without_force_leave_the_step_of_the_other_friction_as_it_is():
    model, stepper, rubbing = bristled("seven_dof", 0.0, 1e-4)
    ports = named_ports(stepper, (model.input_names, model.output_names), PORTS["seven_dof"], ())
    force, width = np.array([80.0, 0.0, 20.0, 300.0]), np.full(4, 0.004)
    old, new = PortFriction(ports, force, width), PortFriction(ports, force, width, rubbing.bristles)
    u, x, y = roads(model, 1e-3, 0.05), np.zeros(len(model.A)), np.zeros(len(model.A) + 4)
    for before, after in pairwise(u):
        x, y = advance(stepper, old, x, before, after, 1e-3), advance(stepper, new, y, before, after, 1e-3)
    np.testing.assert_array_equal(y[:-4], x)
    assert not y[-4:].any()


@settings(max_examples=30)
@given(st.floats(1e-4, 0.1), st.floats(1.0, 1e4), st.floats(1e-6, 1e-3), st.floats(0.0, 1e6))
def test_the_sub_steps_are_the_fewest_within_the_angle(h, force, reach, spring):
    _, _, rubbing = bristled("quarter_car", force, reach, spring=spring)
    count = rubbing.sub_steps(h)
    angle = h * rubbing.squared_frequency**0.5
    assert angle / count <= module.SUB_STEP_ANGLE * (1.0 + 1e-12)
    assert count == 1 or angle / (count - 1) >= module.SUB_STEP_ANGLE * (1.0 - 1e-12)


@settings(max_examples=30)
@given(st.lists(st.floats(-3e5, 3e5), min_size=4, max_size=4), st.integers(0, 1000))
def test_the_start_balances_springs_and_stays(springs, seed):
    model, stepper, rubbing = bristled("seven_dof", 100.0, 1e-4)
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
    _, stepper, rubbing = bristled("quarter_car", 0.0, 1e-4, spring=5e7)
    with pytest.raises(ValueError, match="port springs have no steady state"):
        equilibrium(stepper, rubbing, 3e4 * rubbing.ports.selector[:, 0])
