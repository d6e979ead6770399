"""A car's FMU with bristles and port springs equals the library, sticks, starts in balance and can be rolled back."""

import ctypes

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eightpost.errors import FmuError, StepError
from eightpost.vehicle import LinearStepper
from eightpost.vehicle.friction import PortFriction, advance, equilibrium, named_ports, output

from .cars import close, drive, model_of

OK = 0
PORTS = {"seven_dof": ("lf.", "rf.", "lr.", "rr."), "quarter_car": ("",)}
CARS = tuple(PORTS)


def parameters(name, seed=1):
    """Return different values at each port; the second one of four has a spring only. Seed 0: only smooth friction."""
    rng, found = np.random.default_rng(seed), {}
    if seed == 0:
        return {f"{port}friction_force": 50.0 * (k + 1) for k, port in enumerate(PORTS[name])}
    for k, port in enumerate(PORTS[name]):
        found |= {
            f"{port}friction_force": 30.0 * (k != 1), f"{port}friction_velocity": 0.01,
            f"{port}bristle_force": rng.uniform(50.0, 250.0) * (k != 1),
            f"{port}bristle_reach": rng.uniform(6e-5, 2e-4), f"{port}bristle_static_ratio": rng.uniform(1.0, 1.3),
            f"{port}bristle_stribeck_velocity": rng.uniform(0.005, 0.02), f"{port}port_spring": rng.uniform(-1e5, 4e5),
        }  # fmt: skip
    return found


def stepper_and_friction(name, values):
    model = model_of(name)
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    ports = named_ports(stepper, (model.input_names, model.output_names), PORTS[name], PORTS[name])
    defaults = {"friction_force": 0.0, "friction_velocity": 0.005, "bristle_force": 0.0, "bristle_reach": 1e-4,
                "bristle_static_ratio": 1.0, "bristle_stribeck_velocity": 0.01, "port_spring": 0.0}  # fmt: skip
    known = {f"{port}{own}": value for port in PORTS[name] for own, value in defaults.items()}
    return stepper, PortFriction.of_values(ports, PORTS[name], known | values)


def moves_of(name, count, seed):
    """Yield steps of any size [s] with the inputs (m,) at their start and end; every other step has held inputs."""
    model, rng = model_of(name), np.random.default_rng(seed)
    size = np.where([n.endswith("road") for n in model.input_names], 0.005, 300.0)
    for k, step in enumerate(10.0 ** rng.uniform(-6, -1.9, count)):
        start, end = size * rng.standard_normal((2, size.size))
        yield step, start, end if k % 2 else start


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", CARS)
def test_the_fmu_equals_the_library_over_random_inputs_and_steps(component, name, seed):
    values, model = parameters(name, seed), model_of(name)
    stepper, friction = stepper_and_friction(name, values)
    moves = list(moves_of(name, 40, seed))
    fmu = component(name, **values)
    fmu.set(model.input_names, 0.1 * moves[0][1])
    fmu.end_initialization()
    x, expected = equilibrium(stepper, friction, 0.1 * moves[0][1]), []
    for step, start, end in moves:
        x = advance(stepper, friction, x, start, end, step)
        expected.append(output(stepper, friction, x, end))
    close(drive(fmu, model_of(name), moves), np.array(expected), 1e-10)


@pytest.mark.parametrize("name", CARS)
def test_the_python_fmu_equals_the_native_one_also_when_parameters_change_in_the_run(component, python_component, name):
    moves = [(step, start, start) for step, start, _ in moves_of(name, 20, 3)]
    found = []
    for load in (component, python_component):
        fmu = load(name)
        fmu.end_initialization()
        rows = [drive(fmu, model_of(name), moves[:5])]
        for seed in (1, 2):  # from no friction to one, and to another
            values = parameters(name, seed)
            fmu.set(tuple(values), tuple(values.values()))
            rows.append(drive(fmu, model_of(name), moves[5:], float(sum(m[0] for m in moves[: 5 + 15 * (seed - 1)]))))
        found.append(np.concatenate(rows))
    close(found[0], found[1], 1e-10)


@pytest.mark.parametrize("name", CARS)
def test_the_start_is_in_balance_with_the_port_springs_and_relaxed_bristles(component, python_component, name):
    model = model_of(name)
    values = parameters(name, 4) | {f"{port}friction_force": 0.0 for port in PORTS[name]}
    u = np.where([n.endswith("road") for n in model.input_names], 0.002, 400.0) * np.linspace(
        0.5, 1.0, len(model.inputs)
    )
    starts = []
    for load in (component, python_component):
        fmu = load(name, **values)
        fmu.set(model.input_names, u)
        fmu.end_initialization()
        starts.append(np.array(fmu.get(model.output_names)))
    np.testing.assert_allclose(starts[0], starts[1], rtol=1e-9, atol=1e-8)
    places = [model.output_names.index(f"{port}displacement") for port in PORTS[name]]
    springs = np.array([values[f"{port}port_spring"] for port in PORTS[name]])
    loaded = u.copy()
    for port, force in zip(PORTS[name], springs * starts[0][places] ** 2, strict=True):
        loaded[model.input_names.index(f"{port}force")] += force
    np.testing.assert_allclose(starts[0], model.dc_gain() @ loaded, rtol=1e-8, atol=1e-7)
    fmu.step(0.0, 0.05)
    np.testing.assert_allclose(fmu.get(model.output_names), starts[1], rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("kind", ["native", "python"])
def test_springs_without_a_steady_state_are_refused_with_their_name(component, python_component, kind):
    fmu = (component if kind == "native" else python_component)("quarter_car", port_spring=5e7)
    with pytest.raises((FmuError, StepError, ValueError), match=r"port.springs? have? no steady state"):
        fmu.set(("force",), (30_000.0,))
        fmu.end_initialization()


# ---- Rollback and model exchange ------------------------------------------------------------------------------------


@pytest.fixture
def exchange(host, c_level):
    return lambda name: host(name, kind=c_level.MODEL_EXCHANGE).exchange()


def started(fmu, name):
    fmu.call("SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(0.0), 0, ctypes.c_double(0.0))
    assert fmu.set_named(parameters(name)) == OK
    assert fmu.call("EnterInitializationMode") == OK
    assert fmu.call("ExitInitializationMode") == OK
    return fmu


def exchanged(fmu, name):
    assert fmu.call("EnterEventMode") == OK
    assert fmu.set_named(parameters(name)) == OK
    assert fmu.call("EnterContinuousTimeMode") == OK
    return fmu


def moved(fmu, seed):
    """Set random inputs, states of modes, and deflections within the reach."""
    rng = np.random.default_rng(seed)
    inputs = {name: rng.normal() * (0.01 if name.endswith("road") else 200.0) for name in fmu.inputs()}
    states = rng.normal(size=len(fmu.state_names)) * fmu.nominals()
    assert fmu.set_named(inputs) == OK
    assert fmu.set_states(states.tolist()) == OK
    return states


@pytest.mark.parametrize("name", CARS)
def test_derivatives_are_those_of_the_equations(exchange, name):
    fmu, values, model = exchanged(exchange(name), name), parameters(name), model_of(name)
    moved(fmu, 5)
    read = dict(zip(fmu.derivative_names, fmu.derivatives().tolist(), strict=True))
    for port in PORTS[name]:
        v, z = fmu.get(f"{port}velocity", f"{port}bristle_deflection")
        reach, ratio = values[f"{port}bristle_reach"], values[f"{port}bristle_static_ratio"]
        limit = reach * (1.0 + (ratio - 1.0) * np.exp(-((v / values[f"{port}bristle_stribeck_velocity"]) ** 2)))
        expected = v - abs(v) * z / limit if values[f"{port}bristle_force"] else 0.0
        assert read[f"der({port}bristle_deflection)"] == pytest.approx(expected, rel=1e-12)
    stepper, friction = stepper_and_friction(name, values)
    u = np.array(fmu.get(*model.input_names))
    y = np.array(fmu.get(*model.output_names))
    x = np.linalg.lstsq(model.C, y - model.D @ u, rcond=None)[0]  # only a start: D depends on the forces of the ports
    z = np.array(fmu.get(*(f"{port}bristle_deflection" for port in PORTS[name])))
    for _ in range(50):
        forces = friction.inputs(np.concatenate([x, z]))
        x = np.linalg.lstsq(model.C, y - model.D @ (u + forces), rcond=None)[0]
    np.testing.assert_allclose(
        output(stepper, friction, np.concatenate([x, z]), u), y, rtol=1e-8, atol=1e-8 * np.abs(y).max()
    )


@pytest.mark.parametrize("name", CARS)
def test_directional_derivatives_are_differences_of_outputs_and_derivatives(exchange, name):
    fmu = exchanged(exchange(name), name)
    states = moved(fmu, 6)
    unknowns = [*fmu.outputs(), *fmu.derivative_names]
    for k, state in enumerate(fmu.state_names):
        change, ends = 1e-6 * fmu.nominals()[k], []
        for side in (-1.0, 1.0):
            beside = states.copy()
            beside[k] += side * change
            assert fmu.set_states(beside.tolist()) == OK
            rates = fmu.derivatives()
            ends.append(np.concatenate([fmu.get(*fmu.outputs()), rates]))
        assert fmu.set_states(states.tolist()) == OK
        status, found = fmu.tangent(unknowns, [state], [1.0])
        assert status == OK
        expected = (ends[1] - ends[0]) / (2.0 * change)
        sizes = np.maximum(np.abs(ends[0]) / fmu.nominals()[k], 1e-9)
        np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-5 * float(sizes.max()))


def test_the_integrated_model_has_the_results_of_fine_steps(host, exchange):
    """An adaptive integrator of the derivatives and the FMU's own steps of 0.1 ms agree on a road of sines."""
    name = "quarter_car"
    stepped, fmu = started(host(name), name), exchanged(exchange(name), name)

    def road(t):
        return 0.004 * np.sin(12.0 * t) + 0.001 * np.sin(70.0 * t)

    def slope(t, x):
        assert fmu.set_named({"road": road(t)}) == OK
        assert fmu.set_states(x.tolist()) == OK
        return fmu.derivatives()

    ends = np.linspace(0.0, 0.3, 31)
    nominal = fmu.nominals()
    solved = solve_ivp(
        slope, (0.0, 0.3), fmu.states(), method="LSODA", t_eval=ends, rtol=1e-8, atol=1e-8 * nominal, max_step=1e-3
    )
    rows, found = [], []
    for k, x in enumerate(solved.y.T):
        slope(ends[k], x)
        rows.append(fmu.get("velocity", "tire_force", "bristle_deflection"))
    for k in range(3000):
        if k % 100 == 0:
            found.append(stepped.get("velocity", "tire_force", "bristle_deflection"))
        t = 1e-4 * k
        reference = (ctypes.c_uint * 1)(stepped.references["road"])
        assert stepped.set_named({"road": road(t)}) == OK
        slopes = (ctypes.c_double * 1)((road(t + 1e-4) - road(t)) / 1e-4)
        assert (
            stepped.call("SetRealInputDerivatives", reference, ctypes.c_size_t(1), (ctypes.c_int * 1)(1), slopes) == OK
        )
        assert stepped.step(t, 1e-4) == OK
    exact, came = np.array(rows)[:30], np.array(found)
    errors = np.sqrt(np.mean((came - exact) ** 2, axis=0)) / exact.std(axis=0)
    assert (errors < 2e-4).all(), errors
