"""The shocks of Tables 3.1 and 7.3, assembled from calibrated parts (docs/dynamometer.md says how)."""

from __future__ import annotations

from dataclasses import dataclass

from eightpost.errors import ParameterError
from eightpost.rig.damper.body import GasChamber
from eightpost.rig.damper.physical import PhysicalDamper
from eightpost.rig.damper.shims import ShimStack
from eightpost.rig.damper.valves import Bleed, HeadValve, MainPiston, ShimValve
from eightpost.units import convert

#: One square millimetre [m2].
_MM2 = 1e-6

_PSI = convert(1.0, "psi", "Pa")

#: Highest gas pressure that a shock of this kind is charged to, gauge [Pa].
HIGHEST_GAS = 400.0 * _PSI


@dataclass(frozen=True, slots=True)
class Shims:
    """The three stacks of a shock, by the code of Table 7.2.

    Attributes:
        compression: On the main piston.
        rebound: On the main piston.
        head: On the head valve.
    """

    compression: str
    rebound: str
    head: str = "B"


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of Table 3.1.

    Attributes:
        build: As the table names it: 1, 2 or 4.
        clicks: Of the bleed adjuster, from fully open.
        gas_pressure: Gauge [Pa].
    """

    build: int
    clicks: int
    gas_pressure: float


#: The three builds of 3.2.2: baseline, softer compression shims on the head valve, and on the main piston.
SHIMS_OF_BUILD = {1: Shims("B", "B", "B"), 2: Shims("B", "B", "A+"), 4: Shims("A", "B", "B")}

#: Table 3.1, numbered in its order from 1.
CONFIGURATIONS = {
    number: Setting(build, clicks, pressure * _PSI)
    for number, (build, pressure, clicks) in enumerate(
        ((build, pressure, clicks) for build in SHIMS_OF_BUILD for pressure in (50.0, 150.0) for clicks in (1, 14)),
        start=1,
    )
}

#: Table 7.3: compression stack / rebound stack.
BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")


def configuration(number: int) -> PhysicalDamper:
    """Return a shock of Table 3.1, on a digressive piston.

    Args:
        number: 1 to 12, in the table's order.

    Raises:
        ParameterError: There is no such row.
    """
    if number not in CONFIGURATIONS:
        raise ParameterError(f"no configuration {number!r}; Table 3.1 has 1 to {len(CONFIGURATIONS)}")
    setting = CONFIGURATIONS[number]
    return digressive(SHIMS_OF_BUILD[setting.build], clicks=setting.clicks, gas_pressure=setting.gas_pressure)


def shim_build(name: str, *, clicks: int = 1, gas_pressure: float = 150.0 * _PSI) -> PhysicalDamper:
    """Return a shock on a linear piston, such as those of Table 7.3.

    Args:
        name: Compression and rebound stack of Table 7.2, as `C/B`; any of the 19 codes.
        clicks: Of the rebound bleed from fully open, 0 to 28; more, more closed.
        gas_pressure: Gauge, 0 to 400 psi [Pa].

    Raises:
        ParameterError: No such shims, clicks or pressure.
    """
    compression, slash, rebound = name.partition("/")
    if not slash:
        raise ParameterError(f"{name!r}: write a build as COMPRESSION/REBOUND, such as {BUILDS[5]}")
    return linear(Shims(compression, rebound), clicks=clicks, gas_pressure=gas_pressure)


def digressive(shims: Shims, *, clicks: int, gas_pressure: float) -> PhysicalDamper:
    """Return a shock with a dished main piston and a bleed jet: the builds of chapter 3.

    Args:
        shims: The stacks.
        clicks: Of the rebound bleed, from fully open.
        gas_pressure: Gauge [Pa].
    """
    return _shock(shims, clicks=clicks, gas_pressure=gas_pressure, dish=0.635e-3, jet_area=2.7 * _MM2)


def linear(shims: Shims, *, clicks: int, gas_pressure: float) -> PhysicalDamper:
    """Return a shock with a flat main piston: the builds of chapter 7; arguments as `digressive`."""
    return _shock(shims, clicks=clicks, gas_pressure=gas_pressure, dish=0.0, jet_area=0.3 * _MM2)


def _shock(shims: Shims, *, clicks: int, gas_pressure: float, dish: float, jet_area: float) -> PhysicalDamper:
    if not 0.0 <= gas_pressure <= HIGHEST_GAS:
        given, most = gas_pressure / _PSI, HIGHEST_GAS / _PSI
        raise ParameterError(f"the gas pressure must be 0 to {most:g} psi over the atmosphere, not {given:g} psi")
    compression, rebound = (
        ShimValve(ShimStack(code), port_area=40.0 * _MM2, edge=0.09, dish=dish)
        for code in (shims.compression, shims.rebound)
    )
    return PhysicalDamper(
        piston=MainPiston(compression, rebound, Bleed(clicks, area_per_click=0.06 * _MM2), jet_area),
        head=HeadValve(
            ShimValve(ShimStack(shims.head), port_area=20.0 * _MM2, edge=0.04, dish=1.1e-3),
            jet_area=0.3 * _MM2,
            return_area=40.0 * _MM2,
        ),
        gas=GasChamber(gas_pressure),
    )
