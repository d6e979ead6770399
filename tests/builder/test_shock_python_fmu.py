"""A Python shock FMU contains its law's file, gives the same numbers, and restores its state completely."""

import importlib
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import eightpost.shock
from builder.build import build
from eightpost.errors import FmuError, StepError
from eightpost.shock import LAWS
from eightpost.vehicle import (
    Channel,
    IdentifiedVehicle,
    StateSpace,
    StructuralVehicle,
    read_vehicle,
    shipped,
    write_vehicle,
)

OUTPUTS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")


def run_fmu(fmu, moves):
    fmu.set(("velocity", "displacement"), (0.0, 0.0))
    fmu.end_initialization()
    time, rows = 0.0, []
    for step, velocity, displacement in moves:
        fmu.set(("velocity", "displacement"), (velocity, displacement))
        fmu.step(time, step)
        time += step
        rows.append(fmu.get(OUTPUTS))
    return np.array(rows)


@pytest.mark.parametrize("name", LAWS)
def test_the_fmu_contains_unchanged_copies_of_library_files(python_fmus, name):
    library = Path(eightpost.shock.__file__).parent
    with zipfile.ZipFile(python_fmus[name]) as archive:
        shipped = [n for n in archive.namelist() if "_law/" in n and (library / Path(n).name).is_file()]
        shipped = [n for n in shipped if not n.endswith("__init__.py")]
        assert {Path(n).name for n in shipped} >= {"curve.py", "law.py", f"{name}.py"}
        for member in shipped:
            assert archive.read(member) == (library / Path(member).name).read_bytes()


def test_two_fmus_never_share_a_module_name(python_fmus):
    names = set()
    for name in LAWS:
        with zipfile.ZipFile(python_fmus[name]) as archive:
            names.add(archive.read("resources/slavemodule.txt"))
    assert len(names) == len(LAWS)


@pytest.mark.parametrize("name", LAWS)
def test_a_restored_state_continues_bit_for_bit_also_when_serialized(python_component, name):
    fmu = python_component(name)
    run_fmu(fmu, [(1e-3, 0.1 * k, 0.0) for k in range(5)])
    slave = fmu._slave
    state = slave.getFMUstate()
    packed = slave.serializeFMUstate(state)

    def ahead():
        rows = []
        for k in range(5):
            fmu.set(("velocity",), (-0.2 * k,))
            fmu.step(5e-3 + k * 1e-3, 1e-3)
            rows.append(fmu.get(OUTPUTS))
        return rows

    first = ahead()
    slave.setFMUstate(state)
    assert ahead() == first
    slave.setFMUstate(slave.deSerializeFMUstate(packed))
    assert ahead() == first


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", LAWS)
def test_reset_restores_every_default(python_component, name):
    fmu = python_component(name, motion_ratio=0.7, **{"curve.inner[1]": 1790.0})
    moves = [(1e-3, 0.3, 0.0)] * 3
    run_fmu(fmu, moves)
    fmu._slave.reset()
    fmu._slave.setupExperiment(startTime=0.0)
    fmu._slave.enterInitializationMode()
    assert run_fmu(fmu, moves).tolist() == run_fmu(python_component(name), moves).tolist()


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("velocity", float("nan"), "velocity = nan is not finite"),
        ("motion_ratio", -1.0, "motion_ratio = -1.0"),
        ("curve.inner[1]", 1.0, "is fixed"),
        ("force", 1.0, "output variable and cannot be set"),
    ],
)
def test_an_invalid_value_fails_the_step_with_the_reason_and_the_next_valid_step_succeeds(
    python_component, variable, value, message
):
    fmu = python_component("lpnl2")
    fmu.end_initialization()
    fmu.set((variable,), (value,))
    with pytest.raises(StepError, match=message):
        fmu.step(0.0, 1e-3)
    fmu.set(("velocity",), (0.1,))
    fmu.step(0.0, 1e-3)


@pytest.mark.parametrize("step", [0.0, -1e-3, float("nan"), float("inf")])
def test_a_step_that_is_not_positive_is_rejected_and_the_next_one_succeeds(python_component, step):
    fmu = python_component("lpf1")
    fmu.end_initialization()
    with pytest.raises(StepError, match="must be positive"):
        fmu.step(0.0, step)
    fmu.step(0.0, 1e-3)


def test_an_unknown_value_reference_fails_only_the_next_step(python_component):
    fmu = python_component("lpnl2")
    fmu.end_initialization()
    assert fmu._slave.getReal([999]) == [0.0]
    fmu._slave.setBoolean([0], [True])
    fmu._slave.setInteger([0], [1])
    with pytest.raises(StepError, match="value reference 999 is not a Real variable"):
        fmu.step(0.0, 1e-3)
    fmu.step(0.0, 1e-3)


def test_a_corrupt_serialized_state_is_refused_and_the_old_state_is_kept(python_component):
    fmu = python_component("lpnl2")
    fmu.end_initialization()
    fmu.set(("velocity",), (0.2,))
    fmu.step(0.0, 1e-3)
    before = fmu.get(OUTPUTS)
    for bad in (b"{}", b"not json", b'{"values": 1}'):
        fmu._slave.setFMUstate(fmu._slave.deSerializeFMUstate(bad))
        assert fmu.get(OUTPUTS) == before
        with pytest.raises(StepError):
            fmu.step(1e-3, 1e-3)
    fmu.step(1e-3, 1e-3)


def test_inconsistent_parameters_end_initialization_with_the_reason(python_component):
    fmu = python_component("lpnl2", lag_zero_force=1.0)
    assert fmu.get(("force",)) == [0.0]
    with pytest.raises(StepError, match="lag_zero_force"):
        fmu.end_initialization()


def test_a_motion_ratio_above_1_5_gives_a_warning(python_component, caplog):
    python_component("lpnl2", motion_ratio=1.6).end_initialization()
    assert "motion_ratio = 1.6 is above 1.5" in caplog.text


def test_a_tunable_parameter_takes_effect_at_once_and_an_invalid_one_fails_the_step(python_component):
    fmu = python_component("lpnl2")
    fmu.end_initialization()
    fmu.set(("velocity", "gas_preload"), (0.1, 0.0))
    fmu.step(0.0, 0.5)
    before = fmu.get(("force",))[0]
    fmu.set(("gas_preload",), (100.0,))
    fmu.step(0.5, 1e-3)
    assert fmu.get(("force",))[0] == pytest.approx(before + 100.0)
    fmu.set(("lag_zero_force",), (1.0,))
    with pytest.raises(StepError, match="lag_zero_force"):
        fmu.step(0.501, 1e-3)


def test_a_python_fmu_that_ran_in_this_process_does_not_affect_the_next_build(tmp_path, monkeypatch, model_files):
    """PythonFMU puts the folder of an FMU, with the FMU's own copy of its library, first in the path."""
    (tmp_path / "pythonfmu").mkdir()
    (tmp_path / "pythonfmu/__init__.py").write_text("")
    for name in [name for name in sys.modules if name.partition(".")[0] == "pythonfmu"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    copy = importlib.import_module("pythonfmu")
    (fmu,) = build([next(f for f in model_files if f.stem == "lpf1")], tmp_path / "built", target="python")
    assert any(name.startswith("binaries/") for name in zipfile.ZipFile(fmu.path).namelist())
    assert sys.modules["pythonfmu"] is copy


# ---- Vehicles --------------------------------------------------------------------------------------------------------


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
