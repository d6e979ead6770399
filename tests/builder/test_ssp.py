"""An SSP package contains the system, and libcosim gives the same results as our master with the same scheme."""

import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner

import cosim
from builder.ssp import _setup_member, write_ssp
from eightpost.__main__ import main
from eightpost.archive import read_archive, write_archive
from eightpost.corners import CORNERS
from eightpost.errors import WiringError
from eightpost.wiring import Wire, Wiring

STEP, COUNT = 1e-3, 300
SSP = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription"}


@pytest.fixture
def car(fmus):
    wires = []
    for corner in CORNERS:
        wires += [Wire(f"car.{corner}.{what}", f"{corner}.{what}") for what in ("velocity", "displacement")]
        wires.append(Wire(f"{corner}.force", f"car.{corner}.force"))
    return Wiring("car", {"car": fmus["seven_dof"], **dict.fromkeys(CORNERS, fmus["lpf1"])}, tuple(wires), STEP, 30.0)


def test_the_package_contains_each_fmu_once_and_unconnected_inputs_are_returned(car, tmp_path):
    left = write_ssp(tmp_path / "car.ssp", car)
    setups = {f"resources/{name}.ssv" for name in ("car", *CORNERS)}
    fmus = {"resources/seven_dof.fmu", "resources/lpf1.fmu"}
    assert set(read_archive(tmp_path / "car.ssp")) == {"SystemStructure.ssd"} | setups | fmus
    assert set(left) == {f"car.{c}.road" for c in CORNERS} | {"car.heave_force", "car.roll_moment", "car.pitch_moment"}


def test_the_same_system_gives_the_same_bytes(car, tmp_path):
    for name in ("a", "b"):
        write_ssp(tmp_path / f"{name}.ssp", car)
    assert (tmp_path / "a.ssp").read_bytes() == (tmp_path / "b.ssp").read_bytes()


def test_the_description_is_valid_and_contains_the_annotations_that_tools_need(car, tmp_path):
    import pyssp_standard  # noqa: PLC0415
    import xmlschema  # noqa: PLC0415
    from fmpy.ssp.ssd import read_ssd  # noqa: PLC0415

    write_ssp(tmp_path / "car.ssp", car)
    members = read_archive(tmp_path / "car.ssp")
    schemas = Path(pyssp_standard.__file__).parent / "resources"
    for name, schema in (
        ("SystemStructure.ssd", "SystemStructureDescription.xsd"),
        (_setup_member("lf"), "SystemStructureParameterValues.xsd"),
    ):
        (tmp_path / "document.xml").write_bytes(members[name])
        xmlschema.XMLSchema(str(schemas / schema)).validate(str(tmp_path / "document.xml"))
    text = members["SystemStructure.ssd"].decode()
    assert "oms:FixedStepMaster" in text and 'baseStepSize="0.001"' in text
    assert read_ssd(str(tmp_path / "car.ssp")).system.name == "car"


def test_the_setup_files_contain_only_variables_that_can_be_set(car, tmp_path):
    write_ssp(tmp_path / "car.ssp", car)
    members = read_archive(tmp_path / "car.ssp")
    for component, fmu in car.fmus.items():
        setup = ET.fromstring(members[_setup_member(component)])
        named = {p.get("name") for p in setup.iter() if p.tag.endswith("Parameter")}
        variables = fmpy.read_model_description(str(fmu)).modelVariables
        assert named and named <= {v.name for v in variables if v.causality == "parameter"}
    assert "time_constant" in named


def test_a_gain_becomes_a_transformation(car, tmp_path):
    turned = replace(car, wires=(replace(car.wires[0], factor=-1.0), *car.wires[1:]))
    write_ssp(tmp_path / "car.ssp", turned)
    root = ET.fromstring(read_archive(tmp_path / "car.ssp")["SystemStructure.ssd"])
    (found,) = [e.attrib for e in root.iter() if e.tag.endswith("LinearTransformation")]
    assert found == {"factor": "-1.0", "offset": "0.0"}


def test_systems_that_ssp_cannot_represent_are_rejected_with_the_reason(car, tmp_path):
    doubled = replace(car, wires=(*car.wires, Wire("rf.force", "car.lf.force")))
    with pytest.raises(WiringError, match=r"car\.lf\.force is connected to lf\.force and to rf\.force"):
        write_ssp(tmp_path / "car.ssp", doubled)
    unknown = replace(car, wires=(Wire("car.lf.speed", "lf.velocity"),))
    with pytest.raises(WiringError, match=r"car\.lf\.speed: the variable does not exist"):
        write_ssp(tmp_path / "car.ssp", unknown)
    output = replace(car, values={"car": {"lf.velocity": 1.0}})
    with pytest.raises(WiringError, match="cannot be set"):
        write_ssp(tmp_path / "car.ssp", output)
    assert not (tmp_path / "car.ssp").exists()


def road(k):
    return 0.01 * np.sin(2.0 * np.pi * 3.0 * k * STEP)


LIBCOSIM = """
import sys, json, math
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
run = CosimExecution.from_ssp_file(ssp_path=sys.argv[1], step_size=int(float(sys.argv[2]) * 1e9))
observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
run.add_observer(observer), run.add_manipulator(manipulator)
index = {s.name.decode(): s.index for s in run.slave_infos()}
refs = {n: {v.name.decode(): v.reference for v in run.slave_variables(i)} for n, i in index.items()}
rows = []
for k in range(int(sys.argv[3])):
    value = 0.01 * math.sin(2.0 * math.pi * 3.0 * k * float(sys.argv[2]))
    manipulator.slave_real_values(index["car"], [refs["car"]["lf.road"]], [value])
    assert run.step()
    names = ("lf.velocity", "rf.velocity", "lf.displacement")
    row = list(observer.last_real_values(index["car"], [refs["car"][n] for n in names]))
    rows.append(row + list(observer.last_real_values(index["lf"], [refs["lf"]["lagged_force"]])))
json.dump(rows, open(sys.argv[4], 'w'))
"""


def libcosim(package):
    pytest.importorskip("libcosimpy", reason="libcosimpy has no wheel for this platform")
    rows = package.with_suffix(".json")
    line = [sys.executable, "-c", LIBCOSIM, str(package), repr(STEP), str(COUNT), str(rows)]
    ran = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return np.array(json.loads(rows.read_text()))


def jacobi(system, **parameters):
    """Run a simple Jacobi loop: set all inputs, step all FMUs, exchange values."""
    parts = {name: cosim.FmuComponent(fmu, name) for name, fmu in system.fmus.items()}
    for name, part in parts.items():
        part.begin(0.0, 30.0, parameters.get(name, {}))
        part.end_initialization()
    rows = []
    for k in range(COUNT):
        parts["car"].set(("lf.road",), (float(road(k)),))
        for part in parts.values():
            part.step(k * STEP, STEP)
        for c in system.wires:
            (source, _, output), (target, _, name) = c.source.partition("."), c.target.partition(".")
            parts[target].set((name,), parts[source].get((output,)))
        rows.append(
            parts["car"].get(("lf.velocity", "rf.velocity", "lf.displacement")) + parts["lf"].get(("lagged_force",))
        )
    for part in parts.values():
        part.finish()
    return np.array(rows)


def agree(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max(axis=0).min())


@pytest.mark.nightly
def test_libcosim_runs_the_package_and_gives_our_results(car, tmp_path):
    write_ssp(tmp_path / "car.ssp", car)
    expected = jacobi(car)
    assert np.abs(expected).max(axis=0).min() > 1e-3
    agree(libcosim(tmp_path / "car.ssp"), expected)


@pytest.mark.nightly
def test_changing_only_a_setup_file_changes_the_shock_of_one_corner(car, tmp_path):
    write_ssp(tmp_path / "car.ssp", car)
    members = read_archive(tmp_path / "car.ssp")
    entry = rb'(name="compression_scale">\s*<ssv:Real value=")1.0"'
    setup, count = re.subn(entry, rb'\g<1>1.7"', members[_setup_member("lf")])
    assert count == 1
    write_archive(tmp_path / "changed.ssp", {**members, _setup_member("lf"): setup})
    expected = jacobi(car, lf={"compression_scale": 1.7})
    found = libcosim(tmp_path / "changed.ssp")
    agree(found, expected)
    assert np.abs(found - jacobi(car)).max() > 1e-3


def test_the_ssp_command_writes_the_package_of_a_system_file(fmus, tmp_path):
    text = f"""
[components.car]
fmu = "{fmus["quarter_car"]}"
inputs = {{ aero_force = "500 lbf" }}
[components.shock]
fmu = "{fmus["lpnl2"]}"
parameters = {{ compression_scale = 1.2 }}
[[bond]]
between = ["car", "shock"]
[scenario]
stop = "1 s"
"""
    (tmp_path / "corner.toml").write_text(text)
    ran = CliRunner().invoke(main, ["export", str(tmp_path / "corner.toml"), "-o", str(tmp_path / "corner.ssp")])
    assert ran.exit_code == 0, ran.output
    assert "car.road" in ran.output
    members = read_archive(tmp_path / "corner.ssp")
    assert re.search(rb'name="compression_scale">\s*<ssv:Real value="1.2"', members[_setup_member("shock")])
    assert b'name="aero_force"' in members[_setup_member("car")]
