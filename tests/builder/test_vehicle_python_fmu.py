"""A Python vehicle FMU steps its state-space model exactly and starts in equilibrium."""

import numpy as np
import pytest

from builder.build import build
from eightpost.errors import FmuError, StepError
from eightpost.vehicle import (
    Channel,
    IdentifiedVehicle,
    StateSpace,
    StructuralVehicle,
    read_vehicle,
    shipped,
    write_vehicle,
)

CARS = ("seven_dof", "quarter_car")


def model_of(name):
    return read_vehicle(shipped(name)).coupled()


@pytest.mark.nightly
def test_static_values_are_added_to_their_outputs_and_come_from_the_vehicle_file(tmp_path):
    vehicle = read_vehicle(shipped("seven_dof"))
    static = {"lf.tire_force": 3000.0, "front.ride_height": 0.1}
    write_vehicle(tmp_path / "car.toml", StructuralVehicle("car", vehicle.parameters, static))
    (built,) = build([tmp_path / "car.toml"], tmp_path)
    starts = {v.name: v.start for v in built.interface.variables}
    assert starts["lf.static_tire_force"] == 3000.0
    assert starts["front.static_ride_height"] == 0.1
    assert starts["rr.static_tire_force"] == 0.0


PORTS = {"seven_dof": ("lf.", "rf.", "lr.", "rr."), "quarter_car": ("",)}


def at_ports(name, variable):
    return tuple(f"{port}{variable}" for port in PORTS[name])


@pytest.mark.parametrize("name", CARS)
def test_friction_does_not_affect_the_equilibrium_start(python_component, name):
    model = model_of(name)
    u = np.where([c.unit == "m" for c in model.inputs], 0.01, 500.0) * np.linspace(-1.0, 1.0, len(model.inputs))
    found = []
    for force in (0.0, 200.0):
        fmu = python_component(name, **dict.fromkeys(at_ports(name, "friction_force"), force))
        fmu.set(model.input_names, u)
        fmu.end_initialization()
        fmu.step(0.0, 0.01)
        found.append(fmu.get(model.output_names))
    np.testing.assert_allclose(*found, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("name", CARS)
def test_a_restored_state_with_friction_continues_bit_for_bit(python_component, name):
    fmu, outputs = (
        python_component(name, **dict.fromkeys(at_ports(name, "friction_force"), 150.0)),
        model_of(name).output_names,
    )
    fmu.end_initialization()
    fmu.set(at_ports(name, "force")[:1], (500.0,))
    fmu.step(0.0, 1e-3)
    state = fmu._slave.getFMUstate()
    fmu.step(1e-3, 2e-3)
    first = fmu.get(outputs)
    fmu.set(at_ports(name, "friction_force")[:1], (20.0,))
    fmu._slave.setFMUstate(state)
    fmu.step(1e-3, 2e-3)
    assert fmu.get(outputs) == first


@pytest.mark.parametrize(
    ("variable", "value"),
    [("friction_force", -1.0), ("friction_force", np.inf), ("friction_velocity", 0.0), ("friction_velocity", np.nan)],
)
def test_a_friction_out_of_range_is_refused_by_name_and_the_old_value_is_kept(python_component, variable, value):
    fmu = python_component("seven_dof", **{"rr.friction_force": 100.0})
    fmu.end_initialization()
    fmu.set((f"rr.{variable}",), (value,))
    with pytest.raises(StepError, match=rf"rr\.{variable}"):
        fmu.step(0.0, 1e-3)
    assert fmu.get(("rr.friction_force", "rr.friction_velocity")) == [100.0, 0.005]
    fmu.step(0.0, 1e-3)


@pytest.mark.nightly
def test_only_ports_with_a_force_and_a_velocity_have_friction(tmp_path):
    model = model_of("seven_dof").select(outputs=("heave", "lf.velocity"))
    write_vehicle(tmp_path / "some.json", IdentifiedVehicle("some", model))
    (built,) = build([tmp_path / "some.json"], tmp_path)
    assert [v.name for v in built.interface.variables if "friction" in v.name] == [
        "lf.friction_force",
        "lf.friction_velocity",
    ]


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


def test_a_shock_velocity_with_feedthrough_is_rejected(tmp_path):
    model = free_mass()
    loop = StateSpace(model.A, model.B, model.C, np.ones((1, 1)), model.inputs, model.outputs, name="loop")
    write_vehicle(tmp_path / "loop.json", IdentifiedVehicle("loop", loop))
    with pytest.raises(FmuError, match="algebraic loop"):
        build([tmp_path / "loop.json"], tmp_path)


def test_an_unknown_channel_is_rejected(tmp_path):
    model = free_mass()
    odd = StateSpace(model.A, model.B, model.C, model.D, model.inputs, (Channel("sideways", "m/s"),), name="odd")
    write_vehicle(tmp_path / "odd.json", IdentifiedVehicle("odd", odd))
    with pytest.raises(FmuError, match="sideways"):
        build([tmp_path / "odd.json"], tmp_path)
    assert not (tmp_path / "odd.fmu").exists()
