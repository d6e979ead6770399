"""A package from any tool gives the result of the same system wired in Python."""

import gc
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import cosim
from builder.ssp import write_ssp
from cosim.ssp import Given
from cosim.system_file import read_case
from eightpost.archive import write_archive
from eightpost.corners import CORNERS
from eightpost.errors import InputError, WiringError
from eightpost.signals import Drivefile
from eightpost.wiring import Wire, Wiring
from tests.unchanged import refusals

from .corner import (
    CAR,
    CAR_ALONE,
    DAMPER,
    LINKS,
    NESTED_LINKS,
    NESTED_PORTS,
    OUTER_LINKS,
    SHOCK,
    by_hand,
    corner,
    read,
    renamed,
    resources,
    run,
    same,
)
from .document import (
    EXPERIMENT,
    binding,
    bindings,
    component,
    connectors,
    description,
    link,
    parameter,
    parameter_set,
    system,
)


def test_a_package_that_we_wrote_gives_the_result_of_its_original_system(folder):
    files = {"car": folder / "resources" / "quarter_car.fmu", "shock": folder / "resources" / "lpnl2.fmu"}
    given = {"car": {"aero_force": 100.0, "start_at_equilibrium": True}, "shock": {"compression_scale": 1.2}}
    ways = (
        ("car.velocity", "shock.velocity"),
        ("car.displacement", "shock.displacement"),
        ("shock.force", "car.force"),
    )
    write_ssp(
        folder / "corner.ssp", Wiring("corner", files, tuple(Wire(*ends) for ends in ways), 1e-3, 0.3, values=given)
    )
    case = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    assert (case.name, case.step, case.scenario.stop) == ("corner", 1e-3, 0.3)
    values = {"car": {"start_at_equilibrium": True}, "shock": {"compression_scale": 1.2}}
    expected = by_hand(folder, parameters=values)
    result = run(case)
    same(result, expected)
    assert result.energy == expected.energy and list(result.energy) == ["car"]


def test_the_whole_car_round_trips_bit_for_bit(tmp_path, fmus):
    drive = Drivefile.read(Path(__file__).parents[3] / "examples" / "data" / "track.parquet")
    files = {"car": fmus["seven_dof"], **dict.fromkeys(CORNERS, fmus["lpf1"])}
    whole = cosim.System.load(files, [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS])
    write_ssp(tmp_path / "car.ssp", whole.wiring(files, name="car", step=2e-3, stop=0.2))
    drive.write(tmp_path / "track.parquet")
    case = read_case(tmp_path / "car.ssp", given=Given(tmp_path / "track.parquet"))
    assert case.system.bonds == whole.bonds and case.system.connections == ()
    result, expected = run(case), cosim.run(whole, cosim.Scenario(stop=0.2, drive=drive), step=2e-3)
    assert result.order == expected.order
    assert all(np.array_equal(result.series[name], expected.series[name]) for name in expected.series.names)


def test_times_come_from_the_default_experiment_and_the_step_from_annotations(folder):
    oms = (
        '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations xmlns:oms="urn:oms">'
        '<oms:SimulationInformation><oms:FixedStepMaster description="oms-ma" stepSize="0.002"/>'
        "</oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>"
    )
    assert isinstance(read(folder, corner()).algorithm, cosim.Automatic)
    assert read(folder, corner(after=oms)).step == 0.002
    osp = EXPERIMENT.replace("0.3", "0.9").replace('startTime="0"', 'startTime="0.5"').replace("/>", ">") + (
        '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm xmlns:osp="urn:osp">'
        '<osp:FixedStepAlgorithm baseStepSize="5e-4"/></osp:Algorithm></ssc:Annotation></ssd:Annotations>'
        "</ssd:DefaultExperiment>"
    )
    case = read(folder, description(system("corner", CAR + SHOCK, LINKS), experiment=osp))
    assert case.step == 5e-4
    assert (case.scenario.stop, case.scenario.drive_start) == (pytest.approx(0.4), 0.5)
    assert any("starts at 0.5 s" in note for note in case.notes)


def test_unusual_but_valid_documents_are_read(folder):
    """Other prefixes, a default namespace, comments, percent-encoded names, reversed connections, no connectors."""
    shutil.copy(folder / "resources" / "lpnl2.fmu", folder / "resources" / "my shock #2.fmu")
    text = corner(
        CAR + component("shock", "resources/my%20shock%20%232.fmu"),
        link("shock.velocity", "car.velocity")
        + link("shock.displacement", "car.displacement")
        + link("car.force", "shock.force"),
    ).decode()
    text = text.replace("xmlns:ssd=", "xmlns=").replace("<ssd:", "<").replace("</ssd:", "</")
    text = (
        text.replace("ssc:", "common:")
        .replace("xmlns:ssc=", "xmlns:common=")
        .replace("<Elements>", "<!-- two --><Elements>")
    )
    same(run(read(folder, text.encode())), by_hand(folder))


def test_an_ssp_2_package_that_uses_only_fmi_2_features_is_read(folder):
    text = description(system("corner", CAR + SHOCK, LINKS), version="2.0").decode()
    text = text.replace("ssc:Real", "ssc:Float64")
    text = text.replace("ssv:Real", "ssv:Float64").replace('kind="output"', 'kind="local"', 1)
    assert 'name="velocity" kind="local"' in text
    same(run(read(folder, text.encode())), by_hand(folder))


def test_fmpy_gives_the_same_result_for_a_nested_package(folder):
    """FMPy's simulate_ssp holds coupled values over each step, so it converges to our result for small steps."""
    from fmpy.ssp.simulation import simulate_ssp  # noqa: PLC0415
    from fmpy.ssp.ssd import read_ssv  # noqa: PLC0415

    # FMPy has no equilibrium start, so the shock must have no force at rest.
    given = (parameter("axle.damper.gas_preload", 0.0), parameter("axle.damper.rebound_scale", 1.5))
    (folder / "resources" / "setup.ssv").write_text(parameter_set(*given))
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    links, ports = OUTER_LINKS + link(":z", "car.road"), connectors(z="input m")
    content = corner(CAR_ALONE + inner, links, ports=ports, bindings=bindings(binding(source="resources/setup.ssv")))
    write_archive(folder / "corner.ssp", {"SystemStructure.ssd": content, **resources(folder)})
    ours = run(read_case(folder / "corner.ssp", given=Given(renamed(folder, "z")))).series
    road, step = Drivefile.read(folder / "road.csv").series, 1e-4
    reference = simulate_ssp(
        str(folder / "corner.ssp"),
        stop_time=0.3 - step / 2,
        step_size=step,
        parameter_set=read_ssv(str(folder / "resources" / "setup.ssv")),
        input={"z": lambda time: float(np.interp(time, road.time, road["road"]))},
    )
    for our_name, name in (("car.velocity", "car.velocity"), ("axle_damper.force", "axle.damper.force")):
        # A row contains the result of a step with the time at the step's start.
        expected = np.interp(ours.time, reference["time"] + step, reference[name])
        assert np.std(ours[our_name] - expected) < 0.01 * np.std(expected), name


# ==== Systems in systems and descriptions in place of components become one system ===================================


@pytest.mark.repeated(2)
@pytest.mark.parametrize("kind", ["description", "package", "package without a type", "variant"])
def test_a_component_may_be_another_system_description(folder, kind):
    top = description(system("anything", DAMPER, NESTED_LINKS, NESTED_PORTS), experiment="")
    attributes, source = {"type": "application/x-ssp-package"}, "resources/axle.ssp"
    if kind == "description":
        (folder / "axle.ssd").write_bytes(top)
        attributes, source = {"type": "application/x-ssp-definition"}, "axle.ssd"
    else:
        name = "Soft.ssd" if kind == "variant" else "SystemStructure.ssd"
        members = {name: top, "resources/lpnl2.fmu": (folder / "resources" / "lpnl2.fmu").read_bytes()}
        write_archive(folder / source, members)
        source += "#Soft.ssd" if kind == "variant" else ""
    element = component("axle", source, **({} if kind == "package without a type" else attributes))
    case = read(folder, corner(CAR + element, OUTER_LINKS))
    same(run(case), by_hand(folder), lambda name: name.replace("axle_damper", "shock"))


def test_a_component_may_be_a_system_of_the_same_document(folder):
    twin = system("twin", DAMPER, NESTED_LINKS, NESTED_PORTS, id="definition")
    idle = bindings(binding(parameter("twin.damper.gas_stiffness", 0.0)))
    case = read(folder, corner(CAR + component("axle", "#definition") + twin, OUTER_LINKS, bindings=idle))
    assert case.system.bonds == (cosim.Bond.between("car", "axle_damper"),)
    assert set(case.system.components) == {"car", "axle_damper", "twin_damper"}
    own = system("twin", component("inner", "#definition"), "", id="definition")
    with pytest.raises(WiringError, match="component 'inner': the system '#definition' contains itself"):
        read(folder, corner(CAR + own, ""))


def test_a_description_that_contains_itself_is_refused(folder):
    element = component("axle", "corner.ssd", type="application/x-ssp-definition")
    with pytest.raises(WiringError, match=r"corner\.ssd contains itself"):
        read(folder, corner(CAR + element, ""))
    (folder / "a.ssd").write_bytes(description(system("a", component("b", "b.ssd"), "")))
    (folder / "b.ssd").write_bytes(description(system("b", component("a", "a.ssd"), "")))
    with pytest.raises(WiringError, match=r"[ab]\.ssd contains itself"):
        read(folder, corner(CAR + component("a", "a.ssd"), ""))


# ==== The files of a package are found in archives, in folders and by URI; files that cannot be opened are reported ==


def test_a_description_in_a_folder_and_in_an_archive_give_the_same_result(folder):
    case = read(folder, corner())
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    packed = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    expected = by_hand(folder)
    same(run(case), expected)
    same(run(packed), expected)
    assert case.system.bonds == packed.system.bonds == (cosim.Bond.between("car", "shock"),)


def test_an_unpacked_package_is_removed_with_the_last_of_its_components(folder):
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    case = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    file = case.fmus["shock"]
    assert file.is_file()
    del case
    gc.collect()
    assert not file.exists()


@pytest.mark.parametrize("source", ["../lpnl2.fmu", "%2e%2e/lpnl2.fmu", "/lpnl2.fmu"])
def test_a_source_outside_the_archive_is_refused(folder, source):
    shutil.copy(folder / "resources" / "lpnl2.fmu", folder / "lpnl2.fmu")
    content = corner().replace(b"resources/lpnl2.fmu", source.encode())
    write_archive(folder / "corner.ssp", {"SystemStructure.ssd": content, **resources(folder)})
    with pytest.raises(InputError, match=r"corner\.ssp.* component 'shock': the source '.*' is outside the package"):
        read_case(folder / "corner.ssp")


def test_a_description_file_may_refer_to_files_outside_its_folder_and_by_uri(folder):
    (folder / "systems").mkdir()
    car, shock = folder / "resources" / "quarter_car.fmu", folder / "resources" / "lpnl2.fmu"
    content = corner().replace(b"resources/lpnl2", b"../resources/lpnl2")
    content = content.replace(b"resources/quarter_car.fmu", car.as_uri().encode())
    (folder / "systems" / "corner.ssd").write_bytes(content)
    case = read_case(folder / "systems" / "corner.ssd", given=Given(folder / "road.csv"))
    assert {name: path.resolve() for name, path in case.fmus.items()} == {
        "car": car.resolve(),
        "shock": shock.resolve(),
    }


def test_errors_name_unreadable_archives_and_archives_without_a_description(folder, unchanged):
    (folder / "text.ssp").write_text("no zip")
    write_archive(folder / "other.ssp", {"A.ssd": b"<x/>", "b.txt": b""})
    write_archive(folder / "evil.ssp", {"../x.ssd": b"<x/>"})
    write_archive(folder / "bad.ssp", {"SystemStructure.ssd": corner(), "resources/quarter_car.fmu": b"no zip",
                                       "resources/lpnl2.fmu": b"no zip"})  # fmt: skip
    names = ("text.ssp", "none.ssp", "none.ssd", "other.ssp", "evil.ssp", "bad.ssp")
    unchanged(refusals({name: partial(read_case, folder / name) for name in names}))


def test_a_shock_of_a_package_is_replaced_by_its_flattened_name(folder, fmus):
    (folder / "corner.ssd").write_bytes(corner())
    given = Given(folder / "road.csv")
    case = read_case(folder / "corner.ssd", fmus={"shock": fmus["polylinear"]}, given=given)
    assert case.fmus["shock"] == fmus["polylinear"]
    assert "time_constant" not in case.system.components["shock"].variables
    with pytest.raises(WiringError, match="no component 'damper' to swap; there are car, shock"):
        read_case(folder / "corner.ssd", fmus={"damper": fmus["polylinear"]}, given=given)
