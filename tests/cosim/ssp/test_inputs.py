"""Open inputs of a package are fed by a drive, by constants or by the FMU's start values."""

import numpy as np
import pytest

from eightpost.errors import WiringError

from .corner import CAR, CAR_ALONE, LINKS, SHOCK, by_hand, corner, read, renamed, run, same
from .document import connectors, link, system


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
