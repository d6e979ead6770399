"""A python vehicle FMU is its state space, stepped exactly, starting in equilibrium."""

import numpy as np
import pytest

from builder.build import build
from cosim import FmuComponent
from eightpost.errors import FmuError, StepError
from eightpost.vehicle import (
    Channel,
    IdentifiedVehicle,
    LinearStepper,
    StateSpace,
    StructuralVehicle,
    read_vehicle,
    shipped,
    write_vehicle,
)

CARS = ("seven_dof", "quarter_car")


def model_of(name):
    return read_vehicle(shipped(name)).coupled()


@pytest.mark.parametrize("name", CARS)
def test_the_fmu_equals_the_librarys_exact_step_over_random_inputs_and_steps(component, name):
    model, rng = model_of(name), np.random.default_rng(1)
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    fmu = component(name)
    u = np.where([n.endswith("road") for n in model.input_names], 0.01, 300.0) * rng.standard_normal(len(model.inputs))
    fmu.set(model.input_names, u)
    fmu.end_initialization()
    x, time = stepper.equilibrium(u), 0.0
    for step in 10.0 ** rng.uniform(-7, -1.3, 60):
        u = u * rng.uniform(-1, 1, u.size)
        fmu.set(model.input_names, u)
        fmu.step(time, step)
        time += step
        x = stepper.advance(x, u, u, step)
        y = stepper.output(x, u)
        np.testing.assert_allclose(fmu.get(model.output_names), y, rtol=1e-10, atol=1e-10 * np.abs(y).max())


@pytest.mark.parametrize("name", CARS)
def test_the_fmu_starts_in_the_steady_state_of_its_inputs_and_stays_there(component, name):
    model = model_of(name)
    u = np.linspace(-1.0, 1.0, len(model.inputs)) * np.where(
        [n.endswith("road") for n in model.input_names], 0.01, 500.0
    )
    expected = model.dc_gain() @ u
    fmu = component(name)
    for scale in (3.0, 1.0):
        fmu.set(model.input_names, scale * u)
        np.testing.assert_allclose(fmu.get(model.output_names), scale * expected, rtol=1e-9, atol=1e-7)
    fmu.end_initialization()
    fmu.step(0.0, 0.37)
    np.testing.assert_allclose(fmu.get(model.output_names), expected, rtol=1e-7, atol=1e-6)


def test_start_at_equilibrium_can_be_declined(component):
    fmu = component("quarter_car", start_at_equilibrium=False)
    fmu.set(("aero_force",), (1000.0,))
    fmu.end_initialization()
    assert fmu.get(("displacement", "tire_force")) == [0.0, 0.0]


def test_static_values_are_added_to_their_outputs_and_come_from_the_vehicle_file(tmp_path):
    vehicle = read_vehicle(shipped("seven_dof"))
    static = {"lf.tire_force": 3000.0, "front.ride_height": 0.1}
    write_vehicle(tmp_path / "car.toml", StructuralVehicle("car", vehicle.parameters, static))
    (built,) = build([tmp_path / "car.toml"], tmp_path)
    starts = {v.name: v.start for v in built.interface.variables}
    assert starts["lf.static_tire_force"] == 3000.0
    assert starts["front.static_ride_height"] == 0.1
    assert starts["rr.static_tire_force"] == 0.0


def test_static_values_move_the_outputs(component):
    fmu = component("seven_dof", **{"lf.static_tire_force": 3000.0, "rear.static_ride_height": 0.2})
    fmu.end_initialization()
    assert fmu.get(("lf.tire_force", "rf.tire_force", "rear.ride_height")) == [3000.0, 0.0, 0.2]


@pytest.mark.parametrize("name", CARS)
def test_a_restored_state_continues_bit_for_bit(component, name):
    fmu, outputs = component(name), model_of(name).output_names
    force = "lf.force" if name == "seven_dof" else "force"
    fmu.end_initialization()
    fmu.set((force,), (500.0,))
    fmu.step(0.0, 1e-3)
    state = fmu._slave.getFMUstate()
    fmu.step(1e-3, 2e-3)
    first = fmu.get(outputs)
    fmu._slave.setFMUstate(state)
    fmu.step(1e-3, 2e-3)
    assert fmu.get(outputs) == first


def free_mass() -> StateSpace:
    return StateSpace(
        np.array([[0.0, 1.0], [0.0, 0.0]]),
        np.array([[0.0], [1.0]]),
        np.array([[0.0, 1.0]]),
        np.zeros((1, 1)),
        (Channel("force", "N"),),
        (Channel("velocity", "m/s"),),
        name="free mass",
    )


def test_a_model_without_a_steady_state_refuses_to_start_in_one(tmp_path):
    write_vehicle(tmp_path / "free.json", IdentifiedVehicle("free mass", free_mass()))
    (built,) = build([tmp_path / "free.json"], tmp_path)
    fmu = FmuComponent(built.path, "free")
    fmu.begin(0.0, 1.0, {})
    with pytest.raises(StepError, match="steady state"):
        fmu.end_initialization()
    fmu.finish()


def test_a_shock_velocity_with_a_direct_term_is_refused(tmp_path):
    model = free_mass()
    loop = StateSpace(model.A, model.B, model.C, np.ones((1, 1)), model.inputs, model.outputs, name="loop")
    write_vehicle(tmp_path / "loop.json", IdentifiedVehicle("loop", loop))
    with pytest.raises(FmuError, match="algebraic loop"):
        build([tmp_path / "loop.json"], tmp_path)


def test_a_channel_that_is_no_port_is_refused(tmp_path):
    model = free_mass()
    odd = StateSpace(model.A, model.B, model.C, model.D, model.inputs, (Channel("sideways", "m/s"),), name="odd")
    write_vehicle(tmp_path / "odd.json", IdentifiedVehicle("odd", odd))
    with pytest.raises(FmuError, match="sideways"):
        build([tmp_path / "odd.json"], tmp_path)
    assert not (tmp_path / "odd.fmu").exists()
