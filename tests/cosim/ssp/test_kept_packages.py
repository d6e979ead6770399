"""What a package becomes: components, connections, values and times, kept part by part."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cosim.ssp.flatten import with_bonds
from cosim.systems.system import Connection
from eightpost.errors import InputError

from .corner import CAR, CAR_ALONE, DAMPER, NESTED_LINKS, NESTED_PORTS, OUTER_LINKS, SHOCK, corner, read, shock_with
from .document import binding, bindings, component, connectors, description, entry, link, mapping, parameter, system

Unchanged = Callable[..., None]

HALF = '<ssc:LinearTransformation factor="0.5" offset="0.25"/>'


def case_lines(case: Any) -> dict[str, Any]:
    """Return what a case contains, a line for each connection and value."""
    found = {
        "components": list(case.fmus), "bonds": [str(bond) for bond in case.system.bonds],
        "connections": [
            f"{c.source} -> {c.target} {c.gain:.8g} {c.offset:.8g} {c.convert}" for c in case.system.all_connections
        ],
        "parameters": {name: str(dict(values)) for name, values in case.system.parameters.items()},
        "constants": dict(case.system.constants), "targets": dict(case.scenario.targets), "notes": case.notes,
    }  # fmt: skip
    scenario = case.scenario
    return found | {"stop": scenario.stop, "start": scenario.drive_start, "step": case.step, "name": case.name}


def packages() -> dict[str, bytes]:
    """Return descriptions by what they show."""
    nested = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS)
    scaled = link("car.velocity", "shock.velocity", HALF) + link("car.displacement", "shock.displacement") + link(
        "shock.force", "car.force", '<ssc:LinearTransformation factor="2"/>')  # fmt: skip
    entries = mapping(entry("k", "rebound_scale", HALF), entry("c", "gas_stiffness"))
    inline = f"<ssd:ParameterMapping>{entries}</ssd:ParameterMapping>"
    mapped = binding(parameter("k", 2.0), parameter("c", 900.0), mapping=inline)
    step = '<ssc:Annotation type="a"><FixedStepMaster stepSize="0.004"/></ssc:Annotation>'
    annotated = corner(after=f"<ssd:Annotations>{step}</ssd:Annotations>")
    start = '<ssd:DefaultExperiment startTime="0.1" stopTime="0.5"/>'
    outer = connectors(road="input m", out="output m/s")
    ports = link("car.velocity", "shock.velocity") + link("shock.force", "car.force") + link(":road", "car.road")
    ports += link("car.displacement", "shock.displacement") + link("car.velocity", ":out")
    values = bindings(binding(parameter("car.aero_force", 50.0), parameter("shock.compression_scale", 0.75)))
    twice = '<ssc:LinearTransformation factor="2" offset="1"/>'
    chained = [links.replace(link(*ends), link(*ends, twice)) for links, ends in (
        (NESTED_LINKS, (":v", "damper.velocity")), (OUTER_LINKS, ("car.velocity", "axle.v")))]  # fmt: skip
    table = """<ssc:BooleanMappingTransformation><ssc:MapEntry source="0" target="true"/>
<ssc:MapEntry source="true" target="false"/></ssc:BooleanMappingTransformation>"""
    switch = f"<ssd:ParameterMapping>{mapping(entry('off', 'car.start_at_equilibrium', table))}</ssd:ParameterMapping>"
    inputs = connectors(v="input", x="input", f="output", scale="parameter", preload="parameter swift")
    given = NESTED_LINKS + link(":scale", "damper.compression_scale", '<ssc:LinearTransformation factor="0.5"/>')
    inner = system("axle", DAMPER, given + link(":preload", "damper.friction_velocity"), inputs,
                   bindings(binding(parameter("scale", 9.0))))  # fmt: skip
    high = bindings(binding(parameter("axle.scale", 3.0), parameter("axle.preload", 20.0)))
    idle = bindings(binding(*(parameter(name, 0.0) for name in ("velocity", "displacement", "gas_stiffness"))))
    spare = component("axle_damper", "resources/lpnl2.fmu", extra=idle)
    swift = system("axle", DAMPER, NESTED_LINKS, NESTED_PORTS.replace("m/s", "swift"))
    return {
        "chained": corner(CAR + system("axle", DAMPER, chained[0], NESTED_PORTS), chained[1]),
        "a table": corner(bindings=bindings(binding(parameter("off", "false", "Boolean"), mapping=switch))),
        "connected values": corner(CAR + inner, OUTER_LINKS, bindings=high),
        "two of a name": corner(CAR + nested + spare, OUTER_LINKS), "another unit": corner(CAR + swift, OUTER_LINKS),
        "a start value": corner(CAR + shock_with(binding(parameter("velocity", 0.3)))),
        "plain": corner(), "scaled": corner(links=scaled),
        "nested": description(system("corner", CAR + nested, OUTER_LINKS)),
        "mapped": corner(CAR + shock_with(mapped)), "annotated": annotated,
        "values": corner(CAR + shock_with(binding(parameter("rebound_scale", 1.5), parameter("gas_preload", 10.0)))),
        "experiment": corner().replace(b'<ssd:DefaultExperiment startTime="0" stopTime="0.3"/>', start.encode()),
        "ports": description(system("corner", CAR_ALONE + SHOCK, ports, outer, values)),
    }  # fmt: skip


@pytest.mark.parametrize("name", packages())
def test_a_package_is_unchanged(name: str, folder: Path, unchanged: Unchanged) -> None:
    unchanged(case_lines(read(folder, packages()[name])))


@pytest.mark.parametrize("step", ["0", "-0.001", "inf", "nan"])
def test_a_step_of_an_annotation_that_is_none_is_refused(step: str, folder: Path) -> None:
    content = packages()["annotated"].replace(b'stepSize="0.004"', f'stepSize="{step}"'.encode())
    with pytest.raises(InputError, match="which is not a step"):
        read(folder, content)
    other = packages()["annotated"].replace(b'stepSize="0.004"', b'other="1"')
    assert read(folder, other).step is None


@pytest.mark.parametrize(("gains", "bonded"), [
    ((1.0, 1.0, 1.0), (True, True)), ((2.0, 2.0, 1.0), (True, False)), ((1.0, 1.0 + 1e-8, 1.0), (False, False)),
    ((1.0, 1.0 + 1e-10, 1.0), (True, True)), ((1.0, -1.0, 1.0), (False, False)),
    ((-1.0, -1.0, -1.0), (True, True)),
])  # fmt: skip
def test_a_bond_has_the_same_gain_both_ways(gains: tuple[float, ...], bonded: tuple[bool, bool]) -> None:
    ends = [(f"{a}.{x}", f"{b}.{x}") for a, b, x in (("car", "shock", "velocity"), ("shock", "car", "force"),
                                                     ("car", "shock", "displacement"))]  # fmt: skip
    given = tuple(Connection(*pair, gain) for pair, gain in zip(ends, gains, strict=True))
    bonds, others = with_bonds(given)
    assert (bool(bonds), bool(bonds and bonds[0].displacement)) == bonded
    assert all(one.gain == pytest.approx(gains[0]) for bond in bonds for one in bond.connections[:2])
    assert len(others) == 3 - (2 if bonded[0] else 0) - bonded[1]
    moved = (Connection("car.velocity", "shock.velocity", 1.0, 0.1), *given[1:])
    assert with_bonds(moved) == ((), moved)
