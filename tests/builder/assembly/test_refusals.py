"""Systems that cannot be assembled are rejected with the reason and the remedy."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from builder.assembly import Assembly, assemble, read_parts
from builder.build import build
from builder.reference import Disclosure
from cosim import Bond, Connection, FmuComponent, System
from cosim.system_file import read_case
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError
from eightpost.wiring import Wire


@pytest.mark.nightly
def test_every_component_that_cannot_be_a_part_is_listed_with_the_remedy(fmus, python_fmus, model_files, tmp_path):
    shock = next(path for path in model_files if path.stem == "lpnl2")
    (closed,) = build([shock], tmp_path, disclosure=Disclosure.CONFIDENTIAL)
    members = read_archive(fmus["lpf1"])
    for name, old, new in (("foreign", b'name="eightpost"', b'name="other"'), ("old", b"-ratio", b"- ratio")):
        changed = {
            n: c.replace(old, new) if n in ("modelDescription.xml", "sources/lag.h") else c for n, c in members.items()
        }
        write_archive(tmp_path / f"{name}.fmu", changed)
    files = {"a": python_fmus["lpnl2"], "b": closed.path, "c": tmp_path / "foreign.fmu", "d": tmp_path / "old.fmu"}
    with pytest.raises(FmuError) as refused:
        read_parts({"car": fmus["seven_dof"], **files})
    message = str(refused.value)
    for text in ("a (", "--target native", "b (", "confidential", "c (", "eightpost run", "d (", "build it again"):
        assert text in message
    assert "car (" not in message


def test_a_part_of_fmi_3_is_refused_with_the_option_that_makes_an_assembly_of_fmi_3(fmus, fmus3):
    with pytest.raises(FmuError, match=r"lf \(.*lpf1.fmu\) is of FMI 3.0.*--fmi 3"):
        read_parts({"car": fmus["quarter_car"], "lf": fmus3["lpf1"]})


def test_a_part_that_depends_on_no_variable_is_refused_as_damaged(fmus, tmp_path):
    members = read_archive(fmus["lpf1"])
    xml = members["modelDescription.xml"].replace(b'dependencies="1 ', b'dependencies="999 ')
    write_archive(tmp_path / "lpf1.fmu", members | {"modelDescription.xml": xml})
    with pytest.raises(FmuError, match=r"lf \(.*lpf1\.fmu\) cannot be read \('999' is not the index of a variable\)"):
        read_parts({"car": fmus["quarter_car"], "lf": tmp_path / "lpf1.fmu"})


def _plan(case, **changes):
    return replace(Assembly.of(case.wiring, "car"), **changes)


@pytest.mark.nightly
def test_systems_other_than_a_vehicle_with_its_shocks_are_rejected_with_the_reason(case, fmus):
    plan = Assembly.of(case.wiring, "car")
    vehicle = plan.vehicle
    with pytest.raises(FmuError, match="there are 2 vehicles"):
        _plan(case, parts=(*plan.parts, replace(vehicle, name="second")))
    with pytest.raises(FmuError, match="there is no shock"):
        _plan(case, parts=(vehicle,), links=())
    with pytest.raises(FmuError, match=r"lf\.force -> rf\.displacement does not connect a vehicle"):
        _plan(case, links=(*plan.links, Wire("lf.force", "rf.displacement")))
    with pytest.raises(FmuError, match="is not an output"):
        _plan(case, links=(*plan.links, Wire("lf.lagged_force", "car.heave_force")))
    with pytest.raises(FmuError, match="makes an algebraic loop"):
        _plan(case, links=(*plan.links, Wire("car.lf.hub_acceleration", "lf.displacement")))
    with pytest.raises(FmuError, match="no output of lf is connected"):
        _plan(case, links=tuple(link for link in plan.links if not link.source.startswith("lf.")))
    with pytest.raises(FmuError, match="cannot be a prefix"):
        _plan(case, parts=(replace(vehicle, name="race-car"), *plan.shocks), links=())


def test_a_file_name_that_is_not_an_identifier_is_refused_with_a_valid_suggestion(case, tmp_path):
    with pytest.raises(FmuError, match=r"'race-car' is not a valid C identifier; .* e\.g\. race_car\.fmu"):
        assemble(case.wiring, tmp_path / "race-car.fmu")


# ---- Connections -----------------------------------------------------------------------------------------------------


@pytest.fixture
def documented(fmus, tmp_path, monkeypatch):
    """Run the code of a page with the FMUs of a quarter car and a shock in dist/; return its names."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dist").mkdir()
    for name in ("quarter_car", "lpnl2"):
        shutil.copy(fmus[name], tmp_path / "dist")

    def run(page):
        text, names = Path(__file__).parents[3].joinpath("docs", page).read_text(encoding="utf-8"), {}
        exec(text.partition("```python\n")[2].partition("```")[0], names)
        return names

    return run


def test_the_documented_code_writes_a_package(documented):
    names = documented("how_to/ssp.md")
    assert names["open_inputs"] == ("car.road",)
    case = read_case("dist/corner.ssp")
    assert (case.name, case.scenario.stop, case.step) == ("corner", 10.0, 1e-3)
    read, written = case.system, names["system"]
    assert (read.bonds, read.connections) == (written.bonds, written.connections)
    assert written.constants.items() <= read.constants.items()


@pytest.mark.nightly
def test_the_documented_code_assembles_an_fmu(documented):
    path = documented("how_to/assembly.md")["assembled"].path
    assert path == Path("dist/corner.fmu")
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
