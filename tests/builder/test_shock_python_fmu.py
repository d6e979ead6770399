"""A Python shock FMU contains its law's file, gives the same numbers, and restores its state completely."""

import importlib
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import eightpost.shock
from builder.build import build
from eightpost.errors import StepError
from eightpost.shock import LAWS

OUTPUTS = ("force", "static_force", "lagged_force", "lag_weight", "dissipated_power", "beyond_fit")
PARAMETERS = {
    "motion_ratio": st.floats(0.5, 1.5),
    "compression_scale": st.floats(0.0, 2.0),
    "rebound_scale": st.floats(0.0, 2.0),
    "gas_stiffness": st.floats(0.0, 5e3),
    "gas_preload": st.floats(-500.0, 500.0),
    "seal_friction": st.floats(0.0, 50.0),
    "friction_velocity": st.floats(1e-3, 0.1),
    "time_constant": st.floats(1e-5, 0.1),
    "lag_full_force": st.floats(0.0, 1e3),
    "lag_zero_force": st.floats(1.1e3, 1e4),
    "series_stiffness": st.floats(1e5, 1e9),
    "curve.inner[1]": st.floats(-5e3, 5e3),
    "curve.rebound[4]": st.floats(-5e2, 5e2),
    "curve.transition_speed": st.floats(0.2, 0.6),
}
steps = st.lists(st.tuples(st.floats(1e-7, 0.05), st.floats(-2.0, 2.0), st.floats(-0.05, 0.05)), min_size=1, max_size=8)


def parameters_of(name, variables):
    """Return values for the parameters that an FMU has."""
    ranges = PARAMETERS
    if name == "hysteresis":  # its curve has knots, which must fit together
        ranges = {n: s for n, s in ranges.items() if not n.startswith("curve.")}
    return st.fixed_dictionaries({n: s for n, s in ranges.items() if n in variables})


def law_with(law, values):
    """Return the library's law with the FMU's parameter values."""
    curve = {name: getattr(law.curve, name) for name in law.curve.__slots__}
    for name, value in values.items():
        if name.startswith("curve.") and "lagged_slope" not in name:
            field, _, index = name.removeprefix("curve.").rstrip("]").partition("[")
            if index:
                changed = list(curve[field])
                changed[int(index) - 1] = value
                curve[field] = tuple(changed)
            else:
                curve[field] = value
    port = {name: values.get(name, getattr(law.port, name)) for name in law.port.__slots__}
    own = {name: values.get(name, getattr(law, name)) for name in eightpost.shock.own_parameters(type(law))}
    return type(law)(curve=type(law.curve)(**curve), port=type(law.port)(**port), **own)


def run_library(law, moves):
    lagged, rows = law.start(0.0), []
    for step, velocity, displacement in moves:
        lagged = law.advance(lagged, velocity, velocity, step)
        rows.append(law.response(lagged, velocity, displacement))
    return np.array(rows)


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


@pytest.mark.nightly
@pytest.mark.parametrize("name", LAWS)
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), moves=steps)
def test_the_fmu_equals_the_law_over_random_inputs_parameters_and_steps(name, data, moves, python_component, shocks):
    probe = python_component(name)
    values = data.draw(parameters_of(name, probe.variables))
    expected = run_library(law_with(shocks[name].law, values), moves)
    fmu = python_component(name, **values)
    np.testing.assert_allclose(run_fmu(fmu, moves), expected, rtol=1e-12, atol=1e-9)
    fmu.finish()
    probe.finish()


def test_two_shocks_stepped_alternately_in_one_process_do_not_interact(python_component, shocks):
    moves = [(1e-3, 0.4 * np.sin(0.05 * k), 0.0) for k in range(200)]
    pair = [python_component(name) for name in ("lpf1", "lpnl2")]
    for fmu in pair:
        fmu.set(("velocity", "displacement"), (0.0, 0.0))
        fmu.end_initialization()
    rows = {0: [], 1: []}
    for k, (step, velocity, displacement) in enumerate(moves):
        for index, fmu in enumerate(pair):
            fmu.set(("velocity", "displacement"), (velocity, displacement))
            fmu.step(k * step, step)
            rows[index].append(fmu.get(OUTPUTS))
    for index, name in enumerate(("lpf1", "lpnl2")):
        np.testing.assert_allclose(rows[index], run_library(shocks[name].law, moves), rtol=1e-12, atol=1e-9)


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
def test_a_shock_starts_in_equilibrium_and_initialization_may_be_iterated(python_component, shocks, name):
    fmu, law = python_component(name), shocks[name].law
    for velocity in (0.3, -0.2, 0.05):
        fmu.set(("velocity", "displacement"), (velocity, 0.01))
        expected = law.response(law.start(velocity), velocity, 0.01)
        assert fmu.get(("force", "lagged_force")) == [expected.force, expected.lagged_force]
    fmu.end_initialization()
    assert fmu.get(("lagged_force",)) == [law.valve_force(law.start(0.05), 0.05)]


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


def test_a_refused_parameter_ends_initialization_with_the_reason(python_component):
    with pytest.raises(StepError, match=r"failed to set motion_ratio = -1.0.*is not between"):
        python_component("lpnl2", motion_ratio=-1.0)


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
