"""Model exchange gives the results of co-simulation on random inputs, and its directional derivatives are exact.

scipy's integrators call the FMU's C functions. With held inputs co-simulation is exact, so both agree to the tolerance
of the integrator; with ramps a shock in co-simulation follows its curve in straight pieces.
"""

import json
from ctypes import c_double
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from builder.build import build
from eightpost.archive import extract_archive
from eightpost.shock import LAWS
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, write_vehicle

OK = 0
ALL = (*LAWS, "seven_dof", "quarter_car", "assembly")
STEP, COUNT = 1e-3, 60
SIZES = {"m/s": 0.8, "m": 0.02, "N": 2000.0, "N.m": 500.0}

#: Damper velocities [m/s] away from the kinks of the curve.
VELOCITIES = (-1.4, -0.8, -0.38, -0.2, -0.02, 0.02, 0.2, 0.38, 0.8, 1.5)


def drive(fmu, seed):
    """Return random values (COUNT + 1, m) of the inputs: sums of sines up to 20 Hz."""
    rng, time = np.random.default_rng(seed), STEP * np.arange(COUNT + 1)
    units = {v.name: v.unit for v in fmu.description.modelVariables}
    columns = []
    for name in fmu.inputs():
        waves = [np.sin(2.0 * np.pi * rng.uniform(1.0, 20.0) * time + rng.uniform(0.0, 6.0)) for _ in range(3)]
        columns.append(SIZES[units[name]] * np.mean(waves, axis=0))
    return np.array(columns).T


def by_co_simulation(fmu, u, ramps):
    """Return outputs and states after each step (COUNT, p)."""
    names, rows = fmu.inputs(), []
    assert fmu.set_named(dict(zip(names, u[0], strict=True))) == OK
    fmu.start()
    for k, (now, then) in enumerate(pairwise(u)):
        assert fmu.set_named(dict(zip(names, now, strict=True))) == OK
        if ramps:
            assert fmu.set_slopes(dict(zip(names, (then - now) / STEP, strict=True))) == OK
        assert fmu.step(k * STEP, STEP) == OK
        rows.append(fmu.get(*fmu.outputs(), *fmu.state_names))
    return np.array(rows)


def by_model_exchange(fmu, u, ramps, **options):
    """Return the same by an integrator."""
    names, rows = fmu.inputs(), []
    assert fmu.set_named(dict(zip(names, u[0], strict=True))) == OK
    fmu.exchange()
    x = fmu.states()

    def rates(t, x, start, now, slope):
        assert fmu.call("SetTime", c_double(t)) == OK
        assert fmu.set_named(dict(zip(names, now + slope * (t - start), strict=True))) == OK
        assert fmu.set_states(x.tolist()) == OK
        return fmu.derivatives()

    for k, (now, then) in enumerate(pairwise(u)):
        start, slope = k * STEP, (then - now) / STEP if ramps else 0.0 * now
        if x.size:
            found = solve_ivp(rates, (start, start + STEP), x, args=(start, now, slope), **options)
            assert found.success
            x = found.y[:, -1]
        rates(start + STEP, x, start, now, slope) if x.size else fmu.set_named(
            dict(zip(names, now + slope * STEP, strict=True))
        )
        rows.append(fmu.get(*fmu.outputs(), *fmu.state_names))
    return np.array(rows)


def differences(found, expected):
    """Return the largest difference of each column, relative to its largest value."""
    return np.abs(found - expected).max(axis=0) / np.maximum(np.abs(expected).max(axis=0), 1e-6)


def compare(host, c_level, name, seed, ramps, without=()):
    stepped, exchanged = host(name), host(name, kind=c_level.MODEL_EXCHANGE)
    u = drive(stepped, seed)
    expected = by_co_simulation(stepped, u, ramps)
    found = by_model_exchange(exchanged, u, ramps, method="DOP853", rtol=1e-10, atol=1e-9)
    kept = [k for k, n in enumerate(stepped.outputs() + stepped.state_names) if not n.endswith("coupling_error")]
    return differences(found[:, kept], expected[:, kept])


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", [*LAWS, "seven_dof", "quarter_car"])
def test_with_held_inputs_the_results_are_those_of_co_simulation(host, c_level, name):
    """An integrator with a relative tolerance of 1e-10 agrees to 1e-8; Hysteresis has steps of second order."""
    tolerance = 1e-3 if name == "hysteresis" else 1e-8
    assert compare(host, c_level, name, seed=1, ramps=False).max() < tolerance


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", [*LAWS, "seven_dof", "quarter_car"])
def test_with_ramps_the_results_are_those_of_co_simulation(host, c_level, name):
    """Vehicles are exact with ramps too; a shock's curve is followed in pieces of 0.01 m/s."""
    exact = name in ("seven_dof", "quarter_car", "polylinear")
    tolerance = 1e-8 if exact else 1e-3 if name == "hysteresis" else 1e-4
    assert compare(host, c_level, name, seed=2, ramps=True).max() < tolerance


def test_an_assembly_in_model_exchange_is_the_limit_of_its_co_simulation_with_small_coupling_steps(host, c_level):
    """The coupling error of co-simulation is of second order in the coupling step; model exchange has none."""
    u = drive(host("assembly"), 3) * 0.3
    exchanged = host("assembly", kind=c_level.MODEL_EXCHANGE)
    exact = by_model_exchange(exchanged, u, True, method="DOP853", rtol=1e-9, atol=1e-9)
    kept = [k for k, n in enumerate(exchanged.outputs() + exchanged.state_names) if n.endswith(("velocity", "force"))]
    worst = []
    for step in (2.5e-4, 1.25e-4, 6.25e-5):
        fmu = host("assembly")
        assert fmu.set_named({"coupling_step": step}) == OK
        worst.append(differences(by_co_simulation(fmu, u, True)[:, kept], exact[:, kept]).max())
    assert worst[0] > 3.0 * worst[1] > 9.0 * worst[2]
    assert worst[2] < 1e-3


def random_car(seed):
    """A random stable quarter car with poorly and well damped modes, real ones among them, and direct terms."""
    rng = np.random.default_rng(seed)
    pairs, reals = int(rng.integers(1, 6)), int(rng.integers(0, 4))
    n = 2 * pairs + reals
    A = np.zeros((n, n))
    for k in range(pairs):
        omega, zeta = rng.uniform(3.0, 150.0), rng.uniform(0.02, 0.9)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[-zeta * omega, omega], [-omega, -zeta * omega]]
    A[range(2 * pairs, n), range(2 * pairs, n)] = -rng.uniform(2.0, 100.0, reals)
    T = np.linalg.qr(rng.standard_normal((n, n)))[0] @ np.diag(10.0 ** rng.uniform(-1.0, 1.0, n))
    inputs = (Channel("force", "N"), Channel("road", "m"))
    outputs = (Channel("velocity", "m/s"), Channel("displacement", "m"), Channel("tire_force", "N"))
    B, C = rng.standard_normal((n, 2)) * [1e-3, 50.0], rng.standard_normal((3, n)) * np.array([[1.0], [0.1], [1e4]])
    D = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 2e5]])
    return StateSpace(T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T), D, inputs, outputs, name=f"random_{seed}")


@pytest.mark.repeated
@pytest.mark.parametrize("friction", [0.0, 150.0])
@pytest.mark.parametrize("seed", range(4))
def test_random_cars_have_the_results_of_co_simulation_with_and_without_friction(tmp_path, c_level, friction, seed):
    """Friction in co-simulation is of second order in its sub-steps."""
    write_vehicle(tmp_path / "car.json", IdentifiedVehicle("car", random_car(seed)))
    (built,) = build([tmp_path / "car.json"], tmp_path)
    extract_archive(built.path, tmp_path / "car")
    fmus = [c_level.Host(tmp_path / "car", kind=kind) for kind in (c_level.CO_SIMULATION, c_level.MODEL_EXCHANGE)]
    for fmu in fmus:
        assert fmu.set_named({"friction_force": friction, "friction_velocity": 0.05}) == OK
    u = drive(fmus[0], seed)
    expected = by_co_simulation(fmus[0], u, True)
    found = by_model_exchange(fmus[1], u, True, method="DOP853", rtol=1e-10, atol=1e-12)
    assert differences(found, expected).max() < (1e-8 if friction == 0.0 else 1e-3)
    for fmu in fmus:
        fmu.free()


# ---- Directional derivatives ----------------------------------------------------------------------------------------


def at(fmu, names, values):
    assert fmu.set_named(dict(zip(names, values, strict=True))) == OK
    return np.array([*fmu.get(*fmu.outputs()), *fmu.derivatives()])


def slope(fmu, names, values, k, change):
    """Return the derivative of outputs and rates by variable k, by central differences of sixth order."""
    total = 0.0
    for weight, shift in ((45.0, 1.0), (-9.0, 2.0), (1.0, 3.0)):
        ends = []
        for side in (-1.0, 1.0):
            there = values.copy()
            there[k] += side * shift * change
            ends.append(at(fmu, names, there))
        total = total + weight * (ends[1] - ends[0])
    return total / (60.0 * change)


def assert_derivatives(fmu, values, changes):
    """Every unknown by every known, to 1e-8 of the largest term of its row times the size of the known."""
    names = fmu.inputs() + fmu.state_names
    unknowns = fmu.outputs() + fmu.derivative_names
    expected = np.array([slope(fmu, names, values, k, changes[k]) for k in range(len(names))]).T
    at(fmu, names, values)
    found = np.array([fmu.tangent(unknowns, [name], [1.0])[1] for name in names]).T
    sizes = np.abs(expected * changes).max(axis=1, keepdims=True) + 1e-12 * np.abs(at(fmu, names, values))[:, None]
    assert np.all(np.abs(found - expected) * changes <= 1e-8 * sizes + 1e-300)
    weights = np.random.default_rng(0).uniform(-1.0, 1.0, len(names)) * changes
    status, along = fmu.tangent(unknowns, names, weights)
    assert status == OK
    np.testing.assert_allclose(along, found @ weights, rtol=1e-12, atol=1e-12 * np.abs(found * weights).max())


@pytest.mark.parametrize("curve", ["polynomials", "knots"])
@pytest.mark.parametrize("velocity", VELOCITIES)
@pytest.mark.parametrize("name", LAWS)
def test_a_shocks_directional_derivatives_are_exact(host, c_level, name, velocity, curve, knots):
    fmu = host(name, kind=c_level.MODEL_EXCHANGE)
    port = {"seal_friction": 15.0, "friction_velocity": 0.5, "motion_ratio": 1.0, "gas_stiffness": 900.0}
    assert fmu.set_named(port | (knots if curve == "knots" else {})) == OK
    fmu.exchange()
    states = {
        "lagged_force": (0.4 * velocity * 2000.0, 1.0),
        "lagged_velocity": (0.55 * velocity, 3e-4),
        "stop_travel": (9e-4 if velocity > 0.3 else -2e-4, 1e-6),
    }
    values, changes = zip((velocity, 3e-4), (0.013, 1e-3), *(states[state] for state in fmu.state_names), strict=True)
    assert_derivatives(fmu, np.array(values), np.array(changes))


@pytest.mark.parametrize("name", ["seven_dof", "quarter_car", "assembly"])
def test_a_cars_directional_derivatives_are_exact(host, c_level, name):
    fmu, rng = host(name, kind=c_level.MODEL_EXCHANGE), np.random.default_rng(7)
    friction = {v.name: 90.0 for v in fmu.description.modelVariables if v.name.endswith("friction_force")}
    width = {v.name: 0.5 for v in fmu.description.modelVariables if v.name.endswith("friction_velocity")}
    assert fmu.set_named(friction | width) == OK
    fmu.exchange()
    states = rng.uniform(-0.3, 0.3, len(fmu.state_names)) * fmu.nominals()
    values = np.concatenate([rng.uniform(-0.01, 0.01, len(fmu.inputs())), states])
    changes = np.concatenate([np.full(len(fmu.inputs()), 1e-3), 1e-3 * fmu.nominals()])
    assert_derivatives(fmu, values, changes)


@pytest.mark.parametrize("name", ALL)
def test_the_declared_dependencies_are_the_nonzero_directional_derivatives(host, c_level, name):
    """Over several states, every term that is not zero is declared; a shock's and a car's declared ones all occur."""
    fmu = host(name, kind=c_level.MODEL_EXCHANGE)
    port = {"seal_friction": 15.0, "gas_stiffness": 900.0, "friction_force": 90.0}
    known = {v.name for v in fmu.description.modelVariables}
    assert fmu.set_named({n: v for n, v in port.items() if n in known}) == OK
    assert fmu.set_named({n: 90.0 for n in known if n.endswith(".friction_force")}) == OK
    fmu.exchange()
    names, seen = fmu.inputs() + fmu.state_names, {}
    for seed in range(6):
        rng = np.random.default_rng(seed)
        states = rng.uniform(-1.0, 1.0, len(fmu.state_names)) * fmu.nominals()
        at(fmu, names, np.concatenate([rng.uniform(-0.3, 0.3, len(fmu.inputs())), states]))
        unknowns = fmu.outputs() + fmu.derivative_names
        found = np.array([fmu.tangent(unknowns, [n], [1.0])[1] for n in names]).T
        for row, unknown in zip(found, unknowns, strict=True):
            seen.setdefault(unknown, set()).update(
                n for n, term in zip(names, row, strict=True) if abs(term) > 1e-9 * np.abs(row).max()
            )
    listed = [*fmu.description.outputs, *fmu.description.derivatives]
    declared = {u.variable.name: {d.name for d in u.dependencies} for u in listed}
    assert json.dumps({n: sorted(v - declared[n]) for n, v in seen.items() if v - declared[n]}) == "{}"
    if name in LAWS:
        assert declared == seen
