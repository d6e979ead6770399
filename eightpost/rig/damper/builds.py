"""Shocks of Tables 3.1 and 7.3, assembled from calibrated parts (see docs/explanation/dynamometer.md)."""

from __future__ import annotations

from dataclasses import dataclass

from eightpost.errors import ParameterError
from eightpost.rig.damper.body import GasChamber
from eightpost.rig.damper.physical import PhysicalDamper
from eightpost.rig.damper.valves import Bleed, HeadValve, MainPiston, ShimStack, ShimValve
from eightpost.units import convert

#: One square millimetre [m2].
_MM2 = 1e-6

#: One pound per square inch [Pa].
PSI = convert(1.0, "psi", "Pa")

#: Maximum gas pressure of a shock of this type, gauge [Pa].
HIGHEST_GAS = 400.0 * PSI


@dataclass(frozen=True, slots=True)
class Shims:
    """Codes of Table 7.2 for the three shim stacks of a shock."""

    compression: str  #: Compression stack on the main piston.
    rebound: str  #: Rebound stack on the main piston.
    head: str = "B"  #: Compression stack on the head valve.


@dataclass(frozen=True, slots=True)
class Setting:
    """One row of Table 3.1."""

    build: int  #: Build number in the table: 1, 2 or 4.
    clicks: int  #: Clicks of the bleed adjuster from fully open.
    gas_pressure: float  #: Gauge pressure of the gas [Pa].


#: The three builds of 3.2.2: baseline, softer compression shims on the head valve, and softer ones on the main piston.
SHIMS_OF_BUILD = {1: Shims("B", "B", "B"), 2: Shims("B", "B", "A+"), 4: Shims("A", "B", "B")}

#: Rows of Table 3.1, numbered from 1.
CONFIGURATIONS = {
    number: Setting(build, clicks, pressure * PSI)
    for number, (build, pressure, clicks) in enumerate(
        ((build, pressure, clicks) for build in SHIMS_OF_BUILD for pressure in (50.0, 150.0) for clicks in (1, 14)),
        start=1,
    )
}

#: Builds of Table 7.3: compression stack / rebound stack.
BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")


def configuration(number: int) -> PhysicalDamper:
    """Return a shock of Table 3.1, with a dished (digressive) main piston and a bleed jet.

    Args:
        number: Number of the row in the table, 1 to 12.

    Raises:
        ParameterError: The row does not exist.
    """
    if number not in CONFIGURATIONS:
        raise ParameterError(f"there is no configuration {number!r}; Table 3.1 has 1 to {len(CONFIGURATIONS)}")
    setting = CONFIGURATIONS[number]
    shims, clicks, gas_pressure = SHIMS_OF_BUILD[setting.build], setting.clicks, setting.gas_pressure
    return shimmed_shock(shims, clicks=clicks, gas_pressure=gas_pressure, dish=0.635e-3, jet_area=2.7 * _MM2)


def shim_build(name: str, *, clicks: int = 1, gas_pressure: float = 150.0 * PSI) -> PhysicalDamper:
    """Return a shock with a flat (linear) main piston, such as those of Table 7.3.

    Args:
        name: Codes of the compression and rebound stacks in Table 7.2, such as `C/B`; any of the 19 codes.
        clicks: Clicks of the rebound bleed adjuster from fully open, 0 to 28; more clicks close the bleed.
        gas_pressure: Gauge pressure of the gas [Pa], 0 to 400 psi.

    Raises:
        ParameterError: The shim code does not exist, or clicks or pressure are out of range.
    """
    compression, slash, rebound = name.partition("/")
    if not slash:
        raise ParameterError(f"{name!r} is not a build; write it as COMPRESSION/REBOUND, such as {BUILDS[5]}")
    shims = Shims(compression, rebound)
    return shimmed_shock(shims, clicks=clicks, gas_pressure=gas_pressure, dish=0.0, jet_area=0.3 * _MM2)


def shimmed_shock(shims: Shims, *, clicks: int, gas_pressure: float, dish: float, jet_area: float) -> PhysicalDamper:
    """Return a shock with shims, a piston with a dish [m] (0: flat) and a bleed jet [m2].

    Raises:
        ParameterError: A shim code does not exist, or clicks or pressure are out of range.
    """
    if not 0.0 <= gas_pressure <= HIGHEST_GAS:
        given, most = gas_pressure / PSI, HIGHEST_GAS / PSI
        raise ParameterError(f"the gas pressure must be 0 to {most:g} psi gauge, not {given:g} psi")
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
