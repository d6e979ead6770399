"""Families of measures by name, for the channels that a vehicle and its shocks have."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from cosim.study.measures import Measure, ride_measures
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.units import convert

#: Limit between low and high shock speed, as commonly used by teams [m/s].
LOW_SPEED = convert(2.0, "in/s", "m/s")

#: Bands of tire load [Hz]: chassis motion and wheel hop (Tables 4.2 and 5.2 have modes in both).
BANDS = (("chassis", (0.5, 8.0)), ("wheel hop", (8.0, 30.0)))

#: Octaves of the tire load spectra [Hz], from below the chassis modes to above the wheel modes.
OCTAVES = tuple((0.5 * 2.0**k, 2.0**k) for k in range(6))

#: Signs of lf, rf, lr, rr in each mode of the four tire loads.
MODES: Mapping[str, tuple[float, float, float, float]] = {
    "heave": (1.0, 1.0, 1.0, 1.0),
    "pitch": (-1.0, -1.0, 1.0, 1.0),
    "roll": (1.0, -1.0, 1.0, -1.0),
    "warp": (1.0, -1.0, -1.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class Car:
    """Names and channels of a car for which measures are defined."""

    name: str  #: Name of the vehicle's component.
    corners: Sequence[str]  #: Names of the shocks' components.
    channels: Collection[str]  #: All channels that can be recorded, as `component.variable`.

    def port(self, corner: str, variable: str) -> str:
        """Return the channel of a variable at a corner; those of a quarter car have no corner in the name."""
        own = f"{self.name}.{corner}.{variable}"
        return own if own in self.channels else f"{self.name}.{variable}"


def family(name: str, car: Car) -> tuple[Measure, ...]:
    """Return those measures of a family whose channels exist.

    Raises:
        InputError: There is no such family, or the vehicle has none of its channels.
    """
    if name not in FAMILIES:
        raise InputError(f"there is no family of measures {name!r}; there are {', '.join(FAMILIES)}")
    if found := _measures(name, car):
        return found
    others = ", ".join(other for other in FAMILIES if _measures(other, car)) or "none"
    raise InputError(f"family {name!r}: {car.name} has none of its channels; families with channels of {car.name}: "
                     f"{others} (docs/how_to/study.md)")  # fmt: skip


def _measures(name: str, car: Car) -> tuple[Measure, ...]:
    return tuple(m for m in FAMILIES[name](car) if set(m.channels) <= set(car.channels))


def _ride(car: Car) -> Iterator[Measure]:
    """Yield the measures of chapter 7."""
    yield from ride_measures(car.name, car.corners)


def _numbers(car: Car) -> Iterator[Measure]:
    """Yield grip number and aero number (2.5); lower is better."""
    tires = tuple(car.port(corner, "tire_force") for corner in car.corners)
    heights = tuple(f"{car.name}.{axle}.ride_height" for axle in ("front", "rear"))
    yield Measure("grip number", tires, "rms", "lbf")
    yield Measure("aero number", heights, "joint_rms", "in")


def _tires(car: Car) -> Iterator[Measure]:
    tires = tuple(car.port(corner, "tire_force") for corner in car.corners)
    for corner, tire in zip(car.corners, tires, strict=True):
        yield Measure(f"{corner} tire force variation", (tire,), "variation", "1")
        yield Measure(f"{corner} tire force, RMS", (tire,), "rms", "lbf")
        yield Measure(f"{corner} tire force, 1st percentile", (tire,), "percentile", "lbf", options={"percent": 1.0})
    yield Measure("total tire force variation", tires, "variation", "1")


def _accelerations(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        for place in ("hub", "chassis"):
            channel = car.port(corner, f"{place}_acceleration")
            yield Measure(f"{corner} {place} acceleration, RMS", (channel,), "rms", "g")
    yield Measure("driver acceleration, RMS", (f"{car.name}.driver.acceleration",), "rms", "g")


def _travel(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        channel = (car.port(corner, "displacement"),)
        yield Measure(f"{corner} suspension travel, RMS", channel, "rms", "in")
        yield Measure(f"{corner} suspension travel, range", channel, "range", "in")


def _energy(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        channels = (f"{corner}.force", car.port(corner, "velocity"))
        yield Measure(f"{corner} energy into the shock", channels, "work", "J")


def _velocities(car: Car) -> Iterator[Measure]:
    """Yield the shares of time in four ranges of shock velocity."""
    inf = float("inf")
    bins = {
        "high-speed rebound": (-inf, -LOW_SPEED),
        "low-speed rebound": (-LOW_SPEED, 0.0),
        "low-speed bump": (0.0, LOW_SPEED),
        "high-speed bump": (LOW_SPEED, inf),
    }
    for corner in car.corners:
        channel = (car.port(corner, "velocity"),)
        for label, (low, high) in bins.items():
            yield Measure(f"{corner} time in {label}", channel, "share", "1", options={"from": low, "to": high})


def _tire_modes(car: Car) -> Iterator[Measure]:
    """Yield heave, pitch, roll and warp of the four tire loads, each in two bands."""
    for mode in MODES:
        for label, band in BANDS:
            yield _tire_mode(car, mode, f"{label} ({band[0]:g} to {band[1]:g} Hz)", band)


def _tire_spectra(car: Car) -> Iterator[Measure]:
    """Yield octave spectra of heave, pitch, roll and warp."""
    for mode in MODES:
        for band in OCTAVES:
            yield _tire_mode(car, mode, f"{band[0]:g} to {band[1]:g} Hz", band)


def _tire_mode(car: Car, mode: str, label: str, band: tuple[float, float]) -> Measure:
    tires = tuple(f"{car.name}.{corner}.tire_force" for corner in CORNERS)
    return Measure(f"tire load {mode}, {label}, RMS", tires, "rms", "lbf", weights=MODES[mode], band=band)


#: Functions that yield the measures of a family, by the family's name in study files.
FAMILIES: Mapping[str, Callable[[Car], Iterator[Measure]]] = {
    "ride": _ride,
    "numbers": _numbers,
    "tires": _tires,
    "accelerations": _accelerations,
    "travel": _travel,
    "energy": _energy,
    "velocities": _velocities,
    "tire_modes": _tire_modes,
    "tire_spectra": _tire_spectra,
}
