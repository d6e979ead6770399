"""Repeated runs of foreign FMUs with a faulty fmi2Reset give identical results or an error."""

from pathlib import Path

import numpy as np
import pytest
import scipy

from cosim import Bond, FmuComponent, IsolatedComponent, Scenario, System, run
from eightpost.errors import StepError
from eightpost.signals import Drivefile, TimeSeries

from . import version_2

SOURCE = Path(__file__).with_name("quarter_car_fmu.c")
STOP = 0.5
VARIABLES = {
    "car": (
        ("force", 0, "input", 'Real unit="N" start="0"'), ("road", 1, "input", 'Real unit="m" start="0"'),
        ("velocity", 10, "output", 'Real unit="m/s"'), ("displacement", 11, "output", 'Real unit="m"'),
        ("tire_force", 12, "output", 'Real unit="N"', "2"), ("body", 13, "output", 'Real unit="m"'),
    ),
    "damper": (
        ("velocity", 0, "input", 'Real unit="m/s" start="0"'), ("displacement", 1, "input", 'Real unit="m" start="0"'),
        ("force", 10, "output", 'Real unit="N"'),
    ),
}  # fmt: skip
DECLARED = {
    "flags": 'canHandleVariableCommunicationStepSize="true" canInterpolateInputs="true"',
    "attributes": 'generationTool="20-sim"',
}


@pytest.fixture(scope="session")
def parts(foreign_compiler, tmp_path_factory):
    """Write both FMUs, compiled with definitions, and return their paths."""

    def write(*definitions):
        folder, parts = tmp_path_factory.mktemp("parts"), {}
        for name, own in (("car", ["-DCAR"]), ("damper", [])):
            library = foreign_compiler(folder / f"{name}.so", *own, *definitions, source=SOURCE)
            parts[name] = version_2.write(folder / f"{name}.fmu", library, name, VARIABLES[name], **DECLARED)
        return parts

    return write


def quarter_car(paths, kind=FmuComponent):
    return System(
        {name: kind(path, name) for name, path in paths.items()}, (Bond.between("car", "damper"),), constants={}
    )


@pytest.fixture(scope="module")
def rough():
    """A road of three sines, straight between points 1 ms apart."""
    time = np.linspace(0.0, STOP, round(1000 * STOP) + 1)
    rows = sum(a * np.sin(2.0 * np.pi * f * time) for a, f in ((0.02, 1.1), (0.005, 4.3), (0.001, 13.0)))
    return Drivefile(TimeSeries.from_channels(time, {"road": ("m", rows)}))


@pytest.fixture(scope="module")
def monolithic_car(rough):
    """Outputs of the whole quarter car, integrated at once: exact for a road that is straight between its points."""
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-20e3 / 300.0, 0.0, 20e3 / 300.0, 0.0, 1.0 / 300.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [20e3 / 40.0, 0.0, -220e3 / 40.0, 0.0, -1.0 / 40.0],
            [0.0, -1500.0 / 0.005, 0.0, 1500.0 / 0.005, -1.0 / 0.005],
        ]
    )
    b = np.array([[0.0], [0.0], [0.0], [200e3 / 40.0], [0.0]])
    road = rough.series["road"]
    _, _, states = scipy.signal.lsim((a, b, np.eye(5), np.zeros((5, 1))), road, rough.series.time)
    zs, vs, zu, vu, force = states.T
    return {
        "car.velocity": vu - vs,
        "car.displacement": zu - zs,
        "car.tire_force": 200e3 * (road - zu),
        "car.body": zs,
        "damper.force": force,
    }


def scenario(rough):
    return Scenario(stop=STOP, drive=rough, targets={"road": "car.road"}, record_step=2e-3)


def assert_same(first, second):
    assert first.names == second.names
    np.testing.assert_array_equal(first.time, second.time)
    for name in first.names:
        np.testing.assert_array_equal(first[name].view(np.uint64), second[name].view(np.uint64), err_msg=name)


@pytest.mark.parametrize(
    "kind", [FmuComponent, pytest.param(IsolatedComponent, marks=pytest.mark.nightly)], ids=["direct", "isolated"]
)
def test_a_quarter_car_of_fmus_with_a_faulty_reset_is_accurate_and_repeatable_by_default(
    kind, parts, rough, monolithic_car
):
    system = quarter_car(parts(), kind)
    first, second = (run(system, scenario(rough), engine="python") for _ in range(2))
    assert_same(first.series, second.series)
    assert first.stated_error == second.stated_error and first.steps == second.steps
    for name, exact in monolithic_car.items():
        apart = np.std(first.series[name] - np.interp(first.series.time, rough.series.time, exact)) / np.std(exact)
        assert apart < 4e-3, (name, apart)


@pytest.mark.nightly
def test_static_memory_of_a_library_is_fresh_for_each_run(parts, rough):
    """The library is unloaded with its last instance, which frees its static memory."""
    system = quarter_car(parts("-DSTATIC_MEMORY"))
    first, second = (run(system, scenario(rough), step=1e-3, engine="python") for _ in range(2))
    assert_same(first.series, second.series)


@pytest.mark.nightly
def test_a_repeated_run_with_a_different_result_is_an_error_that_names_the_fmu(parts, rough):
    """A library that stays loaded (as many C++ libraries do) keeps its memory; a separate process does not."""
    paths = parts("-DSTATIC_MEMORY", "-Wl,-z,nodelete")
    system = quarter_car(paths)
    run(system, scenario(rough), step=1e-3, engine="python")
    with pytest.raises(
        StepError, match=r"differs from the last one.*'car' \(car.fmu\).* keeps a state from run to run.*--isolate"
    ):
        run(system, scenario(rough), step=1e-3, engine="python")
    apart = quarter_car(paths, IsolatedComponent)
    assert_same(*(run(apart, scenario(rough), step=1e-3, engine="python").series for _ in range(2)))


@pytest.mark.nightly
def test_runs_with_another_step_or_drive_are_not_compared(parts, rough):
    system = quarter_car(parts())
    half = Drivefile(TimeSeries.from_channels(rough.series.time, {"road": ("m", 0.5 * rough.series["road"])}))
    for drive, step in ((rough, 1e-3), (rough, 2e-3), (half, 1e-3), (rough, 1e-3)):
        run(system, scenario(drive), step=step, engine="python")


def test_our_fmus_are_reset_and_foreign_fmus_are_instantiated_again(parts, fmus, begun):
    car, ours = FmuComponent(parts()["car"], "car"), FmuComponent(fmus["lpf1"], "ours")
    kept = []
    for part in (car, ours):
        instances = []
        for _ in range(2):
            part.begin(0.0, 1.0, {})
            part.end_initialization()
            instances.append(part._instance.slave)
            part.finish()
        kept.append(instances[0] is instances[1])
    assert kept == [False, True]
