"""SSP packages of any maker run as the same system wired by hand; what cannot be run is named.

The packages here are hand-written as other tools write them; those that are read are valid to the standard's schema.
"""

import gc
import re
import shlex
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fmpy import platform

import cosim
from builder.ssp import SspComponent, SspConnection, SspSystem, write_ssp
from cosim.ssp import Given
from cosim.system_file import read_case
from eightpost.__main__ import main
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError, InputError, WiringError
from eightpost.signals import Drivefile, TimeSeries, read_series, write_series

NAMESPACES = "".join(
    f' xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (
        ("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"), ("ssm", "ParameterMapping"),
    )
)  # fmt: skip
UNITS = """<ssd:Units>
<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="m/s"><ssc:BaseUnit m="1" s="-1"/></ssc:Unit>
<ssc:Unit name="swift"><ssc:BaseUnit m="1" s="-1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="brisk"><ssc:BaseUnit m="1" s="-1" factor="1.25"/></ssc:Unit>
<ssc:Unit name="N"><ssc:BaseUnit kg="1" m="1" s="-2"/></ssc:Unit>
</ssd:Units>"""
EXPERIMENT = '<ssd:DefaultExperiment startTime="0" stopTime="0.3"/>'
LBF = 4.4482216152605


def connectors(**names):
    """`velocity="output m/s"` as a connector."""
    lines = ""
    for name, text in names.items():
        kind, _, unit = text.partition(" ")
        lines += f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{f""" unit="{unit}" """ if unit else ""}/>'
        lines += "</ssd:Connector>"
    return f"<ssd:Connectors>{lines}</ssd:Connectors>"


def component(name, source, ports="", extra="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<ssd:Component name="{name}" source="{source}"{given}>{ports}{extra}</ssd:Component>'


def link(start, end, inside="", **attributes):
    """`car.velocity` or, of the system itself, `:velocity`."""
    ends = ""
    for which, text in (("start", start), ("end", end)):
        element, _, name = text.partition(":" if text.startswith(":") else ".")
        ends += (f' {which}Element="{element}"' if element else "") + f' {which}Connector="{name}"'
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f"<ssd:Connection{ends}{given}>{inside}</ssd:Connection>"


def system(name, elements, links, ports="", bindings="", after="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    links = links and f"<ssd:Connections>{links}</ssd:Connections>"
    return (
        f'<ssd:System name="{name}"{given}>{ports}{bindings}<ssd:Elements>{elements}</ssd:Elements>'
        f"{links}{after}</ssd:System>"
    )


def description(top, *, experiment=EXPERIMENT, units=UNITS, version="1.0"):
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription{NAMESPACES} name="corner"'
    return f'{text} version="{version}">{top}{units}{experiment}</ssd:SystemStructureDescription>'.encode()


def parameter(name, value, kind="Real", unit=""):
    given = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"{given}/></ssv:Parameter>'


def parameter_set(*parameters, units=""):
    return (
        f'<ssv:ParameterSet{NAMESPACES} version="1.0" name="set"><ssv:Parameters>{"".join(parameters)}'
        f"</ssv:Parameters>{units}</ssv:ParameterSet>"
    )


def binding(*parameters, mapping="", prefix="", source=""):
    inline = "" if source else f"<ssd:ParameterValues>{parameter_set(*parameters)}</ssd:ParameterValues>"
    given = (f' prefix="{prefix}"' if prefix else "") + (f' source="{source}"' if source else "")
    return f"<ssd:ParameterBinding{given}>{inline}{mapping}</ssd:ParameterBinding>"


def bindings(*each):
    return f"<ssd:ParameterBindings>{''.join(each)}</ssd:ParameterBindings>"


CAR_PORTS = connectors(
    velocity="output m/s", displacement="output m", force="input N", road="input m", aero_force="input N"
)
CAR_ALONE = component("car", "resources/quarter_car.fmu", CAR_PORTS)
CAR = component("car", "resources/quarter_car.fmu", CAR_PORTS, bindings(binding(parameter("aero_force", 100.0))))
SHOCK = component(
    "shock", "resources/lpnl2.fmu", connectors(velocity="input m/s", displacement="input m", force="output N")
)
LINKS = (
    link("car.velocity", "shock.velocity")
    + link("car.displacement", "shock.displacement")
    + link("shock.force", "car.force")
)


def corner(elements=CAR + SHOCK, links=LINKS, **options):
    return description(system("corner", elements, links, **options))


@pytest.fixture(scope="module")
def bare_fmus(tmp_path_factory, fmus):
    """The FMUs without documentation and sources: quick to open."""
    made = tmp_path_factory.mktemp("bare")
    for name in ("quarter_car", "lpnl2"):
        members = read_archive(fmus[name])
        kept = {
            n: c for n, c in members.items() if n == "modelDescription.xml" or n.startswith(f"binaries/{platform}/")
        }
        write_archive(made / f"{name}.fmu", kept)
    return made


@pytest.fixture
def folder(tmp_path, bare_fmus):
    """A folder with FMUs under resources/ and a drivefile."""
    shutil.copytree(bare_fmus, tmp_path / "resources")
    time = np.linspace(0.0, 1.0, 101)
    road = 0.005 * np.sin(2 * np.pi * 3 * time)
    write_series(TimeSeries.from_channels(time, {"road": ("m", road)}), tmp_path / "road.csv")
    return tmp_path


@cache
def schema(folder):
    import pyssp_standard  # noqa: PLC0415
    from lxml import etree  # noqa: PLC0415

    file = Path(pyssp_standard.__file__).parent / "resources" / folder / "SystemStructureDescription.xsd"
    return etree.XMLSchema(file=str(file))


def read(folder, content, **given):
    """Write a description into the folder, check that the standard allows it, and read it, with the road as drive."""
    from lxml import etree  # noqa: PLC0415

    schema("ssp2" if b'version="2.0"' in content else "").assertValid(etree.fromstring(content))
    return read_as_it_is(folder, content, **given)


def read_as_it_is(folder, content, **given):
    (folder / "corner.ssd").write_bytes(content)
    return read_case(folder / "corner.ssd", given=Given(**{"drive": folder / "road.csv", **given}))


def resources(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in (folder / "resources").iterdir()}


def run(case):
    return cosim.run(case.system, case.scenario, step=case.step or 1e-3)


def by_hand(folder, *, bonds=None, connections=(), parameters=None, constants=None, stop=0.3):
    """The same corner, wired in Python."""
    made = cosim.System.load(
        {"car": folder / "resources" / "quarter_car.fmu", "shock": folder / "resources" / "lpnl2.fmu"},
        [cosim.Bond.between("car", "shock")] if bonds is None else bonds,
        connections=connections,
        constants={"car.aero_force": 100.0} if constants is None else constants,
        parameters=parameters or {},
    )
    return cosim.run(made, cosim.Scenario(stop=stop, drive=Drivefile.read(folder / "road.csv")), step=1e-3)


def same(result, expected, rename=str):
    assert {rename(name) for name in result.series.names} == set(expected.series.names)
    assert np.array_equal(result.series.time, expected.series.time)
    for name in result.series.names:
        assert np.array_equal(result.series[name], expected.series[rename(name)]), name
    assert np.abs(expected.series["shock.force"]).max() > 10.0


def test_a_package_of_ours_runs_as_the_system_it_was_written_from(folder):
    components = (
        SspComponent(
            "car", folder / "resources" / "quarter_car.fmu", {"aero_force": 100.0, "start_at_equilibrium": True}
        ),
        SspComponent("shock", folder / "resources" / "lpnl2.fmu", {"compression_scale": 1.2}),
    )
    ways = (
        ("car.velocity", "shock.velocity"),
        ("car.displacement", "shock.displacement"),
        ("shock.force", "car.force"),
    )
    write_ssp(
        folder / "corner.ssp",
        SspSystem("corner", components, tuple(SspConnection(*ends) for ends in ways), 1e-3, 0.3),
    )
    case = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    assert (case.name, case.step, case.scenario.stop) == ("corner", 1e-3, 0.3)
    values = {"car": {"start_at_equilibrium": True}, "shock": {"compression_scale": 1.2}}
    expected = by_hand(folder, parameters=values)
    result = run(case)
    same(result, expected)
    assert result.energy == expected.energy and list(result.energy) == ["car"]


def test_the_whole_car_round_trips_bit_for_bit(tmp_path, fmus):
    corners = ("lf", "rf", "lr", "rr")
    drive = Drivefile.read(Path(__file__).parents[2] / "examples" / "data" / "track.parquet")
    files = {"car": fmus["seven_dof"], **dict.fromkeys(corners, fmus["lpf1"])}
    whole = cosim.System.load(files, [cosim.Bond.between(f"car.{corner}", corner) for corner in corners])
    links = tuple(SspConnection(c.source, c.target) for c in whole.all_connections)
    write_ssp(
        tmp_path / "car.ssp",
        SspSystem("car", tuple(SspComponent(name, file) for name, file in files.items()), links, 2e-3, 0.2),
    )
    drive.write(tmp_path / "track.parquet")
    case = read_case(tmp_path / "car.ssp", given=Given(tmp_path / "track.parquet"))
    assert case.system.bonds == whole.bonds and case.system.connections == ()
    result, expected = run(case), cosim.run(whole, cosim.Scenario(stop=0.2, drive=drive), step=2e-3)
    assert result.order == expected.order
    assert all(np.array_equal(result.series[name], expected.series[name]) for name in expected.series.names)


def test_a_description_in_a_folder_and_the_same_in_an_archive_are_one(folder):
    case = read(folder, corner())
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    packed = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    expected = by_hand(folder)
    same(run(case), expected)
    same(run(packed), expected)
    assert case.system.bonds == packed.system.bonds == (cosim.Bond.between("car", "shock"),)


def test_an_unpacked_package_goes_with_the_last_of_its_components(folder):
    write_archive(folder / "corner.ssp", {**resources(folder), "SystemStructure.ssd": corner()})
    case = read_case(folder / "corner.ssp", given=Given(folder / "road.csv"))
    file = case.fmus["shock"]
    assert file.is_file()
    del case
    gc.collect()
    assert not file.exists()


NESTED_PORTS = connectors(v="input m/s", x="input", f="output")
NESTED_LINKS = link(":v", "damper.velocity") + link(":x", "damper.displacement") + link("damper.force", ":f")
OUTER_LINKS = link("car.velocity", "axle.v") + link("car.displacement", "axle.x") + link("axle.f", "car.force")
DAMPER = SHOCK.replace('name="shock"', 'name="damper"')


def test_nested_systems_are_flattened_and_stay_bonds(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    case = read(folder, corner(CAR + inner, OUTER_LINKS))
    assert "component names: axle.damper is axle_damper" in case.notes
    assert case.system.bonds == (cosim.Bond.between("car", "axle_damper"),)
    same(run(case), by_hand(folder), lambda name: name.replace("axle_damper", "shock"))


def test_a_name_that_flattening_would_take_twice_is_numbered(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    spare = component("axle_damper", "resources/lpnl2.fmu", extra=bindings(binding(
        parameter("velocity", 0.0), parameter("displacement", 0.0), parameter("gas_stiffness", 0.0))))  # fmt: skip
    case = read(folder, corner(CAR + inner + spare, OUTER_LINKS))
    assert set(case.system.components) == {"car", "axle_damper", "axle_damper_2"}
    assert "component names: axle.damper is axle_damper_2" in case.notes


@pytest.mark.parametrize("kind", ["description", "package", "package without a type", "variant"])
def test_another_description_may_stand_for_a_component(folder, kind):
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


def test_a_system_of_the_same_document_may_stand_for_a_component(folder):
    twin = system("twin", DAMPER, NESTED_LINKS, NESTED_PORTS, id="definition")
    idle = bindings(binding(parameter("twin.damper.gas_stiffness", 0.0)))
    case = read(folder, corner(CAR + component("axle", "#definition") + twin, OUTER_LINKS, bindings=idle))
    assert case.system.bonds == (cosim.Bond.between("car", "axle_damper"),)
    assert set(case.system.components) == {"car", "axle_damper", "twin_damper"}
    own = system("twin", component("inner", "#definition"), "", id="definition")
    with pytest.raises(WiringError, match="component 'inner': the system '#definition' holds itself"):
        read(folder, corner(CAR + own, ""))


def test_a_description_that_holds_itself_is_refused(folder):
    element = component("axle", "corner.ssd", type="application/x-ssp-definition")
    with pytest.raises(WiringError, match=r"corner\.ssd holds itself"):
        read(folder, corner(CAR + element, ""))
    (folder / "a.ssd").write_bytes(description(system("a", component("b", "b.ssd"), "")))
    (folder / "b.ssd").write_bytes(description(system("b", component("a", "a.ssd"), "")))
    with pytest.raises(WiringError, match=r"[ab]\.ssd holds itself"):
        read(folder, corner(CAR + component("a", "a.ssd"), ""))


def rewrite(folder, name, pattern, replacement):
    """Change the model description of an FMU in the folder: what FMUs of others are like."""
    path = folder / "resources" / f"{name}.fmu"
    members = read_archive(path)
    text, count = re.subn(pattern, replacement, members["modelDescription.xml"].decode(), flags=re.DOTALL)
    assert count > 0
    write_archive(path, {**members, "modelDescription.xml": text.encode()})


def without_units(folder, name):
    """Let an FMU state no units, as tools do that know none."""
    rewrite(folder, name, ' (unit|displayUnit)="[^"]*"', "")


def in_swift(folder, factor):
    """Let the shock state its velocities in [swift], a unit of its own."""
    rewrite(folder, "lpnl2", '<BaseUnit m="1" s="-1"', rf'\g<0> factor="{factor}"')
    rewrite(folder, "lpnl2", '"m/s"', '"swift"')


def gains(case):
    return {(c.source, c.target): (c.gain, c.offset) for c in case.system.all_connections}


def test_units_that_only_the_description_knows_are_converted(folder):
    without_units(folder, "lpnl2")
    shock = SHOCK.replace("m/s", "brisk")
    case = read(folder, corner(CAR + shock))
    # The FMU states no unit, so the connector's [brisk] = 1.25 m/s is what its numbers are in.
    assert gains(case)["car.velocity", "shock.velocity"] == (pytest.approx(0.8, rel=1e-15), 0.0)
    assert gains(case)["shock.force", "car.force"] == (1.0, 0.0)
    # Power in other units at the two ends is no bond whose energy could be metered.
    assert case.system.bonds == ()
    ways = [
        cosim.Connection("car.velocity", "shock.velocity", 0.8),
        *cosim.Bond.between("car", "shock").connections[1:],
    ]
    expected = by_hand(folder, bonds=[], connections=ways)
    assert run(case).series["car.velocity"] == pytest.approx(expected.series["car.velocity"], rel=1e-9, abs=1e-12)


def test_a_units_factor_and_offset_are_both_converted(folder):
    without_units(folder, "lpnl2")
    raised = '<ssc:Unit name="raised"><ssc:BaseUnit m="1" s="-1" factor="0.5" offset="0.25"/></ssc:Unit></ssd:Units>'
    top = system("corner", CAR + SHOCK.replace("m/s", "raised"), LINKS)
    case = read(folder, description(top, units=UNITS.replace("</ssd:Units>", raised)))
    # velocity [m/s] = 0.5 x + 0.25
    assert gains(case)["car.velocity", "shock.velocity"] == (2.0, -0.5)


def test_connectors_without_units_and_of_one_unknown_unit_carry_the_numbers(folder):
    without_units(folder, "lpnl2")
    without_units(folder, "quarter_car")
    unknown = UNITS.replace("</ssd:Units>", '<ssc:Unit name="pu"><ssc:BaseUnit/></ssc:Unit></ssd:Units>')
    for change in (
        lambda text: re.sub(' unit="[^"]*" ', "", text),
        lambda text: re.sub('unit="[^"]*"', 'unit="pu"', text),
    ):
        case = read(folder, description(system("corner", change(CAR + SHOCK), LINKS), units=unknown), drive=None)
        assert set(gains(case).values()) == {(1.0, 0.0)}


def test_a_system_connector_in_another_unit_changes_nothing(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS.replace("m/s", "swift"))
    case = read(folder, corner(CAR + inner, OUTER_LINKS))
    assert gains(case)["car.velocity", "axle_damper.velocity"] == (pytest.approx(1.0, rel=1e-15), 0.0)
    assert len(case.system.bonds) == 1


def test_transformations_come_after_units_and_in_place_of_them_where_units_are_suppressed(folder):
    linear = '<ssc:LinearTransformation factor="-2" offset="0.5"/>'
    without_units(folder, "lpnl2")
    shock = SHOCK.replace("m/s", "swift")

    def velocity(**attributes):
        changed = LINKS.replace(link("car.velocity", "shock.velocity"), "")
        return read(folder, corner(CAR + shock, changed + link("car.velocity", "shock.velocity", linear, **attributes)))

    ends = ("car.velocity", "shock.velocity")
    assert gains(velocity())[ends] == (pytest.approx(-2000.0), 0.5)
    assert gains(velocity(suppressUnitConversion="true"))[ends] == (-2.0, 0.5)
    assert gains(velocity(suppressUnitConversion="1"))[ends] == (-2.0, 0.5)


def test_suppressed_units_of_two_fmus_are_undone(folder):
    """The system converts by the FMUs' own units; the package says not to."""
    in_swift(folder, 0.001)
    shock = SHOCK.replace("m/s", "swift")
    changed = LINKS.replace(link("car.velocity", "shock.velocity"), "")
    plain, suppressed = (
        gains(read(folder, corner(CAR + shock, changed + link("car.velocity", "shock.velocity", **given))))
        for given in ({}, {"suppressUnitConversion": "true"})
    )
    ends = ("car.velocity", "shock.velocity")
    assert plain[ends] == (pytest.approx(1.0), 0.0)
    assert suppressed[ends] == (pytest.approx(1e-3), 0.0)


def test_chained_transformations_multiply(folder):
    twice = '<ssc:LinearTransformation factor="2" offset="1"/>'
    inner_links = NESTED_LINKS.replace(link(":v", "damper.velocity"), link(":v", "damper.velocity", twice))
    outer_links = OUTER_LINKS.replace(link("car.velocity", "axle.v"), link("car.velocity", "axle.v", twice))
    case = read(folder, corner(CAR + system("axle", DAMPER, inner_links, NESTED_PORTS), outer_links))
    assert gains(case)["car.velocity", "axle_damper.velocity"] == (4.0, 3.0)


@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize("engine", ["python", "compiled"])
def test_an_offset_reaches_the_component_as_a_constant_on_the_same_input_would(folder, engine, factor):
    linear = f'<ssc:LinearTransformation factor="{factor}" offset="0.1"/>'
    changed = LINKS.replace(*(link("car.velocity", "shock.velocity", inside) for inside in ("", linear)))
    moved = read(folder, corner(links=changed))
    assert gains(moved)["car.velocity", "shock.velocity"] == (factor, 0.1)
    added = cosim.System(
        moved.system.components,
        connections=[replace(c, offset=0.0) for c in moved.system.all_connections],
        sums={"shock.velocity"},
        constants={**moved.system.constants, "shock.velocity": 0.1},
    )
    series, expected = (cosim.run(s, moved.scenario, step=1e-3, engine=engine).series for s in (moved.system, added))
    for name in expected.names:
        assert series[name] == pytest.approx(expected[name], rel=1e-9, abs=1e-9), name
    assert np.abs(series["shock.force"] - by_hand(folder).series["shock.force"]).mean() > 100.0


def test_a_turned_shock_is_a_bond_and_a_lever_on_one_way_only_is_none(folder):
    turned = '<ssc:LinearTransformation factor="-1"/>'
    ways = (
        ("car.velocity", "shock.velocity"),
        ("car.displacement", "shock.displacement"),
        ("shock.force", "car.force"),
    )
    case = read(folder, corner(links="".join(link(*ends, turned) for ends in ways)))
    assert case.system.bonds == (cosim.Bond.between("car", "shock", gain=-1.0),)
    lever = read(
        folder, corner(links=LINKS.replace(link("shock.force", "car.force"), link("shock.force", "car.force", turned)))
    )
    assert lever.system.bonds == () and len(lever.system.connections) == 3


def values(case, name="shock"):
    return dict(case.system.parameters.get(name, {}))


def shock_with(*each):
    return SHOCK.replace("</ssd:Component>", bindings(*each) + "</ssd:Component>")


def test_values_of_components_and_systems_are_found_by_name_and_the_higher_level_wins(folder):
    low = shock_with(
        binding(parameter("compression_scale", 1.1), parameter("rebound_scale", 1.1), parameter("gas_preload", 7.0)),
        binding(parameter("rebound_scale", 1.3)),
    )
    high = bindings(
        binding(parameter("shock.compression_scale", 1.2)),
        binding(parameter("motion_ratio", 0.5), prefix="shock."),
    )
    case = read(folder, corner(CAR + low, bindings=high))
    assert values(case) == {"compression_scale": 1.2, "rebound_scale": 1.3, "gas_preload": 7.0, "motion_ratio": 0.5}
    expected = by_hand(folder, parameters={"shock": values(case)})
    same(run(case), expected)


def test_external_values_carry_units_of_their_own_file(folder):
    pounds = (
        f'<ssv:Units><ssc:Unit name="pfund"><ssc:BaseUnit kg="1" m="1" s="-2" factor="{LBF}"/></ssc:Unit></ssv:Units>'
    )
    (folder / "resources" / "soft.ssv").write_text(
        parameter_set(parameter("gas_preload", 10.0, unit="pfund"), parameter("nothing", 1.0), units=pounds)
    )
    case = read(folder, corner(CAR + shock_with(binding(source="resources/soft.ssv"))))
    assert values(case) == {"gas_preload": pytest.approx(10.0 * LBF)}
    assert any("soft.ssv: no variable takes shock.nothing" in note for note in case.notes)


def test_values_inside_the_components_own_archive_are_found(folder):
    path = folder / "resources" / "lpnl2.fmu"
    write_archive(path, {**read_archive(path), "extra/soft.ssv": parameter_set(parameter("gas_preload", 9.0)).encode()})
    inside = binding(source="extra/soft.ssv").replace(
        "<ssd:ParameterBinding", '<ssd:ParameterBinding sourceBase="component"'
    )
    assert values(read(folder, corner(CAR + shock_with(inside)))) == {"gas_preload": 9.0}


def entry(source, target, inside="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<ssm:MappingEntry source="{source}" target="{target}"{given}>{inside}</ssm:MappingEntry>'


def mapping(*entries):
    return f'<ssm:ParameterMapping{NAMESPACES} version="1.0">{"".join(entries)}</ssm:ParameterMapping>'


@pytest.mark.parametrize("external", [True, False])
def test_a_mapping_renames_and_transforms_and_lets_other_names_be(folder, external):
    text = mapping(
        entry("preload", "gas_preload", '<ssc:LinearTransformation factor="2" offset="5"/>'),
        entry("scale", "compression_scale"),
        entry("scale", "rebound_scale", '<ssc:LinearTransformation factor="0.5"/>'),
    )
    if external:
        (folder / "names.ssm").write_text(text)
    element = (
        '<ssd:ParameterMapping source="names.ssm"/>'
        if external
        else f"<ssd:ParameterMapping>{text}</ssd:ParameterMapping>"
    )
    given = (parameter("preload", 10.0, unit="N"), parameter("scale", 1.4), parameter("motion_ratio", 0.5))
    case = read(folder, corner(CAR + shock_with(binding(*given, mapping=element))))
    expected = {"gas_preload": 25.0, "compression_scale": 1.4, "rebound_scale": 0.7, "motion_ratio": 0.5}
    assert values(case) == expected
    assert case.notes == ()


def test_sets_and_mappings_that_another_library_writes_are_read(folder):
    from pyssp_standard import SSM, SSV, Transformation  # noqa: PLC0415

    with SSV(folder / "setup.ssv", "w") as values_file:
        values_file.add_parameter("preload", value=10.0, unit="pfund")
        values_file.add_parameter("level", "Boolean", value="true")
        values_file.add_unit("pfund", {"kg": 1, "m": 1, "s": -2, "factor": LBF})
    with SSM(folder / "setup.ssm", "w") as mapping_file:
        double = Transformation("LinearTransformation", {"factor": 2.0, "offset": 5.0})
        mapping_file.add_mapping("preload", "shock.gas_preload", transformation=double)
        mapping_file.add_mapping("level", "car.start_at_equilibrium")
    bound = bindings(binding(source="setup.ssv", mapping='<ssd:ParameterMapping source="setup.ssm"/>'))
    case = read(folder, corner(bindings=bound))
    assert values(case) == {"gas_preload": pytest.approx(2.0 * 10.0 * LBF + 5.0)}
    assert values(case, "car") == {"start_at_equilibrium": True}


def test_tables_map_truth_and_numbers(folder):
    table = (
        '<ssc:BooleanMappingTransformation><ssc:MapEntry source="0" target="true"/>'
        '<ssc:MapEntry source="true" target="false"/></ssc:BooleanMappingTransformation>'
    )
    text = mapping(entry("off", "car.start_at_equilibrium", table))
    given = binding(
        parameter("off", "false", "Boolean"), mapping=f"<ssd:ParameterMapping>{text}</ssd:ParameterMapping>"
    )
    case = read(folder, corner(bindings=bindings(given)))
    assert case.system.parameters["car"] == {"start_at_equilibrium": True}


def test_a_value_at_a_system_connector_reaches_what_it_feeds_in_its_units(folder):
    ports = connectors(v="input", x="input", f="output", scale="parameter", preload="parameter swift")
    with_parameters = (
        NESTED_LINKS
        + link(":scale", "damper.compression_scale", '<ssc:LinearTransformation factor="0.5"/>')
        + link(":preload", "damper.friction_velocity")
    )
    inner = system("axle", DAMPER, with_parameters, ports, bindings(binding(parameter("scale", 9.0))))
    high = bindings(binding(parameter("axle.scale", 3.0), parameter("axle.preload", 20.0)))
    case = read(folder, corner(CAR + inner, OUTER_LINKS, bindings=high))
    assert values(case, "axle_damper") == {"compression_scale": 1.5, "friction_velocity": pytest.approx(0.02)}


def test_a_value_for_an_input_that_a_component_feeds_is_only_its_start(folder):
    case = read(folder, corner(CAR + shock_with(binding(parameter("velocity", 0.3)))))
    assert dict(case.system.constants) == {"car.aero_force": 100.0}


def as_enumeration(folder):
    """Turn one parameter of the shock into an enumeration."""
    variable = '(<ScalarVariable name="motion_ratio"[^>]*>\\s*)<Real.*?/>'
    rewrite(folder, "lpnl2", variable, r'\1<Enumeration declaredType="Feel" start="1"/>')
    items = '<Item name="soft" value="1"/><Item name="hard" value="7"/>'
    types = (
        f'<TypeDefinitions><SimpleType name="Feel"><Enumeration>{items}</Enumeration></SimpleType></TypeDefinitions>'
    )
    rewrite(folder, "lpnl2", "<LogCategories>", types + "<LogCategories>")


def test_initial_values_of_states_and_of_true_or_false_inputs_are_set_and_computed_ones_left_out(folder):
    state = r'\g<1>causality="local" variability="continuous"'
    rewrite(folder, "lpnl2", '(name="compression_scale"[^>]*)causality="parameter" variability="tunable"', state)
    switch = r'\g<1>causality="input" variability="discrete"'
    equilibrium = '(name="start_at_equilibrium"[^>]*)causality="parameter" variability="fixed" initial="exact"'
    rewrite(folder, "quarter_car", equilibrium, switch)
    given = (("shock.compression_scale", 2.0, "Real"), ("car.start_at_equilibrium", "false", "Boolean"))
    given += (("shock.force", 3.0, "Real"),)
    case = read(folder, corner(bindings=bindings(binding(*(parameter(*each) for each in given)))))
    assert case.system.parameters == {"shock": {"compression_scale": 2.0}, "car": {"start_at_equilibrium": False}}
    assert any("shock.force = 3.0 is left out" in note for note in case.notes)
    assert np.ptp(run(case).series["shock.force"]) > 1.3 * np.ptp(by_hand(folder).series["shock.force"])


def test_an_enumerations_item_has_the_number_that_the_fmu_gives_it(folder):
    as_enumeration(folder)
    case = read(folder, corner(CAR + shock_with(binding(parameter("motion_ratio", "hard", "Enumeration")))))
    assert values(case) == {"motion_ratio": 7}
    with pytest.raises(WiringError, match=r"motion_ratio = 'firm' is no item of its enumeration \(soft, hard\)"):
        read(folder, corner(CAR + shock_with(binding(parameter("motion_ratio", "firm", "Enumeration")))))


def test_a_drive_reaches_inputs_through_the_packages_own_connector_in_its_unit(folder):
    """The road in mm at the package's edge; two cars on it."""
    twin = CAR.replace('name="car"', 'name="twin"')
    dampers = SHOCK + SHOCK.replace('name="shock"', 'name="other"')
    links = (
        LINKS
        + LINKS.replace("car", "twin").replace("shock", "other")
        + link(":z", "car.road")
        + link(":z", "twin.road")
    )
    case = read(folder, corner(CAR + twin + dampers, links, ports=connectors(z="input mm")), drive=renamed(folder, "z"))
    result = run(case)
    expected = by_hand(folder)
    for one, two in (("car.velocity", "twin.velocity"), ("shock.force", "other.force")):
        assert np.array_equal(result.series[one], result.series[two])
        assert result.series[one] == pytest.approx(expected.series[one], rel=1e-9, abs=1e-9)


def renamed(folder, name, **options):
    series = Drivefile.read(folder / "road.csv").series
    path = folder / "renamed.parquet"
    write_series(TimeSeries.from_channels(series.time, {name: ("m", series["road"])}), path)
    return path


@pytest.mark.parametrize("channel", ["road", "car.road", "body.car.road", "body_car.road"])
def test_a_drive_channel_is_called_by_input_by_component_or_by_path(folder, channel):
    if channel.startswith("body"):
        ports = connectors(v="output", x="output", f="input")
        inner_links = link("car.velocity", ":v") + link("car.displacement", ":x") + link(":f", "car.force")
        inner = system("body", CAR, inner_links, ports)
        links = link("body.v", "shock.velocity") + link("body.x", "shock.displacement") + link("shock.force", "body.f")
        case = read(folder, corner(inner + SHOCK, links), drive=renamed(folder, channel))
        assert [bond.name for bond in case.system.bonds] == ["body_car"]
    else:
        case = read(folder, corner(), drive=renamed(folder, channel))
    same(run(case), by_hand(folder), lambda name: name.replace("body_car", "car"))


def test_an_open_input_stays_as_the_fmu_has_it_unless_a_constant_is_given(folder):
    open_ = read(folder, corner(CAR_ALONE + SHOCK), drive=None)
    assert dict(open_.system.constants) == {"car.road": 0.0, "car.aero_force": 0.0}
    assert any("nothing feeds these inputs" in n and "car.road = 0, car.aero_force = 0" in n for n in open_.notes)
    case = read(folder, corner(CAR_ALONE + SHOCK), drive=None, inputs={"car.road": "10 mm", "aero_force": "-3"})
    assert dict(case.system.constants) == {"car.road": pytest.approx(0.01), "car.aero_force": -3.0}
    assert case.notes == ()


def test_a_constant_that_nothing_takes_is_named(folder):
    for inputs, said in (
        ({"car.speed": "1"}, r"input 'car\.speed': none takes it.* open are: car\.road, car\.aero_force"),
        ({"car.aero_force": "10 mm"}, "dimensions differ"),
        ({"car.aero_force": "much"}, "input 'car.aero_force': "),
        ({"road": "1"}, r"input 'road': the drivefile feeds car\.road too"),
    ):
        with pytest.raises(WiringError, match=said):
            read(folder, corner(), inputs=inputs)


def test_the_default_experiment_gives_times_and_annotations_the_step(folder):
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


def test_legal_oddities_are_read(folder):
    """Other prefixes, a default namespace, comments, percent-encoded names, ends drawn the other way, no connectors."""
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


def test_a_package_of_ssp_2_is_read_where_fmi_2_has_what_it_says(folder):
    text = description(system("corner", CAR + SHOCK, LINKS), version="2.0").decode()
    text = text.replace("ssc:Real", "ssc:Float64")
    text = text.replace("ssv:Real", "ssv:Float64").replace('kind="output"', 'kind="local"', 1)
    assert 'name="velocity" kind="local"' in text
    same(run(read(folder, text.encode())), by_hand(folder))


def test_another_engine_agrees_on_a_nested_package(folder):
    """FMPy's simulate_ssp holds coupled values over each step: it comes near as its step gets small."""
    from fmpy.ssp.simulation import simulate_ssp  # noqa: PLC0415
    from fmpy.ssp.ssd import read_ssv  # noqa: PLC0415

    # FMPy knows no coupled start: the shock gives no force before it moves.
    given = (parameter("axle.damper.gas_preload", 0.0), parameter("axle.damper.rebound_scale", 1.5))
    (folder / "resources" / "setup.ssv").write_text(parameter_set(*given))
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    links, ports = OUTER_LINKS + link(":z", "car.road"), connectors(z="input m")
    content = corner(CAR_ALONE + inner, links, ports=ports, bindings=bindings(binding(source="resources/setup.ssv")))
    write_archive(folder / "corner.ssp", {"SystemStructure.ssd": content, **resources(folder)})
    ours = run(read_case(folder / "corner.ssp", given=Given(renamed(folder, "z")))).series
    road, step = Drivefile.read(folder / "road.csv").series, 1e-4
    theirs = simulate_ssp(
        str(folder / "corner.ssp"),
        stop_time=0.3 - step / 2,
        step_size=step,
        parameter_set=read_ssv(str(folder / "resources" / "setup.ssv")),
        input={"z": lambda time: float(np.interp(time, road.time, road["road"]))},
    )
    for our_name, name in (("car.velocity", "car.velocity"), ("axle_damper.force", "axle.damper.force")):
        # A row holds what a step gave, under the time at which the step began.
        expected = np.interp(ours.time, theirs["time"] + step, theirs[name])
        assert np.std(ours[our_name] - expected) < 0.01 * np.std(expected), name


VELOCITY = re.escape(link("car.velocity", "shock.velocity"))
TABLE = '<ssc:BooleanMappingTransformation><ssc:MapEntry source="0" target="1"/></ssc:BooleanMappingTransformation>'
BUS = '<ssd:SignalDictionaryReference name="bus" dictionary="b"/>'
TOO_LOW = bindings(binding(parameter("friction_velocity", -1.0)))
STEP = '<ssd:Annotations><ssc:Annotation type="o"><FixedStepMaster stepSize="0"/></ssc:Annotation></ssd:Annotations>'
#: What is replaced by what (a regular expression, once), the error, and what it says.
BROKEN = {
    "no XML": ("ption>$", "", InputError, "not a readable XML file"),
    "entities": (r"\?>\n", '?>\n<!DOCTYPE x [<!ENTITY a "aa">]>', InputError, "declares a document type"),
    "another root": ("SSP1/SystemStructureDescription", "Draft", InputError, r"root element is \{http.*/Draft\}"),
    "version 3": ('"1.0">', '"3.0">', InputError, r"is SSP 3\.0, SSP 1\.0 and 2\.0 are read here"),
    "no system": ("<ssd:System .*</ssd:System>", "", InputError, "there is no System"),
    "no component": ("<ssd:Elements>.*</ssd:Connections>", "", WiringError, "holds no component"),
    "missing FMU": ("lpnl2.fmu", "lpnl3.fmu", InputError,
                    r"component 'shock': there is no file 'resources/lpnl3\.fmu'; add it, or correct the source"),
    "drive letter": ("resources/lpnl2", "C:/lpnl2", InputError, "'C:/lpnl2.fmu' is neither relative"),
    "another scheme": ("resources/lpnl2", "https://a.b/lpnl2", InputError, "put the file into the package"),
    "another computer": ("resources/lpnl2", "file://host/lpnl2", InputError, "is neither relative"),
    "no address": ("resources/lpnl2", "http://[lpnl2", InputError, r"there is no file 'http://\[lpnl2\.fmu'"),
    "backslash": ("resources/lpnl2", r"resources\\lpnl2", InputError, "with forward slashes"),
    "no source": (' source="resources/lpnl2.fmu"', "", InputError, "component 'shock': a Component has no .*'source'"),
    "model exchange": ('name="shock"', 'name="shock" implementation="ModelExchange"', WiringError,
                       "component 'shock': asks for model exchange"),
    "unknown kind of component": ('name="shock"', 'name="shock" type="text/x-modelica"', WiringError,
                                  "component 'shock': the type 'text/x-modelica' cannot be run; export it as an FMU"),
    "signal dictionary": ("</ssd:Elements>", f"{BUS}</ssd:Elements>", WiringError,
                          "system 'corner': 'bus' is a signal dictionary, which cannot be run; connect"),
    "same name": ('name="shock"', 'name="car"', WiringError, "two elements are called 'car'"),
    "two outputs": ('"shock" endConnector="velocity"', '"shock" endConnector="force"', WiringError,
                    r"car\.velocity -> shock\.force joins car\.velocity \(output\) and shock\.force \(output\)"),
    "unknown element": ('endElement="shock"', 'endElement="damper"', WiringError,
                        "there is no element 'damper'; there are car, shock"),
    "unknown connector": ('endConnector="velocity"', 'endConnector="speed"', WiringError,
                          r"there is no connector shock\.speed"),
    "connector without a variable": ('name="velocity" kind="input"(.*)endConnector="velocity"',
                                     r'name="speed" kind="input"\1endConnector="speed"', WiringError,
                                     r"shock\.speed: the FMU has no such variable"),
    "two sources": ("</ssd:Connections>", link("car.displacement", "shock.velocity") + "</ssd:Connections>",
                    WiringError, r"shock\.velocity has two sources"),
    "unknown kind": ('kind="input"', 'kind="inlet"', InputError, "connector 'force' has the kind 'inlet'"),
    "wrong type": ('(name="velocity" kind="input"><ssc:)Real unit="m/s"', r"\1Integer", WiringError,
                   "is a Integer, the FMU's variable a Real"),
    "contradicting unit": ('kind="input"><ssc:Real unit="m/s"', 'kind="input"><ssc:Real unit="swift"', WiringError,
                           r"connector 'velocity' is in \[swift\] and the FMU's variable in \[m/s\]"),
    "other dimension": ('endConnector="velocity"(.*)endConnector="displacement"',
                        r'endConnector="displacement"\1endConnector="velocity"', WiringError, "dimensions differ"),
    "table on a connection": (VELOCITY, link("car.velocity", "shock.velocity", TABLE), WiringError,
                              "Boolean tables cannot be run"),
    "crooked factor": (VELOCITY, link("car.velocity", "shock.velocity", '<ssc:LinearTransformation factor="two"/>'),
                       InputError, "factor='two' is not a number"),
    "crooked unit": ('s="-1"', 's="-1.5"', InputError, r"unit 'm/s': BaseUnit s='-1\.5' is not a whole number"),
    "missing values": ("</ssd:Connectors></ssd:Component>",
                       f"</ssd:Connectors>{bindings(binding(source='none.ssv'))}</ssd:Component>", InputError,
                       r"component 'shock': parameter binding: there is no file 'none\.ssv'"),
    "unknown sort of values": ("<ssd:ParameterBinding>", '<ssd:ParameterBinding type="application/x-cdf">', InputError,
                               "the type 'application/x-cdf' cannot be read"),
    "value of the wrong type": ('Real value="100.0"', 'Boolean value="true"', WiringError,
                                r"car\.aero_force = True is given as Boolean, the variable is a Real"),
    "value that is no number": ('value="100.0"', 'value="much"', InputError, "value='much' is not a number"),
    "value out of range": ("</ssd:Connectors></ssd:Component>", f"</ssd:Connectors>{TOO_LOW}</ssd:Component>",
                           WiringError, r"friction_velocity = -1\.0 m/s is outside its range"),
    "no stop time": (EXPERIMENT, "", InputError, "has no DefaultExperiment with a stopTime; say how long"),
    "impossible step": ('stopTime="0.3"/>', f'stopTime="0.3">{STEP}</ssd:DefaultExperiment>', InputError,
                        r"stepSize = 0\.0, which is no step"),
}  # fmt: skip


@pytest.mark.parametrize("fault", BROKEN)
def test_what_is_wrong_in_a_package_is_named(folder, fault):
    old, new, error, said = BROKEN[fault]
    broken, count = re.subn(old, new, corner().decode(), count=1, flags=re.DOTALL)
    assert count == 1
    with pytest.raises(error, match=said) as caught:
        read_as_it_is(folder, broken.encode())
    assert str(folder / "corner.ssd") in str(caught.value)
    assert "/tmp/ssp_" not in str(caught.value) and "/tmp/fmu_" not in str(caught.value)


@pytest.mark.parametrize("source", ["../lpnl2.fmu", "%2e%2e/lpnl2.fmu", "/lpnl2.fmu"])
def test_a_source_does_not_leave_an_archive(folder, source):
    shutil.copy(folder / "resources" / "lpnl2.fmu", folder / "lpnl2.fmu")
    content = corner().replace(b"resources/lpnl2.fmu", source.encode())
    write_archive(folder / "corner.ssp", {"SystemStructure.ssd": content, **resources(folder)})
    with pytest.raises(InputError, match=r"corner\.ssp.* component 'shock': the source '.*' leaves the package"):
        read_case(folder / "corner.ssp")


def test_a_bare_description_may_name_files_beside_its_folder_and_by_address(folder):
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


def test_archives_that_are_none_or_hold_no_description_are_named(folder):
    (folder / "text.ssp").write_text("no zip")
    with pytest.raises(FmuError, match=r"text\.ssp: is not a readable zip"):
        read_case(folder / "text.ssp")
    with pytest.raises(FmuError, match="there is no such file"):
        read_case(folder / "none.ssp")
    with pytest.raises(InputError, match="there is no such file"):
        read_case(folder / "none.ssd")
    write_archive(folder / "other.ssp", {"A.ssd": b"<x/>", "b.txt": b""})
    with pytest.raises(InputError, match=r"no SystemStructure\.ssd in the archive; it holds A\.ssd"):
        read_case(folder / "other.ssp")
    write_archive(folder / "evil.ssp", {"../x.ssd": b"<x/>"})
    with pytest.raises(FmuError, match="would be written outside"):
        read_case(folder / "evil.ssp")


def test_an_fmu_that_cannot_be_used_is_named_by_its_place_in_the_package(folder):
    write_archive(folder / "bad.ssp", {"SystemStructure.ssd": corner(), "resources/quarter_car.fmu": b"no zip",
                                       "resources/lpnl2.fmu": b"no zip"})  # fmt: skip
    with pytest.raises(
        FmuError, match=r"bad\.ssp: SystemStructure\.ssd: component 'car' \(resources/quarter_car\.fmu\): is not"
    ):
        read_case(folder / "bad.ssp")


def test_a_shock_of_a_package_is_swapped_by_its_flat_name(folder, fmus):
    (folder / "corner.ssd").write_bytes(corner())
    given = Given(folder / "road.csv")
    case = read_case(folder / "corner.ssd", fmus={"shock": fmus["polylinear"]}, given=given)
    assert case.fmus["shock"] == fmus["polylinear"]
    assert "time_constant" not in case.system.components["shock"].variables
    with pytest.raises(WiringError, match="no component 'damper' to swap; there are car, shock"):
        read_case(folder / "corner.ssd", fmus={"damper": fmus["polylinear"]}, given=given)


def test_what_the_ssp_verb_writes_runs_with_the_numbers_of_the_system_file(folder):
    in_swift(folder, 0.8)
    (folder / "corner.toml").write_text(SYSTEM_FILE)
    wrote = CliRunner().invoke(main, ["ssp", str(folder / "corner.toml")])
    assert wrote.exit_code == 0, wrote.output
    line = ["run", str(folder / "corner.ssp"), "-o", str(folder / "out"), "--drive", str(folder / "road.csv")]
    ran = CliRunner().invoke(main, [*line, "--record-step", "2 ms"])
    assert ran.exit_code == 0, ran.output
    expected = run(read_case(folder / "corner.toml"))
    series = read_series(folder / "out" / "series.parquet")
    assert series.names == expected.series.names and np.array_equal(series.time, expected.series.time)
    assert all(np.array_equal(series[name], expected.series[name]) for name in series.names)
    assert f"bond car: energy residual {expected.energy['car'].residual:+.2e} J" in ran.output


SYSTEM_FILE = """
schema = 1
[components.car]
fmu = "resources/quarter_car.fmu"
inputs = { aero_force = "25 lbf" }
[components.shock]
fmu = "resources/lpnl2.fmu"
parameters = { rebound_scale = 1.3, friction_velocity = "4 mm/s" }
[[bond]]
between = ["car", "shock"]
[scenario]
drivefile = "road.csv"
stop = "0.2 s"
coupling_step = "0.5 ms"
record_step = "2 ms"
"""


def test_a_package_written_again_keeps_its_offsets_and_is_not_written_over(folder):
    offset = link("car.velocity", "shock.velocity", '<ssc:LinearTransformation factor="1" offset="0.1"/>')
    (folder / "corner.ssd").write_bytes(corner(links=LINKS.replace(link("car.velocity", "shock.velocity"), offset)))
    for first, second in (("corner.ssd", "once.ssp"), ("once.ssp", "twice.ssp")):
        ran = CliRunner().invoke(main, ["ssp", str(folder / first), "-o", str(folder / second)])
        assert ran.exit_code == 0, ran.output
    series, expected = (
        run(read_case(folder / name, given=Given(folder / "road.csv"))).series for name in ("twice.ssp", "corner.ssd")
    )
    assert all(np.array_equal(series[name], expected[name]) for name in expected.names)
    ran = CliRunner().invoke(main, ["ssp", str(folder / "twice.ssp")])
    assert ran.exit_code == 2 and "is the package itself" in ran.output


def test_the_verb_takes_what_a_package_lacks(folder, monkeypatch):
    monkeypatch.setattr("eightpost.commands.run.plot_traces", lambda *_, **__: None)
    (folder / "corner.ssd").write_bytes(corner(CAR_ALONE + SHOCK))
    line = ["run", str(folder / "corner.ssd"), "-o", str(folder / "out"), "--drive", str(folder / "road.csv")]
    line += ["--input", "car.aero_force=100 N", "--stop", "200 ms", "--record-step", "0.01", "--step", "2 ms"]
    ran = CliRunner().invoke(main, line)
    assert ran.exit_code == 0, ran.output
    assert "100 steps of 2 ms" in ran.output and "bond car: energy residual" in ran.output
    assert read_series(folder / "out" / "series.parquet").time == pytest.approx(np.linspace(0.0, 0.2, 21))


def test_the_verb_refuses_a_packages_options_beside_a_system_file(folder):
    (folder / "case.toml").write_text("schema = 1\n")
    for option in (["--stop", "1"], ["--drive", "road.csv"], ["--input", "a.b=1"], ["--record-step", "1 ms"]):
        ran = CliRunner().invoke(main, ["run", str(folder / "case.toml"), "-o", str(folder / "out"), *option])
        assert ran.exit_code == 2 and "change it there" in ran.output
    ran = CliRunner().invoke(main, ["run", str(folder / "case.toml"), "-o", str(folder / "out"), "--stop", "1 m"])
    assert ran.exit_code == 2 and "--stop: cannot convert" in ran.output


def test_the_example_of_the_documentation_runs_as_it_says(folder, monkeypatch):
    monkeypatch.setattr("eightpost.commands.run.plot_traces", lambda *_, **__: None)
    page = (Path(__file__).parents[2] / "docs" / "ssp.md").read_text(encoding="utf-8")
    example, command = re.search(r"```xml\n(.*?)```\n\n```sh\n(.*?)```", page, re.DOTALL).groups()
    for ours, name in (("quarter_car", "car"), ("lpnl2", "shock")):
        shutil.copy(folder / "resources" / f"{ours}.fmu", folder / "resources" / f"{name}.fmu")
    case = read(folder, example.encode(), drive=renamed(folder, "z"))
    assert values(case) == {"gas_preload": pytest.approx(54.48, abs=0.005)}
    expected = by_hand(
        folder,
        bonds=[cosim.Bond.between("car", "shock", gain=-1.0)],
        parameters={"shock": {"gas_preload": 10.0 * LBF + 10.0}},
        constants={"car.aero_force": 25.0 * LBF},
    )
    series = read_series(renamed(folder, "z"))
    write_series(series, folder / "road.csv")
    monkeypatch.chdir(folder)
    ran = CliRunner().invoke(main, [*shlex.split(command)[1:], "--step", "1 ms"])
    assert ran.exit_code == 0, ran.output
    assert "bond car: energy residual" in ran.output and "nothing feeds" not in ran.output
    found = read_series(folder / "out" / "series.parquet")
    for name in expected.series.names:
        assert found[name] == pytest.approx(expected.series[name], rel=1e-9, abs=1e-9), name
