"""Factors and offsets on connections become gains and offsets of the system."""

import re
from dataclasses import replace

import numpy as np
import pytest

import cosim

from .corner import (
    CAR,
    DAMPER,
    LINKS,
    NESTED_LINKS,
    NESTED_PORTS,
    OUTER_LINKS,
    SHOCK,
    by_hand,
    corner,
    gains,
    in_swift,
    read,
    run,
    without_units,
)
from .document import UNITS, description, link, system


def test_transformations_apply_after_unit_conversion_or_replace_it_if_it_is_suppressed(folder):
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


def test_chained_transformations_multiply(folder):
    twice = '<ssc:LinearTransformation factor="2" offset="1"/>'
    inner_links = NESTED_LINKS.replace(link(":v", "damper.velocity"), link(":v", "damper.velocity", twice))
    outer_links = OUTER_LINKS.replace(link("car.velocity", "axle.v"), link("car.velocity", "axle.v", twice))
    case = read(folder, corner(CAR + system("axle", DAMPER, inner_links, NESTED_PORTS), outer_links))
    assert gains(case)["car.velocity", "axle_damper.velocity"] == (4.0, 3.0)


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


def test_a_units_factor_and_offset_are_both_converted(folder):
    without_units(folder, "lpnl2")
    raised = '<ssc:Unit name="raised"><ssc:BaseUnit m="1" s="-1" factor="0.5" offset="0.25"/></ssc:Unit></ssd:Units>'
    top = system("corner", CAR + SHOCK.replace("m/s", "raised"), LINKS)
    case = read(folder, description(top, units=UNITS.replace("</ssd:Units>", raised)))
    # velocity [m/s] = 0.5 x + 0.25
    assert gains(case)["car.velocity", "shock.velocity"] == (2.0, -0.5)


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


def test_a_system_connector_in_another_unit_changes_nothing(folder):
    inner = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS.replace("m/s", "swift"))
    case = read(folder, corner(CAR + inner, OUTER_LINKS))
    assert gains(case)["car.velocity", "axle_damper.velocity"] == (pytest.approx(1.0, rel=1e-15), 0.0)
    assert len(case.system.bonds) == 1


def test_suppressed_unit_conversion_undoes_the_conversion_between_two_fmus(folder):
    """The system converts between the FMUs' units, but the package suppresses the conversion."""
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
