"""Parameter sets and mappings set the variables that they name."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import cosim
from eightpost.archive import read_archive, write_archive
from eightpost.errors import WiringError
from tests.unchanged import refusals

from .corner import (
    CAR,
    CAR_ALONE,
    LBF,
    LINKS,
    SHOCK,
    by_hand,
    corner,
    gains,
    in_swift,
    read,
    renamed,
    rewrite,
    run,
    same,
    shock_with,
    values,
    without_units,
)
from .document import (
    UNITS,
    binding,
    bindings,
    connectors,
    description,
    entry,
    link,
    mapping,
    parameter,
    parameter_set,
    system,
)


def test_values_are_matched_by_name_and_the_higher_level_takes_precedence(folder):
    low = shock_with(
        binding(parameter("compression_scale", 1.1), parameter("rebound_scale", 1.1), parameter("gas_preload", 7.0)),
        binding(parameter("rebound_scale", 1.3)),
    )
    high = bindings(
        binding(parameter("shock.compression_scale", 1.2)), binding(parameter("motion_ratio", 0.5), prefix="shock.")
    )
    case = read(folder, corner(CAR + low, bindings=high))
    assert values(case) == {"compression_scale": 1.2, "rebound_scale": 1.3, "gas_preload": 7.0, "motion_ratio": 0.5}
    expected = by_hand(folder, parameters={"shock": values(case)})
    same(run(case), expected)


def test_external_values_use_the_units_of_their_own_file(folder):
    pounds = (
        f'<ssv:Units><ssc:Unit name="pfund"><ssc:BaseUnit kg="1" m="1" s="-2" factor="{LBF}"/></ssc:Unit></ssv:Units>'
    )
    (folder / "resources" / "soft.ssv").write_text(
        parameter_set(parameter("gas_preload", 10.0, unit="pfund"), parameter("nothing", 1.0), units=pounds)
    )
    case = read(folder, corner(CAR + shock_with(binding(source="resources/soft.ssv"))))
    assert values(case) == {"gas_preload": pytest.approx(10.0 * LBF)}
    assert any("soft.ssv: no variable matches shock.nothing" in note for note in case.notes)


def test_values_inside_the_components_archive_are_found(folder):
    path = folder / "resources" / "lpnl2.fmu"
    write_archive(path, {**read_archive(path), "extra/soft.ssv": parameter_set(parameter("gas_preload", 9.0)).encode()})
    inside = binding(source="extra/soft.ssv").replace(
        "<ssd:ParameterBinding", '<ssd:ParameterBinding sourceBase="component"'
    )
    assert values(read(folder, corner(CAR + shock_with(inside)))) == {"gas_preload": 9.0}


@pytest.mark.parametrize("external", [True, False])
def test_a_mapping_renames_and_transforms_values_and_keeps_other_names(folder, external):
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


def test_parameter_sets_and_mappings_of_another_library_are_read(folder):
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


def as_enumeration(folder):
    """Turn one parameter of the shock into an enumeration."""
    variable = '(<ScalarVariable name="motion_ratio"[^>]*>\\s*)<Real.*?/>'
    rewrite(folder, "lpnl2", variable, r'\1<Enumeration declaredType="Feel" start="1"/>')
    items = '<Item name="soft" value="1"/><Item name="hard" value="7"/>'
    types = (
        f'<TypeDefinitions><SimpleType name="Feel"><Enumeration>{items}</Enumeration></SimpleType></TypeDefinitions>'
    )
    rewrite(folder, "lpnl2", "<LogCategories>", types + "<LogCategories>")


def test_initial_values_of_states_and_boolean_inputs_are_set_and_of_outputs_ignored(folder):
    state = r'\g<1>causality="local" variability="continuous"'
    rewrite(folder, "lpnl2", '(name="compression_scale"[^>]*)causality="parameter" variability="tunable"', state)
    switch = r'\g<1>causality="input" variability="discrete"'
    equilibrium = '(name="start_at_equilibrium"[^>]*)causality="parameter" variability="fixed" initial="exact"'
    rewrite(folder, "quarter_car", equilibrium, switch)
    given = (("shock.compression_scale", 2.0, "Real"), ("car.start_at_equilibrium", "false", "Boolean"))
    given += (("shock.force", 3.0, "Real"),)
    case = read(folder, corner(bindings=bindings(binding(*(parameter(*each) for each in given)))))
    assert case.system.parameters == {"shock": {"compression_scale": 2.0}, "car": {"start_at_equilibrium": False}}
    assert any("shock.force = 3.0 is ignored" in note for note in case.notes)
    assert np.ptp(run(case).series["shock.force"]) > 1.3 * np.ptp(by_hand(folder).series["shock.force"])


def test_an_enumeration_item_has_the_number_defined_in_the_fmu(folder):
    as_enumeration(folder)
    case = read(folder, corner(CAR + shock_with(binding(parameter("motion_ratio", "hard", "Enumeration")))))
    assert values(case) == {"motion_ratio": 7}
    with pytest.raises(WiringError, match=r"motion_ratio = 'firm' is not an item of its enumeration \(soft, hard\)"):
        read(folder, corner(CAR + shock_with(binding(parameter("motion_ratio", "firm", "Enumeration")))))


# ==== Open inputs are fed by a drive, by constants or by the FMU's start values ======================================


def test_a_drive_feeds_inputs_through_a_system_connector_in_its_unit(folder):
    """The system connector takes the road in mm and feeds two cars."""
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


@pytest.mark.repeated
@pytest.mark.parametrize("channel", ["road", "car.road", "body.car.road", "body_car.road"])
def test_a_drive_channel_is_named_by_input_component_or_path(folder, channel):
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


def test_an_open_input_keeps_its_start_value_unless_a_constant_is_given(folder):
    open_ = read(folder, corner(CAR_ALONE + SHOCK), drive=None)
    assert dict(open_.system.constants) == {"car.road": 0.0, "car.aero_force": 0.0}
    assert any("these inputs have no source" in n and "car.road = 0, car.aero_force = 0" in n for n in open_.notes)
    case = read(folder, corner(CAR_ALONE + SHOCK), drive=None, inputs={"car.road": "10 mm", "aero_force": "-3"})
    assert dict(case.system.constants) == {"car.road": pytest.approx(0.01), "car.aero_force": -3.0}
    assert case.notes == ()


def test_an_error_names_a_constant_that_no_open_input_accepts(folder, unchanged):
    given = ({"car.speed": "1"}, {"car.aero_force": "10 mm"}, {"car.aero_force": "much"}, {"road": "1"})
    unchanged(refusals({str(one): partial(read, folder, corner(), inputs=one) for one in given}))


# ==== Factors and offsets on connections become gains and offsets of the system ======================================


ENDS = ("car.velocity", "shock.velocity")
LINEAR = '<ssc:LinearTransformation factor="-2" offset="0.5"/>'
RAISED = '<ssc:Unit name="raised"><ssc:BaseUnit m="1" s="-1" factor="0.5" offset="0.25"/></ssc:Unit></ssd:Units>'
SUPPRESSED = {"suppressUnitConversion": "true"}


@pytest.mark.parametrize(("unit", "inside", "attributes", "in_fmu", "gain"), [
    ("swift", LINEAR, {}, False, (-2000.0, 0.5)), ("swift", LINEAR, SUPPRESSED, False, (-2.0, 0.5)),
    ("swift", LINEAR, {"suppressUnitConversion": "1"}, False, (-2.0, 0.5)),
    ("swift", "", {}, True, (1.0, 0.0)), ("swift", "", SUPPRESSED, True, (1e-3, 0.0)),
    ("raised", "", {}, False, (2.0, -0.5)),
], ids=["after", "instead", "by a number", "of both FMUs", "undone", "with an offset"])  # fmt: skip
def test_units_are_converted_before_a_transformation_unless_that_is_suppressed(
    folder, unit, inside, attributes, in_fmu, gain
):
    """1 swift is 1 mm/s; velocity [m/s] = 0.5 x + 0.25 in raised. The system converts between the units of FMUs."""
    if in_fmu:
        in_swift(folder, 0.001)
    else:
        without_units(folder, "lpnl2")
    links = LINKS.replace(link(*ENDS), "") + link(*ENDS, inside, **attributes)
    top = system("corner", CAR + SHOCK.replace("m/s", unit), links)
    case = read(folder, description(top, units=UNITS.replace("</ssd:Units>", RAISED)))
    assert gains(case)[ENDS] == pytest.approx(gain, rel=1e-12)


@pytest.mark.parametrize(("engine", "factor"), [("python", 1.0), ("compiled", 0.5)])
def test_an_offset_has_the_effect_of_a_constant_on_the_same_input(folder, engine, factor):
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


# ==== Units of connectors and of FMUs are converted exactly once =====================================================


def test_units_defined_only_in_the_description_are_converted(folder):
    without_units(folder, "lpnl2")
    shock = SHOCK.replace("m/s", "brisk")
    case = read(folder, corner(CAR + shock))
    # The FMU states no unit, so its values are in the connector's unit [brisk] = 1.25 m/s.
    assert gains(case)["car.velocity", "shock.velocity"] == (pytest.approx(0.8, rel=1e-15), 0.0)
    assert gains(case)["shock.force", "car.force"] == (1.0, 0.0)
    # With different power units at the two ends, this is not a bond with an energy balance.
    assert case.system.bonds == ()
    ways = [
        cosim.Connection("car.velocity", "shock.velocity", 0.8),
        *cosim.Bond.between("car", "shock").connections[1:],
    ]
    expected = by_hand(folder, bonds=[], connections=ways)
    assert run(case).series["car.velocity"] == pytest.approx(expected.series["car.velocity"], rel=1e-9, abs=1e-12)


def test_connectors_without_units_or_with_the_same_unknown_unit_are_not_converted(folder):
    without_units(folder, "lpnl2")
    without_units(folder, "quarter_car")
    unknown = UNITS.replace("</ssd:Units>", '<ssc:Unit name="pu"><ssc:BaseUnit/></ssc:Unit></ssd:Units>')
    for change in (
        lambda text: re.sub(' unit="[^"]*" ', "", text),
        lambda text: re.sub('unit="[^"]*"', 'unit="pu"', text),
    ):
        case = read(folder, description(system("corner", change(CAR + SHOCK), LINKS), units=unknown), drive=None)
        assert set(gains(case).values()) == {(1.0, 0.0)}
