"""FMUs built with other tools from PyPI run like ours."""

import logging
import math
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.container_fmu.cli import create_container_fmu
from fmpy.container_fmu.config import Component as Part
from fmpy.container_fmu.config import Configuration
from fmpy.model_description import CoSimulation, ModelDescription, ModelVariable
from fmu_manipulation_toolbox.container import FMUContainer
from pythonfmu.builder import FmuBuilder

from cosim import FmuComponent, Scenario, System, run
from eightpost.errors import StepError

STEP, STOP = 1e-3, 0.1


@pytest.fixture(scope="module")
def slave(tmp_path_factory):
    """Build one of PythonFMU's own example slaves."""
    folder = Path(find_spec("pythonfmu").submodule_search_locations[0], "tests", "slaves")
    if not folder.is_dir():
        pytest.skip("this version of pythonfmu comes without its examples")

    def make(name, *files):
        target = tmp_path_factory.mktemp("pythonfmu")
        return FmuBuilder.build_FMU(folder / f"{name}.py", dest=target, project_files=files)

    make.folder = folder
    return make


@pytest.mark.repeated
def test_the_pythonfmu_example_runs_with_parameters_of_every_type(kind, slave):
    parts = {"slave": kind(slave("pythonslave"), "slave")}
    given = {"intParam": 7, "booleanParameter": True, "stringParameter": "cat", "container.someReal": 1.5}
    system = System(parts, constants={"slave.realIn": 0.5}, parameters={"slave": given})
    series = run(system, Scenario(stop=STOP, record=("slave.realOut",)), step=STEP, engine="python").series
    np.testing.assert_allclose(series["slave.realOut"][1:], series.time[1:], atol=1e-12)
    parts["slave"].close()


def test_a_pythonfmu_example_with_its_own_modules_runs(slave):
    part = FmuComponent(slave("slavewithdep", slave.folder / "localmodule.py"), "slave")
    part.begin(0.0, 1.0, {})
    part.end_initialization()
    part.set(("realIn",), (2.0,))
    part.step(0.0, STEP)
    assert part.get(("realOut",)) == [pytest.approx(2.0 * 5.0 * math.exp(STEP / 0.1))]
    part.finish()


@pytest.mark.repeated
def test_an_exception_in_a_pythonfmu_example_is_a_failed_step(kind, slave):
    system = System({"slave": kind(slave("PythonSlaveWithException"), "slave")}, constants={"slave.realIn": 0.5})
    with pytest.raises(StepError, match=r"^component 'slave' \(PythonSlaveWithException.fmu\) failed to step .*0 s"):
        run(system, Scenario(stop=STOP), step=STEP, engine="python")


@pytest.fixture(scope="module")
def toolbox_container(tmp_path_factory, fmus):
    """Quarter car and shock in a container of fmu-manipulation-toolbox."""
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.ERROR)
    folder = tmp_path_factory.mktemp("toolbox")
    for name in ("quarter_car", "lpnl2"):
        (folder / f"{name}.fmu").write_bytes(fmus[name].read_bytes())
    container = FMUContainer("container", folder)
    for name in ("quarter_car", "lpnl2"):
        container.get_fmu(f"{name}.fmu")
    for variable in ("velocity", "displacement"):
        container.add_link("quarter_car.fmu", variable, "lpnl2.fmu", variable)
    container.add_link("lpnl2.fmu", "force", "quarter_car.fmu", "force")
    container.add_input("ground", "quarter_car.fmu", "road")
    container.add_output("quarter_car.fmu", "tire_force", "load")
    container.make_fmu("container.fmu", step_size=STEP)
    return folder / "container.fmu"


@pytest.fixture(scope="module")
def fmpy_container(tmp_path_factory, fmus):
    """A quarter car in a container of fmpy."""
    folder = tmp_path_factory.mktemp("fmpy")
    (folder / "unpacked").mkdir()
    inner = fmpy.read_model_description(str(fmus["quarter_car"]))
    known = {v.name: v for v in inner.modelVariables}
    # The library counts from 1: before what is connected comes the time.
    time = ModelVariable("time", None, "Real", causality="independent", variability="continuous")
    ground = ModelVariable("ground", None, "Real", causality="input", variability="continuous", start="0")
    load = ModelVariable("load", None, "Real", causality="output", variability="continuous", initial="calculated")
    description = ModelDescription(
        fmiVersion="2.0",
        modelName="container",
        instantiationToken="{container}",
        coSimulation=CoSimulation(
            modelIdentifier="container_fmu", canHandleVariableCommunicationStepSize=True, fixedInternalStepSize=STEP
        ),
        modelVariables=[time, ground, load],
    )
    part = Part(name="car", filename=fmus["quarter_car"], modelDescription=inner)
    mappings = {ground: [(part, known["road"])], load: [(part, known["tire_force"])]}
    create_container_fmu(
        Configuration(False, description, [part], [], mappings), folder / "unpacked", folder / "container.fmu"
    )
    return folder / "container.fmu"


@pytest.mark.repeated
@pytest.mark.parametrize("container", ["toolbox_container", "fmpy_container"])
def test_a_container_fmu_gives_the_same_output_as_in_fmpys_simulation_loop(container, kind, request):
    path = request.getfixturevalue(container)
    parts = {"box": kind(path, "box")}
    free = [v.name for v in parts["box"].variables.values() if v.causality == "input" and v.type == "Real"]
    system = System(parts, constants={f"box.{name}": 0.01 * (name == "ground") for name in free})
    ours = run(system, Scenario(stop=STOP, record=("box.load",)), step=STEP, engine="python").series
    reference = fmpy.simulate_fmu(
        str(path), stop_time=STOP, output_interval=STEP, output=["load"], start_values={"ground": 0.01}
    )
    assert np.ptp(ours["box.load"]) > 0.0
    count = min(ours.time.size, reference.size)
    np.testing.assert_allclose(ours["box.load"][1:count], reference["load"][1:count], rtol=1e-9)
    parts["box"].close()
