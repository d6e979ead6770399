"""Parameter sets and mappings set the variables that they name."""

import numpy as np
import pytest

from eightpost.archive import read_archive, write_archive
from eightpost.errors import WiringError

from .corner import (
    CAR,
    CAR_ALONE,
    DAMPER,
    LBF,
    LINKS,
    NESTED_LINKS,
    OUTER_LINKS,
    SHOCK,
    by_hand,
    corner,
    read,
    renamed,
    rewrite,
    run,
    same,
    shock_with,
    values,
)
from .document import binding, bindings, connectors, entry, link, mapping, parameter, parameter_set, system


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


def test_a_boolean_mapping_table_maps_booleans_and_numbers(folder):
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


def test_a_value_at_a_system_connector_is_converted_to_the_units_of_the_connected_parameter(folder):
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


def test_a_value_for_a_connected_input_is_only_its_start_value(folder):
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


def test_an_error_names_a_constant_that_no_open_input_accepts(folder):
    for inputs, message in (
        ({"car.speed": "1"}, r"input 'car\.speed' matches no open input.* open inputs: car\.road, car\.aero_force"),
        ({"car.aero_force": "10 mm"}, "dimensions differ"),
        ({"car.aero_force": "much"}, "input 'car.aero_force': "),
        ({"road": "1"}, r"input 'road': the drive file feeds car\.road too"),
    ):
        with pytest.raises(WiringError, match=message):
            read(folder, corner(), inputs=inputs)
