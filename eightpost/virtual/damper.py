"""Physical damper of two compressible chambers, shim valves and gas, and its builds: parts of Tables 3.1 and 7.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from eightpost.array_types import Array, Integers
from eightpost.errors import ParameterError
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.kernel import LONGEST_STEP, PHYSICAL, ShockRow, along
from eightpost.virtual.valves import (
    ATMOSPHERE,
    SHIM_SETS,
    Cylinder,
    Fluid,
    GasChamber,
    Passage,
    Seals,
    ShimStack,
    Valve,
    open_passage,
    shim_passage,
)


@dataclass(frozen=True)
class PhysicalDamper:
    """A monotube race shock similar to a Penske 7300, as in section 3.1 of the dissertation without linearisations.

    The states are the levels of the compression and the rebound chamber and the ratio of the gas volume to its volume
    at rest:

        V_c = A_c (l_c - x), V_r = A_r (l_r + x); U = V psi(p) the fluid in a chamber
        dU_c / dt = -Q_m(p_c - p_r) - Q_h(p_c - p_g),  dU_r / dt = Q_m(p_c - p_r),  dV_g / dt = -Q_h(p_c - p_g)

    Flows are volumes of fluid at atmospheric pressure, so the fluid is conserved exactly: U_c + U_r - V_g is constant.
    The force of the port is (Eq 3.9, relative to the atmosphere)

        F = p_c A_c - p_r A_r - p_atm A_rod + seal drag        positive in compression

    Displacement is measured from mid-travel, the 3 in offset of 3.2.1. Temperature effects on the fluid, dissolved gas,
    inertia of shims, floating piston and fluid, bushings, and end stops are not modelled.
    """

    main_valve: Valve  #: Flow from the compression to the rebound chamber.
    head_valve: Valve  #: Flow from the compression chamber to the reservoir.
    gas: GasChamber  #: Gas chamber.
    cylinder: Cylinder = field(default_factory=Cylinder)  #: Bore, rod and chambers.
    fluid: Fluid = field(default_factory=Fluid)  #: Oil, free gas and wall.
    seals: Seals = field(default_factory=Seals)  #: Dry friction of the seals.
    #: Heat capacity of shock and oil [J/K], for the body temperature that the dynamometer reads: 1.5 kg at about 900
    #: J/kg/K. All work heats the body, and there is no cooling.
    heat_capacity: float = 1350.0

    # ---- Steady flow -------------------------------------------------------------------------------------------------

    def steady_pressures(self, velocity: float) -> tuple[float, float]:
        """Return the absolute chamber pressures (compression, rebound) [Pa] at a constant velocity [m/s].

        The gas has its charge pressure and the fluid is incompressible, as in 3.1.2; pressures are limited to the
        vapour pressure.
        """
        vapour = self.fluid.vapour_pressure
        compression = max(self.gas.charge + self.head_valve.drop(self.cylinder.rod_area * velocity), vapour)
        rebound = compression - self.main_valve.drop(self.cylinder.rebound_area * velocity)
        return compression, max(rebound, vapour)

    def static_force(self, velocity: float) -> float:
        """Return the force of the valves [N] at a constant velocity [m/s], without gas force and seal friction."""
        compression, rebound = self.steady_pressures(velocity)
        excess = compression - self.gas.charge, rebound - self.gas.charge
        return excess[0] * self.cylinder.compression_area - excess[1] * self.cylinder.rebound_area

    def nominal_damping(self) -> float:
        """Fit a line through the origin to the static force from -10 to 10 in/s, and return its slope [N.s/m]."""
        reach = convert(10.0, "in/s", "m/s")
        speeds = np.linspace(-reach, reach, 81)
        forces = np.array([self.static_force(speed) for speed in speeds.tolist()])
        return float(speeds @ forces / (speeds @ speeds))

    # ---- Motion -----------------------------------------------------------------------------------------------------

    @cached_property
    def row(self) -> ShockRow:
        """The damper as numbers for the compiled integration, at rest at mid-travel."""
        fluid, cylinder, gas = self.fluid, self.cylinder, self.gas
        flows = [number for valve in (self.main_valve, self.head_valve) for passage in valve for number in passage]
        numbers = (
            fluid.vapour_pressure, fluid.span, fluid.gas_exponent, fluid.gas_fraction,
            1.0 / fluid.bulk_modulus, 1.0 / fluid.wall_modulus,
            cylinder.compression_area, cylinder.rebound_area, cylinder.compression_length, cylinder.rebound_length,
            gas.charge, gas.exponent, 1.0 / gas.volume,
            *flows, -ATMOSPHERE * cylinder.rod_area, self.seals.drag, self.seals.length,
        )  # fmt: skip
        return ShockRow(PHYSICAL, numbers, self._rest(0.0))

    def respond(self, motion: TimeSeries, *, rate: float, longest: float = LONGEST_STEP) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline. Before the start, the shock was at rest at the first displacement
        until its pressures were equal.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m] from mid-travel.
            rate: Sample rate of the result [Hz].
            longest: Longest step of the integration [s]; see `kernel.along`.

        Returns:
            Series with displacement [m], velocity [m/s], force [N]; the absolute pressures compression_pressure,
            rebound_pressure and gas_pressure [Pa]; seal_drag [N], which is part of the force; and warming [K], the
            temperature rise since the start.

        Raises:
            ParameterError: The command is not evenly sampled or exceeds the travel.
            StepError: The integration failed.
        """
        path, cylinder = motion["displacement"], self.cylinder
        lowest, highest = cylinder.travel
        if path.min() < lowest or path.max() > highest:
            raise ParameterError(
                f"the displacement ranges from {path.min():g} to {path.max():g} m; the shock's travel is {lowest:g} to "
                f"{highest:g} m from mid-travel"
            )
        time, displacement, velocity, states = along(
            self.row, motion, rate, lambda place, _: self._rest(place), longest=longest
        )
        compression, rebound = (self.fluid.vapour_pressure + self.fluid.span * np.exp(states[:, :2])).T
        gas, drag = self.gas.charge * states[:, 2] ** -self.gas.exponent, states[:, 3]
        force = compression * cylinder.compression_area - rebound * cylinder.rebound_area
        force = force - ATMOSPHERE * cylinder.rod_area + drag
        work = cumulative_trapezoid(force * velocity, time, initial=0)
        return TimeSeries.from_channels(
            time,
            {
                "displacement": ("m", displacement),
                "velocity": ("m/s", velocity),
                "force": ("N", force),
                "compression_pressure": ("Pa", compression),
                "rebound_pressure": ("Pa", rebound),
                "gas_pressure": ("Pa", gas),
                "seal_drag": ("N", drag),
                "warming": ("K", work / self.heat_capacity),
            },
        )

    def _rest(self, displacement: float) -> tuple[float, ...]:
        """Return the states at rest at a displacement [m], with equal pressures and the conserved fluid volume."""
        cylinder, fluid, gas = self.cylinder, self.fluid, self.gas

        def fluid_in(place: float, pressure: float, volume: float) -> float:
            chambers = cylinder.compression_area * (cylinder.compression_length - place)
            chambers += cylinder.rebound_area * (cylinder.rebound_length + place)
            return chambers * fluid.content(pressure) - volume

        filled = fluid_in(0.0, gas.charge, gas.volume)

        def surplus(share: float) -> float:
            return fluid_in(displacement, gas.at(share * gas.volume), share * gas.volume) - filled

        share = float(brentq(surplus, 0.05, 4.0, xtol=1e-13))
        level = fluid.level(gas.at(share * gas.volume))
        return level, level, share, 0.0, displacement


# ==== Builds: shocks of parts, and the valving that comes closest to a wanted curve ===================================

# ---- Builds from calibrated parts (docs/explanation/dynamometer.md) -------------------------------------------------

#: One square millimetre [m2].
_MM2 = 1e-6

#: One pound per square inch [Pa].
PSI = convert(1.0, "psi", "Pa")

#: Maximum gas pressure of a shock of this type, gauge [Pa].
HIGHEST_GAS = 400.0 * PSI


#: Number of clicks of the bleed adjuster from fully open to closed, and area that a click closes [m2].
LAST_CLICK, CLICK_AREA = 28, 0.06 * _MM2


@dataclass(frozen=True, slots=True)
class Valving:
    """Parts that a team changes in a shock.

    The rebound bleed through the rod is open in rebound and closed in compression (3.4.3). Its clicks are counted from
    fully open. The dissertation must use the same convention: section 3.4.1 reports that the error of builds 1 and 2
    increased with a more restrictive bleed setting, and in Table 3.5 it increases from 1 to 14 clicks.
    """

    compression: str = "B"  #: Code of the compression stack on the main piston (Table 7.2).
    rebound: str = "B"  #: Code of the rebound stack on the main piston.
    head: str = "B"  #: Code of the compression stack on the head valve.
    clicks: int = 1  #: Clicks of the rebound bleed from fully open, 0 to 28.
    #: Area of the bleed jet in the main piston and of the leakage past it, in both directions [m2].
    jet: float = 0.3 * _MM2
    dish: float = 0.0  #: Dish of the main piston [m]; 0 on a linear piston.
    gas_pressure: float = 150.0 * PSI  #: Gauge pressure of the gas [Pa].

    def damper(self) -> PhysicalDamper:
        """Return the shock with this valving.

        Raises:
            ParameterError: A code does not exist, or clicks or pressure are out of range.
        """
        if not 0.0 <= self.gas_pressure <= HIGHEST_GAS:
            given, most = self.gas_pressure / PSI, HIGHEST_GAS / PSI
            raise ParameterError(f"the gas pressure must be 0 to {most:g} psi gauge, not {given:g} psi")
        if not 0 <= self.clicks <= LAST_CLICK:
            raise ParameterError(f"the clicks of the bleed adjuster must be 0 to {LAST_CLICK}, not {self.clicks}")
        main = Valve(self.main_passage(self.compression), self.main_passage(self.rebound, self.clicks))
        head = Valve(_head_passage(self.head), open_passage(0.3 * _MM2 + 40.0 * _MM2))
        return PhysicalDamper(main, head, GasChamber(self.gas_pressure))

    def main_passage(self, code: str, clicks: int = LAST_CLICK) -> Passage:
        """Return the main piston's passage of a side with a stack; clicks below the last are those of the rebound."""
        orifice = self.jet + (LAST_CLICK - clicks) * CLICK_AREA
        return shim_passage(ShimStack(code), orifice, port_area=40.0 * _MM2, edge=0.09, dish=self.dish)

    def __str__(self) -> str:
        return (
            f"shims {self.compression}/{self.rebound}, head {self.head}, {self.clicks} clicks from fully open, "
            f"jet {1e6 * self.jet:.2g} mm2, dish {1e3 * self.dish:.2g} mm"
        )


def _head_passage(code: str) -> Passage:
    """Return the passage into the reservoir with a stack: the jet beside it is open in both directions."""
    return shim_passage(ShimStack(code), 0.3 * _MM2, port_area=20.0 * _MM2, edge=0.04, dish=1.1e-3)


class Setting(NamedTuple):
    """One row of Table 3.1."""

    build: int  #: Build number in the table: 1, 2 or 4.
    clicks: int  #: Clicks of the bleed adjuster from fully open.
    gas_pressure: float  #: Gauge pressure of the gas [Pa].


_DIGRESSIVE = Valving(jet=2.7 * _MM2, dish=0.635e-3)

#: The three builds of 3.2.2, with a dished (digressive) main piston: baseline, softer compression shims on the head
#: valve, and softer ones on the main piston.
SHIMS_OF_BUILD = {1: _DIGRESSIVE, 2: replace(_DIGRESSIVE, head="A+"), 4: replace(_DIGRESSIVE, compression="A")}

#: Rows of Table 3.1, numbered from 1.
CONFIGURATIONS = {
    number: Setting(build, clicks, pressure * PSI)
    for number, (build, pressure, clicks) in enumerate(product(SHIMS_OF_BUILD, (50.0, 150.0), (1, 14)), start=1)
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
    build, clicks, gas_pressure = CONFIGURATIONS[number]
    return replace(SHIMS_OF_BUILD[build], clicks=clicks, gas_pressure=gas_pressure).damper()


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
    return Valving(compression, rebound, clicks=clicks, gas_pressure=gas_pressure).damper()


# ---- Valving for a wanted curve: shims, dish, bleed jet and clicks --------------------------------------------------

#: Areas of the bleed jet in the main piston [m2], and dishes of the piston [m], that a search tries.
JETS = tuple(1e-6 * area for area in (0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 1.8, 2.7, 4.0))
DISHES = (0.0, 0.05e-3, 0.1e-3, 0.2e-3, 0.4e-3, 0.635e-3)

#: Levels that a search tries [N].
LEVELS = np.linspace(-150.0, 150.0, 31)

#: Codes of the shim stacks (Table 7.2).
_CODES = tuple(SHIM_SETS)

#: Pressure drops of the tables of flow [Pa]: from far below the seal's friction to above any chamber's pressure.
_DROPS = np.concatenate([[0.0], np.geomspace(1e1, 4e7, 600)])

#: Highest speed to compare [m/s], and number of speeds of a side.
_REACH, _SPEEDS = 1.3, 40


@dataclass(frozen=True, slots=True, eq=False)
class NearestValving:
    """The valving that comes closest to a curve."""

    valving: Valving  #: Parts.
    #: Constant force that the curve has in addition to the damper's [N]: gas force and the level of a dynamometer are
    #: not known exactly, and fitted curves contain a part of them.
    level: float
    residual: float  #: RMS difference of the static forces over both sides [N], without the level.
    relative: float  #: The same as a share of the curve's RMS force [1].
    velocity: Array  #: Velocities that were compared (N,) [m/s].
    force: Array  #: Static force of the damper at these, with seal friction and level (N,) [N].
    combinations: int  #: Number of combinations of parts that were compared.
    limits: tuple[str, ...]  #: Parts that are at the end of what the search may use.


def nearest_valving(force: Callable[[float], float]) -> NearestValving:
    """Return the valving whose static force is closest to a curve at equal steps of the root of the speed.

    All combinations of stacks, clicks, jets and dishes are compared, with the level from -150 to 150 N that suits them
    best. For given jet, dish and level, the compression side depends on the stacks of compression and head only, and
    the rebound side on the stack of rebound and the clicks only, so each side is searched on its own. The forces are
    those of an incompressible fluid, limited by cavitation; the gas has 150 psi.

    Args:
        force: Function that returns the wanted force [N] at a velocity [m/s], including seal friction.

    Raises:
        ParameterError: The curve has no force.
    """
    speeds = _REACH * np.linspace(0.0, 1.0, _SPEEDS + 1)[1:] ** 2
    up, down = (np.array([sign * force(sign * v) for v in speeds.tolist()]) for sign in (1.0, -1.0))
    if not (np.any(up) or np.any(down)):
        raise ParameterError("the wanted curve has no force at any velocity; give a curve of a shock")
    found = []
    for dish in DISHES:
        for jet in JETS:
            base = Valving(jet=jet, dish=dish)
            compression = _side(_compression_forces(base, speeds), up, LEVELS)
            rebound = _side(_rebound_forces(base, speeds), down, -LEVELS)
            sums = compression.loss + rebound.loss
            k = int(sums.argmin())
            (stack, head), (other, clicks) = compression.choices[k], rebound.choices[k]
            parts = replace(
                base, compression=_CODES[stack], head=_CODES[head], rebound=_CODES[other], clicks=int(clicks)
            )
            found.append((float(sums[k]), parts))
    return _stated(min(found, key=lambda pair: pair[0])[1], speeds, up, down)


class _Closest(NamedTuple):
    """Squared error of the closest two parts at each level (L,), and the indices of these parts (L, 2)."""

    loss: Array
    choices: Integers


def _side(forces: Array, wanted: Array, levels: Array) -> _Closest:
    """Return the closest of forces (A, B, N) [N] to the wanted ones (N,) less each level (L,)."""
    errors = forces - wanted
    square, mean = (errors**2).sum(axis=-1), errors.sum(axis=-1)
    sums = square + levels[:, None, None] * (2.0 * mean + levels[:, None, None] * wanted.size)
    flat = sums.reshape(levels.size, -1)
    best = flat.argmin(axis=1)
    return _Closest(flat.min(axis=1), np.stack(np.unravel_index(best, square.shape), axis=-1))


def _stated(valving: Valving, speeds: Array, up: Array, down: Array) -> NearestValving:
    damper = valving.damper()
    velocity = np.concatenate([-speeds[::-1], speeds])
    wanted = np.concatenate([-down[::-1], up])
    static = np.array([damper.static_force(v) for v in velocity.tolist()]) + damper.seals.drag * np.sign(velocity)
    level = float(np.mean(wanted - static))
    residual = float(np.sqrt(np.mean((static + level - wanted) ** 2)))
    ends: dict[str, tuple[object, object]] = {"jet": (JETS[0], JETS[-1]), "dish": (None, DISHES[-1])}
    ends |= dict.fromkeys(("compression", "rebound", "head"), (_CODES[0], _CODES[-1]))
    limits = tuple(name for name, pair in ends.items() if getattr(valving, name) in pair)
    count = len(DISHES) * len(JETS) * len(_CODES) ** 3 * (LAST_CLICK + 1)
    relative = residual / float(np.sqrt(np.mean(wanted**2)))
    return NearestValving(valving, level, residual, relative, velocity, static + level, count, limits)


def _compression_forces(base: Valving, speeds: Array) -> Array:
    """Return the force [N] with each compression stack and each head stack (19, 19, N) at speeds (N,) [m/s]."""
    damper = base.damper()
    rod, area = damper.cylinder.rod_area, damper.cylinder.rebound_area
    main = np.stack([_drops(passage, area * speeds) for passage in map(base.main_passage, _CODES)])
    head = np.stack([_drops(_head_passage(code), rod * speeds) for code in _CODES])
    pressure = damper.gas.charge + head
    behind = np.maximum(pressure - main[:, None], damper.fluid.vapour_pressure)
    return np.asarray(_rod_force(damper, pressure, behind) + damper.seals.drag, dtype=np.float64)


def _rebound_forces(base: Valving, speeds: Array) -> Array:
    """Return the force [N] with each rebound stack and each number of clicks (19, 29, N) at speeds (N,) [m/s]."""
    damper = base.damper()
    rod, area = damper.cylinder.rod_area, damper.cylinder.rebound_area
    main = np.stack([
        [_drops(base.main_passage(code, clicks), area * speeds) for clicks in range(LAST_CLICK + 1)] for code in _CODES
    ])  # fmt: skip
    drop = _drops(damper.head_valve.backward, rod * speeds)
    pressure = np.maximum(damper.gas.charge - drop, damper.fluid.vapour_pressure)
    return np.asarray(damper.seals.drag - _rod_force(damper, pressure, pressure + main), dtype=np.float64)


def _rod_force(damper: PhysicalDamper, compression: Array, rebound: Array) -> Array:
    """Return the force of the valves [N] at absolute chamber pressures [Pa], without gas force, as `static_force`."""
    cylinder = damper.cylinder
    force = compression * cylinder.compression_area - rebound * cylinder.rebound_area
    return np.asarray(force - damper.gas.charge * cylinder.rod_area)


def _drops(passage: Passage, flows: Array) -> Array:
    """Return the pressure drops (N,) [Pa] of a passage at flows (N,) [m3/s], from a table of its flow."""
    return np.asarray(np.interp(flows, passage.flow(_DROPS), _DROPS), dtype=np.float64)
