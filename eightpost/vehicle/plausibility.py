"""Plausibility of a vehicle's parameters: figures that every car has in a known range, whatever its class."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from math import inf, pi, sqrt
from typing import Any, NamedTuple

from eightpost.corners import CORNERS
from eightpost.units import convert
from eightpost.vehicle.quantities import Corners
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof

Parameters = QuarterCar | SevenDof


class Usual(NamedTuple):
    """Usual range of a figure, in its unit."""

    low: float
    high: float
    unit: str
    gross: float = 1.5  #: Factor beyond the range from which a figure is that of no car.


#: Usual ranges, from karts (Lot and Dal Bianco 2016: tires of 61 to 65 N/mm, wheelbase 1.045 m) to sedans and
#: high-downforce cars. Ride frequencies of the springs alone are 0.5 to 1.5 Hz in passenger cars, 1.5 to 2 Hz in sedan
#: race cars and 3 to 5 Hz and more with high downforce (Giaraffa, OptimumG, Springs and Dampers, part 1); here the tire
#: is in series. The other ranges are our own, with a margin about the cars of tests/vehicle/test_plausibility.py.
USUAL = {
    "ride frequency": Usual(0.5, 8.0, "Hz"),
    "wheel-hop frequency": Usual(6.0, 32.0, "Hz"),
    "damping ratio": Usual(0.03, 2.0, "1", inf),  # for modes only: coupled cars have the damping of their shocks
    "spring over tire stiffness": Usual(0.03, 2.5, "1"),
    "tire stiffness": Usual(50.0, 600.0, "N/mm"),
    "sprung mass": Usual(20.0, 700.0, "kg"),
    "unsprung mass": Usual(2.5, 90.0, "kg"),
    "wheelbase": Usual(0.9, 4.2, "m"),
    "wheelbase over track": Usual(0.8, 2.6, "1"),
    "front share of the sprung mass": Usual(30.0, 70.0, "%"),
    "radius of gyration in roll over track": Usual(0.2, 0.6, "1"),
    "radius of gyration in pitch over wheelbase": Usual(0.2, 0.6, "1"),
}


class Mistake(NamedTuple):
    """Numbers in one unit that were written with another."""

    parameters: tuple[str, ...]  #: Names of the parameters.
    meant: str  #: Unit of the numbers.
    typed: str  #: Unit that was written.

    @property
    def factor(self) -> float:
        """Factor that corrects the parameters."""
        return float(convert(1.0, self.meant, self.typed))


_SPRINGS, _TIRES = ("spring_rate", "suspension_stiffness"), ("tire_stiffness",)
_PAIRS = (
    *((names, "lbf/in", "N/mm") for names in (_TIRES, _SPRINGS, _SPRINGS + _TIRES)),
    (("sprung_mass", "unsprung_mass"), "lbm", "kg"),
    (("track_width", "cg_to_front_axle", "cg_to_rear_axle"), "in", "cm"),
    (("damping",), "lbf.s/in", "N.s/m"),
    (("damping",), "lbf.s/in", "N.s/mm"),
    (("roll_inertia", "pitch_inertia"), "lbm.in2", "kg.m2"),
)
#: Mistakes to try, each in both directions; of those that explain equally many figures, the first is named.
MISTAKES = tuple(chain.from_iterable((Mistake(n, a, b), Mistake(n, b, a)) for n, a, b in _PAIRS))


@dataclass(frozen=True, slots=True)
class Doubt:
    """Figures outside their usual range that have one cause."""

    summary: str  #: The figures with their usual ranges.
    remedy: str  #: What to do.
    is_gross: bool  #: Whether a figure is that of no car.


class _Figure(NamedTuple):
    """A figure outside its usual range."""

    name: str
    place: str  #: Corner, or empty.
    value: float  #: Value in the unit of its range.

    @property
    def excess(self) -> float:
        """Factor beyond the usual range."""
        low, high, *_ = USUAL[self.name]
        return max(low / self.value, self.value / high)

    def __str__(self) -> str:
        low, high, unit, _ = USUAL[self.name]
        shown = "" if unit == "1" else f" {unit}"
        return f"{self.place} {self.name} {_number(self.value)}{shown} (usual: {low:g} to {high:g}{shown})".lstrip()


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 999.5 else f"{value:.0f}"


def doubts(parameters: Parameters) -> tuple[Doubt, ...]:
    """Return what is implausible in a vehicle's parameters; of each figure, the corner farthest from its range.

    Figures that one mistake of units explains are one doubt, whose remedy names the mistake.
    """
    found = _outside(parameters)
    possible = [mistake for mistake in MISTAKES if not _is_of_one_side(parameters, mistake)]
    tried = {mistake: {f.name for f in _outside(_corrected(parameters, mistake))} for mistake in possible}
    sound = [mistake for mistake, left in tried.items() if left < {f.name for f in found}]
    cause = min(sound, key=lambda mistake: len(tried[mistake]), default=None)
    explained = [f for f in found if cause and f.name not in tried[cause]]
    result = [_doubt(explained, _remedy(parameters, cause))] if cause else []
    alone = "check the value and its unit: rates are wheel rates (docs/reference/vehicle_file.md)"
    return (*result, *(_doubt([f], alone) for f in found if f not in explained))


def _doubt(figures: list[_Figure], remedy: str) -> Doubt:
    return Doubt(", ".join(map(str, figures)), remedy, any(f.excess > USUAL[f.name].gross for f in figures))


def _remedy(parameters: Parameters, cause: Mistake) -> str:
    names = [name for name in cause.parameters if hasattr(parameters, name)]
    value = getattr(parameters, names[0])
    number = convert(value[0] if isinstance(value, Corners) else value, _si(parameters, names[0]), cause.typed)
    right = convert(number, cause.meant, cause.typed)
    return (
        f"correct the unit of {' and '.join(names)}, which look{'s' * (len(names) == 1)} like {cause.meant} typed as "
        f"{cause.typed}: {_number(number)} {cause.meant} = {_number(right)} {cause.typed}"
    )


def _si(parameters: Parameters, name: str) -> str:
    return str(type(parameters).__dataclass_fields__[name].metadata["unit"])


def _is_of_one_side(parameters: Parameters, mistake: Mistake) -> bool:
    """Return whether left and right differ by more than a factor of 2: a unit is that of both sides."""
    values = [getattr(parameters, name, None) for name in mistake.parameters]
    pairs = [pair for v in values if isinstance(v, Corners) for pair in ((v.lf, v.rf), (v.lr, v.rr))]
    return any(max(pair) > 2.0 * min(pair) for pair in pairs)


def _corrected(parameters: Parameters, mistake: Mistake) -> Parameters:
    changed: dict[str, Any] = {}
    for name in mistake.parameters:
        value = getattr(parameters, name, None)
        if value is not None:
            scaled = [mistake.factor * number for number in (value if isinstance(value, Corners) else (value,))]
            changed[name] = Corners(*scaled) if isinstance(value, Corners) else scaled[0]
    return replace(parameters, **changed)


def _outside(parameters: Parameters) -> list[_Figure]:
    """Return the figures outside their usual ranges, in the order of the ranges."""
    worst: dict[str, _Figure] = {}
    for figure in _figures(parameters):
        if figure.excess > (worst[figure.name].excess if figure.name in worst else 1.0):
            worst[figure.name] = figure
    return [worst[name] for name in USUAL if name in worst]


def _figures(parameters: Parameters) -> Iterator[_Figure]:
    """Yield all figures of a vehicle; damping of 0 is not stated, and a spring of 0 has no frequency."""
    for place, sprung, unsprung, spring, tire, damping in _corners(parameters):
        yield _Figure("sprung mass", place, sprung)
        yield _Figure("unsprung mass", place, unsprung)
        yield _Figure("tire stiffness", place, convert(tire, "N/m", "N/mm"))
        yield _Figure("wheel-hop frequency", place, sqrt((spring + tire) / unsprung) / (2.0 * pi))
        if spring:
            yield _Figure("ride frequency", place, sqrt(spring * tire / (spring + tire) / sprung) / (2.0 * pi))
            yield _Figure("spring over tire stiffness", place, spring / tire)
        if spring and damping:
            yield _Figure("damping ratio", place, damping / (2.0 * sqrt(spring * sprung)))
    if isinstance(parameters, SevenDof):
        base, mass = parameters.wheelbase, parameters.sprung_mass
        yield _Figure("wheelbase", "", base)
        yield _Figure("wheelbase over track", "", base / parameters.track_width)
        yield _Figure("front share of the sprung mass", "", 100.0 * parameters.cg_to_rear_axle / base)
        roll, pitch = (sqrt(inertia / mass) for inertia in (parameters.roll_inertia, parameters.pitch_inertia))
        yield _Figure("radius of gyration in roll over track", "", roll / parameters.track_width)
        yield _Figure("radius of gyration in pitch over wheelbase", "", pitch / base)


def _corners(parameters: Parameters) -> list[tuple[str, float, float, float, float, float]]:
    """Return place, sprung mass, unsprung mass, spring rate, tire stiffness and damping of each corner."""
    if isinstance(parameters, QuarterCar):
        own = parameters
        rates = (own.suspension_stiffness, own.tire_stiffness, own.damping)
        return [("", own.sprung_mass, own.unsprung_mass, *rates)]
    front = parameters.cg_to_rear_axle / parameters.wheelbase
    sprung = [0.5 * parameters.sprung_mass * share for share in Corners.axles(front, 1.0 - front)]
    own_rates = (parameters.unsprung_mass, parameters.spring_rate, parameters.tire_stiffness, parameters.damping)
    return list(zip(CORNERS, sprung, *own_rates, strict=True))
