"""The documentation's code turns a system defined in Python into a package or a single FMU."""

import re
import shutil
from pathlib import Path

import pytest

from builder.build import fmu_identifier
from cosim import Bond, Connection, FmuComponent, System
from cosim.system_file import read_case
from eightpost.wiring import Wire

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture
def dist(fmus, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dist").mkdir()
    for name in ("quarter_car", "lpnl2"):
        shutil.copy(fmus[name], tmp_path / "dist")
    return tmp_path / "dist"


def names_after(page):
    """Run the code of a page and return its names."""
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    exec(code, names)
    return names


def test_the_documented_code_writes_a_package(dist):
    names = names_after("how_to/ssp.md")
    assert names["open_inputs"] == ("car.road",)
    case = read_case(dist / "corner.ssp")
    assert (case.name, case.scenario.stop, case.step) == ("corner", 10.0, 1e-3)
    read, written = case.system, names["system"]
    assert (read.bonds, read.connections) == (written.bonds, written.connections)
    assert written.constants.items() <= read.constants.items()


@pytest.mark.nightly
def test_the_documented_code_assembles_an_fmu(dist, toolchain, monkeypatch):
    monkeypatch.setattr("builder.assembly.assembled_fmu.find_toolchain", lambda: toolchain)
    path = names_after("how_to/assembly.md")["assembled"].path
    assert path == Path("dist/corner.fmu") and fmu_identifier(path.stem) == "corner"
    assert FmuComponent(path, "corner").variables["shock.coupling_error"].causality == "output"


def test_a_wire_states_its_unit_conversion_and_its_offsets(fmus):
    files = {"car": fmus["quarter_car"], "shock": fmus["lpnl2"]}
    force = Connection("shock.force", "car.aero_force", gain=-2.0, offset=3.0)
    system = System.load(files, [Bond.between("car", "shock")], connections=[force])
    wire = next(wire for wire in system.wiring(files).wires if wire.target == "car.aero_force")
    assert wire == Wire("shock.force", "car.aero_force", gain=-2.0, offset=3.0)
    assert wire.line == (-2.0, 3.0) and wire.offset_before_gain == -1.5
    shifted = Wire("a.x", "b.y", gain=2.0, factor=3.0, shift=5.0, offset=1.0)
    assert shifted.line == (6.0, 11.0) and shifted.offset_before_gain == 5.5
    assert shifted.places == (("a", "x"), ("b", "y"))
