"""A native vehicle FMU equals its state-space model exactly for held and ramped inputs."""

import numpy as np
import pytest

from builder.build import build
from builder.toolchain import this_platform
from cosim import FmuComponent
from eightpost.archive import read_archive, write_archive
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.vehicle import (
    Channel,
    IdentifiedVehicle,
    LinearStepper,
    StateSpace,
    write_vehicle,
)

from .cars import close, drive, model_of, random_moves, scale_of

CARS = ("seven_dof", "quarter_car")


@pytest.fixture(params=["component", "python_component"], ids=["native", "python"])
def either(request):
    """Load native FMUs, then those with a slave in Python."""
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("held", [True, False], ids=["held", "ramped"])
@pytest.mark.parametrize("name", CARS)
def test_the_fmu_equals_the_librarys_exact_step_over_random_inputs_and_steps(component, name, held):
    model = model_of(name)
    moves, stepper, expected = (
        random_moves(model, 150, 1, held=held),
        LinearStepper(model.A, model.B, model.C, model.D),
        [],
    )
    fmu = component(name)
    fmu.set(model.input_names, moves[0][1])
    fmu.end_initialization()
    x = stepper.equilibrium(moves[0][1])
    for step, start, end in moves:
        x = stepper.advance(x, start, end, step)
        expected.append(stepper.output(x, end))
    close(drive(fmu, model, moves), np.array(expected), 1e-10)


@pytest.mark.parametrize("name", CARS)
def test_successive_ramps_equal_the_librarys_exact_steps(component, name):
    """Inputs are set only once and then changed by their derivatives; they are held over every third step."""
    model, rng = model_of(name), np.random.default_rng(8)
    stepper, fmu, x = LinearStepper(model.A, model.B, model.C, model.D), component(name), np.zeros(model.A.shape[0])
    scale, time, u, found, expected = scale_of(model), 0.0, np.zeros(len(model.inputs)), [], []
    fmu.end_initialization()
    for k, step in enumerate(rng.uniform(1e-3, 5e-3, 60)):
        slopes = np.zeros(u.size) if k % 3 == 2 else 100.0 * scale * rng.standard_normal(u.size)
        end = u + slopes * step
        fmu.set_derivatives(model.input_names, slopes)
        fmu.step(time, step)
        x = stepper.advance(x, u, end, step)
        expected.append(stepper.output(x, end))
        found.append(fmu.get(model.output_names))
        time, u = time + step, end
    close(np.array(found), np.array(expected), 1e-10)


def test_a_step_without_friction_equals_the_linear_step_bit_for_bit(component):
    model = model_of("seven_dof")
    moves, found = random_moves(model, 40, 5, held=False), []
    for values in ({}, {"lf.friction_velocity": 0.001}):
        fmu = component("seven_dof", **values)
        fmu.end_initialization()
        found.append(drive(fmu, model, moves))
    assert found[0].tobytes() == found[1].tobytes()


@pytest.fixture
def for_every_processor(fmus, tmp_path):
    """Return cars compiled from their sources alone, without AVX code (fmus/common/wide.h)."""
    loaded = []

    def load(name, **parameters):
        members = {n: content for n, content in read_archive(fmus[name]).items() if not n.startswith("binaries/")}
        write_archive(tmp_path / f"{name}.fmu", members)
        loaded.append(FmuComponent(tmp_path / f"{name}.fmu", "plain", compile_missing=True))
        loaded[-1].begin(0.0, 1e6, parameters)
        return loaded[-1]

    yield load
    for fmu in loaded:
        fmu.finish()


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("friction", [{}, {"rr.friction_force": 150.0}], ids=["free", "rubbing"])
def test_results_with_and_without_avx_are_equal_bit_for_bit(component, for_every_processor, friction):
    model = model_of("seven_dof")
    moves, found = random_moves(model, 200, 7, held=False), []
    for load in (component, for_every_processor):
        fmu = load("seven_dof", **friction)
        fmu.end_initialization()
        found.append(drive(fmu, model, moves))
    assert found[0].tobytes() == found[1].tobytes()


def test_a_cars_library_uses_avx_only_if_the_processor_supports_it(fmus):
    """The instruction vzeroupper ends a function that used wide registers."""
    content = {n.split("/")[1]: c for n, c in read_archive(fmus["seven_dof"]).items() if n.startswith("binaries/")}
    wide = {name for name, library in content.items() if b"\xc5\xf8\x77" in library}
    assert this_platform().name in content
    assert wide == content.keys() & {"linux64", "win64", "darwin64"}


def test_a_step_too_long_for_the_friction_is_refused_without_effect(either):
    fmu = either("quarter_car", friction_force=1e5, friction_velocity=1e-4)
    fmu.end_initialization()
    fmu.set(("force",), (500.0,))
    fmu.step(0.0, 1e-6)
    before = fmu.get(model_of("quarter_car").output_names)
    with pytest.raises(StepError, match="too stiff for a step of"):
        fmu.step(1e-6, 0.05)
    assert fmu.get(model_of("quarter_car").output_names) == before
    fmu.step(1e-6, 1e-6)


@pytest.mark.parametrize("name", CARS)
def test_the_fmu_starts_and_stays_in_the_steady_state_of_its_inputs(either, name):
    model = model_of(name)
    u = np.linspace(-1.0, 1.0, len(model.inputs)) * scale_of(model)
    expected = model.dc_gain() @ u
    fmu = either(name)
    for scale in (3.0, 1.0):
        fmu.set(model.input_names, scale * u)
        np.testing.assert_allclose(fmu.get(model.output_names), scale * expected, rtol=1e-9, atol=1e-7)
    fmu.end_initialization()
    fmu.step(0.0, 0.37)
    np.testing.assert_allclose(fmu.get(model.output_names), expected, rtol=1e-7, atol=1e-6)


def test_the_equilibrium_start_can_be_disabled(either):
    fmu = either("quarter_car", start_at_equilibrium=False)
    fmu.set(("aero_force",), (1000.0,))
    fmu.end_initialization()
    assert fmu.get(("displacement", "tire_force")) == [0.0, 0.0]


def test_static_values_are_added_to_the_outputs(either):
    fmu = either("seven_dof", **{"lf.static_tire_force": 3000.0, "rear.static_ride_height": 0.2})
    fmu.end_initialization()
    assert fmu.get(("lf.tire_force", "rf.tire_force", "rear.ride_height")) == [3000.0, 0.0, 0.2]


def random_model(states, seed):
    """Return stable modes, overdamped and oscillating, mixed by a random orthogonal matrix."""
    rng = np.random.default_rng(seed)
    pairs = states // 3
    A = np.diag(-rng.uniform(1.0, 400.0, states))
    for k in range(pairs):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [
            [-rng.uniform(1, 30), w := rng.uniform(5, 400)],
            [-w, -rng.uniform(1, 30)],
        ]
    turn = np.linalg.qr(rng.standard_normal((states, states)))[0]
    inputs = [Channel(f"{c}.force", "N") for c in CORNERS] + [Channel(f"{c}.road", "m") for c in CORNERS]
    outputs = [Channel(f"{c}.velocity", "m/s") for c in CORNERS] + [Channel(f"{c}.tire_force", "N") for c in CORNERS]
    D = np.zeros((8, 8))
    D[4:, 4:] = 1e5 * np.eye(4)
    B, C = rng.standard_normal((states, 8)), rng.standard_normal((8, states))
    return StateSpace(turn @ A @ turn.T, turn @ B, C @ turn.T, D, tuple(inputs), tuple(outputs), name="random")


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("states", [1, 9, 150])
def test_an_identified_model_of_any_order_steps_exactly(tmp_path, states):
    model = random_model(states, states)
    write_vehicle(tmp_path / "big.json", IdentifiedVehicle("big", model))
    (built,) = build([tmp_path / "big.json"], tmp_path)
    fmu, stepper, expected = FmuComponent(built.path, "big"), LinearStepper(model.A, model.B, model.C, model.D), []
    fmu.begin(0.0, 1e3, {"start_at_equilibrium": False})
    fmu.end_initialization()
    moves, x = random_moves(model, 40, 6, held=False), np.zeros(states)
    for step, start, end in moves:
        x = stepper.advance(x, start, end, step)
        expected.append(stepper.output(x, end))
    close(drive(fmu, model, moves), np.array(expected), 1e-10)
    fmu.finish()


@pytest.mark.nightly
def test_a_model_without_a_steady_state_refuses_an_equilibrium_start_and_starts_without_it(tmp_path):
    channels = (Channel("force", "N"),), (Channel("velocity", "m/s"),)
    model = StateSpace([[0.0]], [[0.1]], [[1.0]], [[0.0]], *channels, name="drifting")
    write_vehicle(tmp_path / "drift.json", IdentifiedVehicle("drifting", model))
    (built,) = build([tmp_path / "drift.json"], tmp_path)
    fmu = FmuComponent(built.path, "drift")
    fmu.begin(0.0, 1.0, {})
    with pytest.raises(StepError, match="no unique steady state"):
        fmu.end_initialization()
    fmu.finish()
    fmu.begin(0.0, 1.0, {"start_at_equilibrium": False})
    fmu.end_initialization()
    fmu.set(("force",), (10.0,))
    fmu.step(0.0, 0.5)
    assert fmu.get(("velocity",)) == pytest.approx([0.5])
    fmu.finish()
