"""Factors and offsets on connections become gains and offsets of the system."""

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
    read,
    without_units,
)
from .document import link, system


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


@pytest.mark.repeated
@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize("engine", ["python", "compiled"])
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


def test_a_reversed_shock_is_a_bond_but_a_factor_in_only_one_direction_is_not(folder):
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
