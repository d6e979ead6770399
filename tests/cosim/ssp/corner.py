"""A quarter car with its shock: as packages, and wired by hand in Python."""

import re
from functools import cache
from pathlib import Path

import numpy as np

import cosim
from cosim.ssp import Given
from cosim.system_file import read_case
from eightpost.archive import read_archive, write_archive
from eightpost.signals import Drivefile, TimeSeries, write_series

from .document import binding, bindings, component, connectors, description, link, parameter, system

LBF = 4.4482216152605
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
    """Return the result of the same corner, wired in Python."""
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


NESTED_PORTS = connectors(v="input m/s", x="input", f="output")
NESTED_LINKS = link(":v", "damper.velocity") + link(":x", "damper.displacement") + link("damper.force", ":f")
OUTER_LINKS = link("car.velocity", "axle.v") + link("car.displacement", "axle.x") + link("axle.f", "car.force")
DAMPER = SHOCK.replace('name="shock"', 'name="damper"')


def rewrite(folder, name, pattern, replacement):
    """Change the model description of an FMU in the folder, to imitate FMUs of other tools."""
    path = folder / "resources" / f"{name}.fmu"
    members = read_archive(path)
    text, count = re.subn(pattern, replacement, members["modelDescription.xml"].decode(), flags=re.DOTALL)
    assert count > 0
    write_archive(path, {**members, "modelDescription.xml": text.encode()})


def without_units(folder, name):
    """Remove the units from an FMU's description, as in FMUs of tools without units."""
    rewrite(folder, name, ' (unit|displayUnit)="[^"]*"', "")


def in_swift(folder, factor):
    """Declare the shock's velocities in [swift], a unit that only this FMU defines."""
    rewrite(folder, "lpnl2", '<BaseUnit m="1" s="-1"', rf'\g<0> factor="{factor}"')
    rewrite(folder, "lpnl2", '"m/s"', '"swift"')


def gains(case):
    return {(c.source, c.target): (c.gain, c.offset) for c in case.system.all_connections}


def values(case, name="shock"):
    return dict(case.system.parameters.get(name, {}))


def shock_with(*each):
    return SHOCK.replace("</ssd:Component>", bindings(*each) + "</ssd:Component>")


def renamed(folder, name, **options):
    series = Drivefile.read(folder / "road.csv").series
    path = folder / "renamed.parquet"
    write_series(TimeSeries.from_channels(series.time, {name: ("m", series["road"])}), path)
    return path
