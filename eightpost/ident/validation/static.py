"""Validation on static tests: force over displacement in both directions, gas rate, seal drag (3.4.3, Fig 3.22/23)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import MissingChannelError, ParameterError
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.validation.dyno_record import DynoRecord, block_means, standing, stretches
from eightpost.ident.validation.evaluation import as_measured, reference_of
from eightpost.shock import Shock
from eightpost.signals import TimeSeries

Direction = Literal["start", "compression", "rebound"]

#: Excluded from a hold: the first 5 s and the last second (3.4.3); of a hold under 12 s its first half and last 5 %.
SETTLING, ENDING, _SHORT = 5.0, 1.0, 12.0

#: Minimum length of a hold [s].
_SHORTEST = 1.0

#: Rate to which the record is averaged [Hz]; changes within a hold take seconds.
_RATE = 100.0


@dataclass(frozen=True, slots=True)
class Hold:
    """A displacement that was held."""

    start: float  #: Start of the averaged time [s].
    stop: float  #: End of the averaged time [s].
    displacement: float  #: Mean displacement [m], with the record's zero.
    force: float  #: Mean of the measured force [N].
    predicted: float  #: Mean of the law's force [N].
    direction: Direction  #: Direction of the move that led to it; `start` for the first hold.


@dataclass(frozen=True, slots=True, eq=False)
class StaticValidation:
    """Error of a shock on a static record."""

    holds: tuple[Hold, ...]  #: Holds in the order of time.
    series: TimeSeries  #: Record averaged to at most 100 Hz: displacement [m], force [N] and predicted_force [N].
    #: Slope (least squares) over the holds reached in compression [N/m]; None for fewer than two.
    compression_rate: float | None
    rebound_rate: float | None  #: Slope over the holds reached in rebound [N/m]; None for fewer than two.
    gas_rate: float  #: Slope after half the hysteresis is removed from each direction [N/m].
    #: Mean difference of the forces of the two directions at the same displacement [N]; None if their displacements do
    #: not overlap.
    hysteresis: float | None
    predicted_rate: float  #: Slope of the law's forces over all holds [N/m].
    settling: float  #: Time excluded at the beginning of the holds [s]: 5, or less if a hold is short.

    @property
    def seal_drag(self) -> float | None:
        """Half the hysteresis between the directions [N] (3.4.3)."""
        return None if self.hysteresis is None else 0.5 * self.hysteresis

    @property
    def rms(self) -> float:
        """The RMS of measured minus predicted force over the holds, including their drag [N]."""
        return float(np.sqrt(np.mean([(hold.force - hold.predicted) ** 2 for hold in self.holds])))

    @property
    def percent(self) -> None:
        """None: a static record has no standard deviation that could scale the error."""
        return

    @property
    def beyond(self) -> float:
        """0: a shock at rest is within every fitted range of velocities."""
        return 0.0


def validate_static(
    shock: Shock, record: DynoRecord, *, segment: tuple[float, float] | None = None
) -> StaticValidation:
    """Return rates, drag and the error of a law on a static record.

    Args:
        shock: Fitted shock. Its gas force is compared; its drag is a function of velocity and so zero at rest.
        record: Steps of displacement with a hold after each.
        segment: Start and end [s], from the record's start, of the part whose holds count; default all.

    Raises:
        MissingChannelError: The record has no displacement.
        ParameterError: Fewer than two displacements are held for a second or more.
    """
    if "displacement" not in record.test.series:
        raise MissingChannelError(
            "a static test needs displacement; without it only the other kinds can be validated",
            path=record.test.source,
            channel="displacement",
        )
    series = _predicted(shock, record)
    if segment:
        began = float(record.test.series.time[0])
        series = series.window(began + segment[0], began + segment[1])
    holds, settling = _holds(series)
    if len({round(hold.displacement, 4) for hold in holds}) < 2:
        where = f" from {segment[0]:g} to {segment[1]:g} s" if segment else ""
        remedy = "give another --segment" if segment else "for another test give its --kind"
        raise ParameterError(
            f"{record.name}: {len(holds)} holds of a second or more at fewer than two displacements{where}; a static "
            f"test has steps with a hold after each (Fig 3.12); {remedy}"
        )
    hysteresis = _hysteresis(holds)
    return StaticValidation(
        holds=holds,
        series=series,
        compression_rate=_rate_of(_towards(holds, "compression")),
        rebound_rate=_rate_of(_towards(holds, "rebound")),
        gas_rate=_gas_rate(holds, hysteresis or 0.0),
        hysteresis=hysteresis,
        predicted_rate=_slope(holds, [hold.predicted for hold in holds]),
        settling=settling,
    )


def _predicted(shock: Shock, record: DynoRecord) -> TimeSeries:
    """Return the averaged record with the law's force."""
    even = record.test.series
    even = even if even.is_uniform else even.resample(even.sample_rate)
    names = ("displacement", "velocity", "force")
    series = block_means(even.select(names), int(even.sample_rate // _RATE))
    reference = reference_of(shock, float(series["displacement"].mean()))
    about = series.with_channel("displacement", "m", series["displacement"] - reference)
    return series.with_channel("predicted_force", "N", simulate(as_measured(shock), about))


def _holds(series: TimeSeries) -> tuple[tuple[Hold, ...], float]:
    """Return the holds, and the time excluded at their beginning [s]."""
    spans = [
        (float(series.time[first]), float(series.time[last]))
        for first, last in stretches(standing(series))
        if series.time[last] - series.time[first] >= _SHORTEST
    ]
    settling = min([SETTLING, *(0.5 * (stop - start) for start, stop in spans if stop - start < _SHORT)])
    means: list[Hold] = []
    for start, stop in spans:
        length = stop - start
        ending = ENDING if length >= _SHORT else 0.05 * length
        first = start + (SETTLING if length >= _SHORT else 0.5 * length)
        part = series.window(first, stop - ending)
        moved = float(part["displacement"].mean())
        force, predicted = float(part["force"].mean()), float(part["predicted_force"].mean())
        way = _direction(means[-1].displacement, moved) if means else "start"
        means.append(Hold(first, stop - ending, moved, force, predicted, way))
    return tuple(means), settling


def _direction(before: float, after: float) -> Direction:
    return "compression" if after > before else "rebound"


def _towards(holds: Iterable[Hold], direction: Direction) -> list[Hold]:
    return sorted((hold for hold in holds if hold.direction == direction), key=lambda hold: hold.displacement)


def _slope(holds: Iterable[Hold], forces: list[float]) -> float:
    """Return the slope, by least squares, of forces [N] over the holds' displacements [N/m]."""
    return float(np.polyfit([hold.displacement for hold in holds], forces, 1)[0])


def _rate_of(holds: list[Hold]) -> float | None:
    if len({hold.displacement for hold in holds}) < 2:
        return None
    return _slope(holds, [hold.force for hold in holds])


def _gas_rate(holds: tuple[Hold, ...], hysteresis: float) -> float:
    """Return the slope of the forces [N/m] after half the hysteresis is removed; the first hold has no direction."""
    sign = {"compression": -0.5, "rebound": 0.5}
    used = [hold for hold in holds if hold.direction in sign]
    if len({hold.displacement for hold in used}) < 2:
        return _slope(holds, [hold.force for hold in holds])
    return _slope(used, [hold.force + sign[hold.direction] * hysteresis for hold in used])


def _hysteresis(holds: tuple[Hold, ...]) -> float | None:
    """Return the mean difference [N] between the directions' curves at the displacements that both reach."""
    up, down = _towards(holds, "compression"), _towards(holds, "rebound")
    if not (up and down):
        return None
    low, high = (end(side[k].displacement for side in (up, down)) for end, k in ((max, 0), (min, -1)))
    # Positions are repeated only to within the actuator's error.
    tolerance = 0.01 * (max(h.displacement for h in holds) - min(h.displacement for h in holds))
    if low > high + tolerance:
        return None
    held = [hold.displacement for hold in (*up, *down) if low - tolerance <= hold.displacement <= high + tolerance]
    return float(np.mean(_curve(up, held) - _curve(down, held)))


def _curve(holds: list[Hold], displacement: list[float]) -> Array:
    """Return the forces [N] of one direction at displacements (N,) [m], linear between its holds."""
    known = [hold.displacement for hold in holds]
    return np.asarray(np.interp(displacement, known, [hold.force for hold in holds]))
