"""Laws of mechanics that relate the channels of a rig record, whatever the car, drive and setup.

Each law yields comparisons: figures that are zero in a sound record of a usual car. A figure is the logarithm of a
ratio or a time [s], computed from the coefficients c (..., P) of a regression.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.stats import norm, t

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.spectra import AXLES, DIRECTION, TWIST, Regression, Spectra, Spectrum

SIGNIFICANT = 4.0  # standard deviations above which a comparison is violated
SMALLEST = 0.01  # ratio that is distinguished from zero or a wrong sign
TIME = 1.5e-3  # tolerance of the delay between a potentiometer and accelerometers [s]
HIGH = 8.0  # upper end of the band [Hz] in which the engine and chassis bending follow the corners of the chassis

TIRE, TRAVEL, SLOPE = "the law of the tire", "the kinematics of the shock", "the slope of the displacement"
HUB, CAR = "the balance of forces at the hub", "Newton's law of the car"
BODY, ACTUATOR = "the motion of the chassis", "the response of the actuator"

# ---- Comparisons ----------------------------------------------------------------------------------------------------


class Kind(StrEnum):
    """Kind of a comparison and of the fault that it shows: a ratio (its logarithm), or a time [s]."""

    GAIN = "gain"
    DELAY = "delay"


class Comparison(NamedTuple):
    """A figure that should be zero."""

    law: str
    kind: Kind
    value: float  # figure minus its expectation
    tolerance: float  # absolute value that a sound record and a usual car may reach
    deviation: float  # standard deviation from the record's noise, with `few_blocks_factor`
    effect: Mapping[str, float]  # change of the figure per logarithm of the gain, or per delay, of each channel

    @property
    def scale(self) -> float:
        """Standard deviation to be expected, from usual cars and from noise."""
        return float(np.hypot(self.tolerance / SIGNIFICANT, self.deviation))

    @property
    def score(self) -> float:
        """Figure in standard deviations."""
        return self.value / self.scale

    @property
    def is_violated(self) -> bool:
        """Whether the figure contradicts the law."""
        return abs(self.score) > SIGNIFICANT

    def minus(self, other: Comparison, tolerance: float, law: str = "") -> Comparison:
        """Return the comparison of this figure with another one, by default of the right with the left corner."""
        effect = {**self.effect, **{name: -size for name, size in other.effect.items()}}
        deviation = float(np.hypot(self.deviation, other.deviation))
        law = law or f"the symmetry of left and right in {self.law}"
        return Comparison(law, self.kind, self.value - other.value, tolerance, deviation, effect)


@cache
def few_blocks_factor(blocks: int) -> float:
    """Return the factor by which a deviation from a few blocks must be larger to be exceeded as rarely as a known one.

    A figure over its jackknife deviation from B blocks has Student's distribution with B - 1 degrees of freedom:
    chance exceeds four standard deviations of 8 blocks 80 times as often as four known ones.
    """
    return float(t.isf(norm.sf(SIGNIFICANT), blocks - 1)) / SIGNIFICANT


def _figure(fit: Regression, of: Callable[[Array], Array]) -> tuple[float, float]:
    value, deviation = fit.figure(of)
    return value, few_blocks_factor(len(fit.samples)) * deviation


def _ratio(
    law: str, fit: Regression, effect: Mapping[str, float], tolerance: float,
    of: Callable[[Array], Array], expected: float = 1.0,
) -> Comparison:  # fmt: skip
    value, deviation = _figure(fit, lambda c: of(c) / expected)
    size = max(value, SMALLEST)
    gain = float(np.log(size))
    # A ratio and its inverse are tested; the weaker test counts. They differ if the ratio is not well determined.
    slope = 1.0 / size if size <= 1.0 else gain / (size - 1.0)
    return Comparison(law, Kind.GAIN, gain, tolerance, slope * deviation, effect)


def _delay(
    law: str, fit: Regression, effect: Mapping[str, float], tolerance: float,
    of: Callable[[Array], Array], over: Sequence[int] = (), expected: float = 0.0,
) -> Comparison:  # fmt: skip
    """Return the comparison of a time; its deviation is infinite if a column by which `of` divides is insignificant."""
    value, deviation = _figure(fit, lambda c: of(c) - expected)
    known = all(abs(fit.values[k]) > SIGNIFICANT * _figure(fit, lambda c, k=k: c[:, k])[1] for k in over)  # type: ignore[misc]
    return Comparison(law, Kind.DELAY, value, tolerance, deviation if known else np.inf, effect)


def comparisons(spectra: Spectra, corners: Sequence[str], mass: float | None = None) -> Iterator[Comparison]:
    """Yield the comparisons of all laws whose channels are known.

    Args:
        spectra: Spectra of a record.
        corners: Names of its corners; one empty name for a quarter car.
        mass: Mass of the car [kg], None if it is unknown.
    """
    yield from _tires(spectra, corners)
    yield from _travels(spectra, corners)
    yield from _slopes(spectra, corners)
    yield from _hubs(spectra, corners)
    yield from _whole_car(spectra, corners, mass)
    yield from _points_of_chassis(spectra, corners)
    yield from _actuators(spectra, corners)


def across(corner: str) -> str | None:
    """Return the other corner of the same axle; None for a quarter car."""
    return next((pair[1 - pair.index(corner)] for pair in AXLES if corner in pair), None)


def _at(corner: str, *quantities: str) -> list[str]:
    return [channel(corner, quantity) for quantity in quantities]


def _sides(found: Mapping[str, Comparison], tolerance: float) -> Iterator[Comparison]:
    """Yield the comparisons of left with right corners."""
    for left, right in AXLES:
        if {left, right} <= set(found):
            yield found[left].minus(found[right], tolerance)


# ---- One corner -----------------------------------------------------------------------------------------------------


def tire_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients (k, c, m, -k, -c) of T'' = k r'' + c r''' + m r'''' - k w'' - c w'''.

    T is the tire force, r the road, w'' the hub's acceleration, k the stiffness, c the damping, and m the mass of the
    wheelloader's pan above its load cell.
    """
    force, road, hub = _at(corner, "tire_force", "road", "hub_acceleration")
    return spectra.fit((force, 2), [(road, 2), (road, 3), (road, 4), (hub, 0), (hub, 1)])


def _tires(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    stiffness, times = {}, {}
    for corner in corners:
        if (fit := tire_fit(spectra, corner)) is None:
            continue
        force, road, hub = _at(corner, "tire_force", "road", "hub_acceleration")
        yield _ratio(TIRE, fit, {road: -1.0, hub: 1.0}, 0.08, lambda c: -c[:, 0] / c[:, 3])
        # Usual tires have 120 to 1000 N/mm, and 1.25 ms of damping over stiffness from hysteresis and damping together.
        stiffness[corner] = _ratio(TIRE, fit, {force: 1.0, hub: -1.0}, float(np.log(3.0)), lambda c: -c[:, 3], 350e3)
        yield _delay(
            TIRE, fit, {road: 1.0, hub: -1.0}, 1.5e-3, lambda c: c[:, 1] / c[:, 0] - c[:, 4] / c[:, 3], over=(0, 3)
        )
        times[corner] = _delay(
            TIRE, fit, {force: -1.0, hub: 1.0}, 2.5e-3, lambda c: c[:, 4] / c[:, 3], over=(3,), expected=1.25e-3
        )
    yield from (*stiffness.values(), *times.values(), *_sides(stiffness, 0.15), *_sides(times, 2e-3))


def travel_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of x'' = n (w'' + t w''') - n (z'' + t z''') + the same across the axle.

    x is the travel of the shock, w'' and z'' the accelerations of hub and chassis, n the motion ratio, and t a delay.
    The coefficients are (n, n t, -n, -n t), then those of the other side, to which a solid axle connects the shock.
    """
    pot, *names = _at(corner, "displacement", "hub_acceleration", "chassis_acceleration")
    if (other := across(corner)) is not None:
        far = _at(other, "hub_acceleration", "chassis_acceleration")
        names += far if spectra.has(far) else []
    return spectra.fit((pot, 2), [(name, order) for name in names for order in (0, 1)])


def _travels(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    ratios = {}
    for corner in corners:
        if (fit := travel_fit(spectra, corner)) is None:
            continue
        pot, hub, chassis = _at(corner, "displacement", "hub_acceleration", "chassis_acceleration")
        yield _ratio(TRAVEL, fit, {hub: -1.0, chassis: 1.0}, 0.08, lambda c: -c[:, 0] / c[:, 2])
        # Usual motion ratios (travel of the shock over that of the wheel) are 0.28 to 1.6.
        ratios[corner] = _ratio(TRAVEL, fit, {pot: 1.0, hub: -1.0}, float(np.log(2.4)), lambda c: c[:, 0], 0.67)
        for k, name in ((0, hub), (2, chassis)):
            yield _delay(TRAVEL, fit, {pot: -1.0, name: 1.0}, TIME, lambda c, k=k: c[:, k + 1] / c[:, k], over=(k,))  # type: ignore[misc]
    yield from (*ratios.values(), *_sides(ratios, 0.1))


def _slopes(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each velocity with the slope of the displacement: v = g (x' + t x'')."""
    for corner in corners:
        velocity, pot = _at(corner, "velocity", "displacement")
        if (fit := spectra.fit((velocity, 0), [(pot, 1), (pot, 2)])) is not None:
            yield _ratio(SLOPE, fit, {velocity: 1.0, pot: -1.0}, 0.06, lambda c: c[:, 0])
            yield _delay(SLOPE, fit, {velocity: -1.0, pot: 1.0}, 1.5e-3, lambda c: c[:, 1] / c[:, 0], over=(0,))


def _hub_fit(spectra: Spectra, corner: str) -> Regression | None:
    """Return the coefficients of the tire force.

        T = n (F + t F') + n_o (F_o + t F_o') + m w'' + m_o w_o'' + k x + k_o x_o + f sign(v) + f_b sign(v_l - v_r)

    T is the tire force, F the shock force, w'' the hub's acceleration, x the travel and v the velocity of the shock;
    `o` is the other side of the axle. By virtual work, n is the motion ratio. f is friction along the shock, f_b
    that in the anti-roll bar; without f_b, a soft shock's n would be up to 0.3 too large.
    """
    tire, force, *rest = _at(corner, "tire_force", "force", "hub_acceleration", "displacement", DIRECTION)
    inputs = [(force, 0), (force, 1), *((name, 0) for name in rest)]
    if (other := across(corner)) is not None:
        force, *rest = _at(other, "force", "hub_acceleration", "displacement")
        rest += [channel(axle[0], TWIST) for axle in AXLES if corner in axle]
        inputs += [term for term in [(force, 0), (force, 1), *((name, 0) for name in rest)] if term[0] in spectra]
    return spectra.fit((tire, 0), inputs)


def _hubs(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of each shock's force with the tire force, and of motion ratios from forces and motions.

    Friction elsewhere than along the shock adds up to 0.11 of a motion ratio; friction that sticks looks like a lead
    of a shock force of up to 1 ms.
    """
    works = {}
    for corner in corners:
        if (balance := _hub_fit(spectra, corner)) is None:
            continue
        force, tire, pot, hub = _at(corner, "force", "tire_force", "displacement", "hub_acceleration")
        if (travel := travel_fit(spectra, corner)) is not None:
            effect = {force: -1.0, tire: 1.0, pot: -1.0, hub: 1.0}
            one, two = (_ratio(HUB, fit, effect, 0.2, lambda c: c[:, 0]) for fit in (balance, travel))
            works[corner] = one.minus(two, 0.2, HUB)._replace(effect=effect)
        yield _delay(
            HUB, balance, {force: 1.0, tire: -1.0}, 2.5e-3, lambda c: c[:, 1] / c[:, 0], over=(0,), expected=-0.5e-3
        )
    yield from (*works.values(), *_sides(works, 0.1))


# ---- The whole car --------------------------------------------------------------------------------------------------


def _whole_car(spectra: Spectra, corners: Sequence[str], mass: float | None) -> Iterator[Comparison]:
    """Yield the comparisons of forces with each other and with accelerations.

        sum T + sum_axles d (T_l - T_r) = sum_j a_j (A_j + t_j A_j') + sum_axles m(s) (z_l'' + z_r'') + ...

    T are the tire forces, A_j the aeroloader forces, d is 0 and a_j is 1. The masses are unknown. The inertia of the
    chassis at an axle is m + c s + e s^2, because the engine on its mounts and a chassis that bends do not follow the
    corners exactly.
    """
    tires, hubs, bodies = (_of_all(corners, n) for n in ("tire_force", "hub_acceleration", "chassis_acceleration"))
    down = [*_of_all(corners, "aero"), "aero_force"]
    unknown = any(n in spectra.left_out or (f"{n}_command" in spectra and n not in spectra)
                  for n in (*down, "heave_force"))  # fmt: skip
    if not spectra.has((*tires, *hubs, *bodies)) or unknown:
        return
    loads = {n: 1.0 for n in down if n in spectra} | ({"heave_force": -1.0} if "heave_force" in spectra else {})
    axles = AXLES if len(corners) > 1 else ()
    d = spectra.derivative

    def sum_of(places: Sequence[str], quantity: str, order: int = 0) -> Spectrum:
        return np.asarray(np.sum([d(name, order) for name in _of_all(places, quantity)], axis=0))

    rows = []
    for left, right in axles:
        one, other = channel(left, "tire_force"), channel(right, "tire_force")
        rows += [d(one, order) - d(other, order) for order in (0, 1)]
    rows += [d(load, order) for load in loads for order in (0, 1)]
    first = len(rows)
    for place in axles or (tuple(corners),):
        rows += [sum_of(place, "hub_acceleration"), *(sum_of(place, "chassis_acceleration", k) for k in range(3))]
    total = sum((d(name) for name in tires), start=np.zeros_like(d(tires[0])))
    if (fit := spectra.regress(total, rows, HIGH)) is None:
        return
    for k, (left, right) in enumerate(axles):
        # The total is sum T = -d (T_l - T_r) + ..., so the left force counts 1 + d and the right one 1 - d.
        effect = {channel(left, "tire_force"): 1.0, channel(right, "tire_force"): -1.0}
        yield _ratio(CAR, fit, effect, 0.08,
                     lambda c, k=2 * k: (1.0 + c[:, k]) / np.maximum(1.0 - c[:, k], 1e-3))  # type: ignore[misc]  # fmt: skip
        yield _delay(CAR, fit, effect, 1.5e-3, lambda c, k=2 * k + 1: -2.0 * c[:, k])  # type: ignore[misc]
    share = {name: 1.0 / len(tires) for name in tires}
    for k, (load, sign) in enumerate(loads.items(), start=len(axles)):
        yield _ratio(CAR, fit, {load: -1.0, **share}, 0.1, lambda c, k=2 * k, s=sign: s * c[:, k])  # type: ignore[misc]
        yield _delay(CAR, fit, {load: 1.0, **_negative(share)}, 2e-3,
                     lambda c, k=2 * k: c[:, k + 1] / c[:, k], over=(2 * k,))  # type: ignore[misc]  # fmt: skip
    masses = [k for start in range(first, len(rows), 4) for k in (start, start + 1)]
    sides, felt = 2.0 if len(tires) > 1 else 1.0, [*hubs, *bodies]
    # Usual cars have 300 to 3600 kg.
    law = f"{CAR} of {mass:.4g} kg" if mass else "the usual mass of a car"
    yield _ratio(law, fit, share | {n: -1.0 / len(felt) for n in felt}, 0.1 if mass else float(np.log(3.5)),
                 lambda c: sides * c[:, masses].sum(axis=1), mass or 1040.0)  # fmt: skip


def _of_all(corners: Sequence[str], quantity: str) -> list[str]:
    return [channel(corner, quantity) for corner in corners]


def _negative(effect: Mapping[str, float]) -> dict[str, float]:
    return {name: -size for name, size in effect.items()}


def _points_of_chassis(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of points on the chassis with its corners.

        y = sum_i a_i z_i'' - sum_i b_i r_i'' - t y'

    y is the acceleration of the point, or of its height above the roads r_i. If the whole chassis moves up by 1, so
    does the point: sum a_i = 1, and for a height above the road sum b_i = 1. t is the delay of y.
    """
    bodies, roads = _of_all(corners, "chassis_acceleration"), _of_all(corners, "road")
    heights = ["ride_height", "front.ride_height", "rear.ride_height"]
    points = dict.fromkeys([*_of_all(corners, "aero_position"), "aero.heave", *heights], 2)
    points |= {"cg.vertical_acceleration": 0, "driver.acceleration": 0}
    less = {body: -1.0 / len(bodies) for body in bodies}
    for name, order in points.items():
        inputs = [(body, 0) for body in bodies] + [(road, 2) for road in roads if name in heights]
        fit = spectra.fit((name, order), [*inputs, (name, order + 1)], HIGH)
        if fit is not None:
            yield _ratio(BODY, fit, {name: 1.0, **less}, 0.12, lambda c: c[:, : len(bodies)].sum(axis=1))
            yield _delay(BODY, fit, {name: 1.0, **less}, 2e-3, lambda c: -c[:, -1])


def _actuators(spectra: Spectra, corners: Sequence[str]) -> Iterator[Comparison]:
    """Yield the comparisons of actuators with their commands: y = g (u + a u' + b u''); a is minus the delay.

    Every actuator has a lag of its own, but actuators of one kind have the same: with three or more, the delay of each
    is compared with the median of the others.
    """
    for quantity in ("road", "aero"):
        delays = []
        for name in _of_all(corners, quantity):
            fit = spectra.fit((name, 0), [(f"{name}_command", order) for order in range(3)], HIGH)
            if fit is not None:
                effect = {name: 1.0, f"{name}_command": -1.0}
                yield _ratio(ACTUATOR, fit, effect, 0.15, lambda c: c[:, 0])
                delays.append(_delay(ACTUATOR, fit, effect, 2e-3, lambda c: -c[:, 1] / c[:, 0], over=(0,)))
        for one in delays if len(delays) > 2 else ():
            middle = float(np.median([other.value for other in delays if other is not one]))
            yield one._replace(value=one.value - middle)
