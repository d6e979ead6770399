"""A Python vehicle FMU steps its state-space model exactly and starts in equilibrium."""

import numpy as np
import pytest
from fmpy import read_model_description

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
from eightpost.vehicle import friction as suspension

CARS = ("seven_dof", "quarter_car")


def model_of(name):
    return read_vehicle(shipped(name)).coupled()


@pytest.mark.parametrize("name", CARS)
def test_the_fmu_equals_the_librarys_exact_step_over_random_inputs_and_steps(python_component, name):
    model, rng = model_of(name), np.random.default_rng(1)
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    fmu = python_component(name)
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
def test_the_fmu_starts_and_stays_in_the_steady_state_of_its_inputs(python_component, name):
    model = model_of(name)
    u = np.linspace(-1.0, 1.0, len(model.inputs)) * np.where(
        [n.endswith("road") for n in model.input_names], 0.01, 500.0
    )
    expected = model.dc_gain() @ u
    fmu = python_component(name)
    for scale in (3.0, 1.0):
        fmu.set(model.input_names, scale * u)
        np.testing.assert_allclose(fmu.get(model.output_names), scale * expected, rtol=1e-9, atol=1e-7)
    fmu.end_initialization()
    fmu.step(0.0, 0.37)
    np.testing.assert_allclose(fmu.get(model.output_names), expected, rtol=1e-7, atol=1e-6)


def test_the_equilibrium_start_can_be_disabled(python_component):
    fmu = python_component("quarter_car", start_at_equilibrium=False)
    fmu.set(("aero_force",), (1000.0,))
    fmu.end_initialization()
    assert fmu.get(("displacement", "tire_force")) == [0.0, 0.0]


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


def test_static_values_are_added_to_the_outputs(python_component):
    fmu = python_component("seven_dof", **{"lf.static_tire_force": 3000.0, "rear.static_ride_height": 0.2})
    fmu.end_initialization()
    assert fmu.get(("lf.tire_force", "rf.tire_force", "rear.ride_height")) == [3000.0, 0.0, 0.2]


@pytest.mark.parametrize("name", CARS)
def test_a_restored_state_continues_bit_for_bit(python_component, name):
    fmu, outputs = python_component(name), model_of(name).output_names
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


PORTS = {"seven_dof": ("lf.", "rf.", "lr.", "rr."), "quarter_car": ("",)}


def at_ports(name, variable):
    return tuple(f"{port}{variable}" for port in PORTS[name])


def ports_of(name, stepper):
    model = model_of(name)
    forces = [model.input_names.index(force) for force in at_ports(name, "force")]
    return suspension.ports_of(stepper, forces, [model.output_names.index(v) for v in at_ports(name, "velocity")])


@pytest.mark.repeated
@pytest.mark.parametrize("name", CARS)
def test_friction_equals_the_librarys_and_is_tunable_during_the_run(python_component, name):
    model, rng = model_of(name), np.random.default_rng(7)
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    ports, count = ports_of(name, stepper), len(PORTS[name])
    fmu, width = python_component(name), np.full(count, 0.005)
    force = np.zeros(count)
    fmu.end_initialization()
    x, time, size = np.zeros(len(model.A)), 0.0, np.where([c.unit == "m" for c in model.inputs], 0.01, 300.0)
    for k, step in enumerate(10.0 ** rng.uniform(-5, -2, 60)):
        if k % 10 == 5:  # differs between ports, and is zero at some
            force, width = rng.uniform(0.0, 300.0, count) * (k != 25), rng.uniform(1e-3, 0.01, count)
            fmu.set(at_ports(name, "friction_force"), force)
            fmu.set(at_ports(name, "friction_velocity"), width)
        u = size * rng.standard_normal(size.size)
        fmu.set(model.input_names, u)
        fmu.step(time, step)
        time += step
        friction = suspension.PortFriction(ports, force, width)
        x = suspension.advance(stepper, friction, x, u, u, step)
        y = suspension.output(stepper, friction, x, u)
        np.testing.assert_allclose(fmu.get(model.output_names), y, rtol=1e-10, atol=1e-12 * np.abs(y).max())


@pytest.mark.parametrize("name", CARS)
def test_an_fmu_without_friction_equals_the_linear_one_bit_for_bit(python_component, name):
    model, rng = model_of(name), np.random.default_rng(3)
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    fmu = python_component(name, **dict.fromkeys(at_ports(name, "friction_velocity"), 1e-4))
    fmu.end_initialization()
    x = np.zeros(len(model.A))
    for k in range(20):
        u = rng.standard_normal(len(model.inputs))
        fmu.set(model.input_names, u)
        fmu.step(k * 1e-3, 1e-3)
        x = stepper.advance(x, u, u, 1e-3)
        assert fmu.get(model.output_names) == stepper.output(x, u).tolist()


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


def test_a_step_too_long_for_the_friction_is_refused_without_effect(python_component):
    fmu = python_component("quarter_car", friction_force=1e5, friction_velocity=1e-4)
    fmu.end_initialization()
    fmu.set(("force",), (500.0,))
    fmu.step(0.0, 1e-6)
    before = fmu.get(model_of("quarter_car").output_names)
    with pytest.raises(StepError, match=r"too stiff for a step of 0\.05 s"):
        fmu.step(1e-6, 0.05)
    assert fmu.get(model_of("quarter_car").output_names) == before
    fmu.step(1e-6, 1e-6)  # the next valid step succeeds


@pytest.mark.parametrize("name", CARS)
def test_every_port_has_tunable_friction_with_display_units(python_fmus, name):
    variables = {v.name: v for v in read_model_description(str(python_fmus[name])).modelVariables}
    assert [n for n in variables if "friction" in n] == [
        *at_ports(name, "friction_force"),
        *at_ports(name, "friction_velocity"),
    ]
    for variable, unit, display, start, least in (
        ("friction_force", "N", "lbf", 0.0, 0.0),
        ("friction_velocity", "m/s", "in/s", 0.005, 1e-4),
    ):
        for port in at_ports(name, variable):
            found = variables[port]
            assert (found.causality, found.variability, found.unit) == ("parameter", "tunable", unit)
            assert (found.displayUnit, float(found.start), float(found.min)) == (display, start, least)


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


@pytest.mark.nightly
def test_a_model_without_a_steady_state_refuses_an_equilibrium_start(tmp_path):
    write_vehicle(tmp_path / "free.json", IdentifiedVehicle("free mass", free_mass()))
    (built,) = build([tmp_path / "free.json"], tmp_path, target="python")
    fmu = FmuComponent(built.path, "free")
    fmu.begin(0.0, 1.0, {})
    with pytest.raises(StepError, match="steady state"):
        fmu.end_initialization()
    fmu.finish()


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
