"""Validation on special tests of shocks (3.4.2 to 3.4.4): sines, static tests and bumps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import MissingChannelError, ParameterError, TooShortError
from eightpost.ident.shock.runs import CUTOFF, FILTER_EDGE, LARGEST_SHARE
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.validation.records import (
    DynoRecord,
    Predicted,
    Validation,
    as_measured,
    block_means,
    evaluate,
    frequency_of,
    moving_part,
    reference_of,
    standing,
    stretches,
)
from eightpost.rig.motion import displacement_of
from eightpost.shock import Shock
from eightpost.signals import TimeSeries

# ---- Sines: the error by amplitude and velocity (Fig 3.20), and the loops (Fig 3.21) --------------------------------

#: Share of the peak speed up to which the hysteresis is evaluated; at the peak itself the two branches meet.
_BRANCH = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The last period of a sine test."""

    displacement: Array  #: Displacement (N,) about its mean [m].
    velocity: Array  #: Velocity (N,) [m/s].
    force: Array  #: Force (N,) [N].
    energy: float  #: Energy dissipated in a period, the area of the force-displacement loop [J].
    #: Largest difference of force at equal velocity between the two branches of the force-velocity loop, up to 90 % of
    #: the peak speed [N].
    hysteresis: float
    compression_peak: float  #: Maximum force [N].
    rebound_peak: float  #: Minimum force [N].


@dataclass(frozen=True, slots=True, eq=False)
class SineValidation(Predicted):
    """Error of a shock on a sine record."""

    prediction: Validation  #: Prediction over whole periods.
    frequency: float  #: Frequency of the sine [Hz].
    amplitude: float  #: Half the peak-to-peak displacement, low-passed [m].
    measured: Loop  #: Last period, measured.
    predicted: Loop  #: Last period, predicted by the law.

    @property
    def speed(self) -> float:
        """Peak speed of a sine of this amplitude and frequency [m/s]."""
        return 2.0 * np.pi * self.frequency * self.amplitude


def validate_sine(
    shock: Shock, record: DynoRecord, *, segment: tuple[float, float] | None = None, cutoff: float | None = None
) -> SineValidation:
    """Return a shock's error on a sine record over whole periods, without the first if there are three or more.

    Args:
        shock: Fitted shock.
        record: Record of a sine.
        segment: Start and end [s], from the record's start, of the part whose periods count; default all.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.

    Raises:
        ParameterError: The record has no single frequency.
        TooShortError: The record has no whole period.
    """
    frequency = record.frequency or frequency_of(record.test.series)
    if frequency is None:
        raise ParameterError(f"{record.name} has no single frequency and is no sine test; give another --kind for it")
    prediction = evaluate(shock, record.test, segment=_periods(record, frequency, segment, cutoff), cutoff=cutoff)
    displacement = displacement_of(prediction.measured)
    last = prediction.measured.time >= prediction.measured.time[-1] - 1.0 / frequency
    moved, velocity = displacement[last] - displacement[last].mean(), prediction.measured["velocity"][last]
    measured, predicted = prediction.measured["force"][last], prediction.predicted["force"][last]
    return SineValidation(
        prediction=prediction,
        frequency=frequency,
        amplitude=0.5 * float(np.ptp(displacement)),
        measured=loop_of(moved, velocity, measured),
        predicted=loop_of(moved, velocity, predicted),
    )


def loop_of(displacement: Array, velocity: Array, force: Array) -> Loop:
    """Return a loop from one period (N,) of displacement [m], velocity [m/s] and force [N]."""
    return Loop(
        displacement=displacement,
        velocity=velocity,
        force=force,
        energy=_area(displacement, force),
        hysteresis=_hysteresis(displacement, velocity, force),
        compression_peak=float(force.max()),
        rebound_peak=float(force.min()),
    )


def _area(displacement: Array, force: Array) -> float:
    """Return the area [J] within a closed loop by the trapezoidal rule."""
    means = 0.5 * (force + np.roll(force, -1))
    return float(means @ (np.roll(displacement, -1) - displacement))


def _hysteresis(displacement: Array, velocity: Array, force: Array) -> float:
    """Return the largest difference [N] between the branches below and above the middle of the stroke."""
    reach = _BRANCH * min(velocity.max(), -velocity.min())
    grid = np.linspace(-reach, reach, 181)
    below, above = (_branch(velocity[side], force[side], grid) for side in (displacement < 0.0, displacement >= 0.0))
    return float(np.abs(below - above).max())


def _branch(velocity: Array, force: Array, grid: Array) -> Array:
    """Return the force on a branch, along which the velocity is monotonic, at the velocities of a grid."""
    order = np.argsort(velocity)
    return np.asarray(np.interp(grid, velocity[order], force[order]))


def _periods(
    record: DynoRecord, frequency: float, segment: tuple[float, float] | None, cutoff: float | None
) -> tuple[float, float]:
    """Return start and stop [s] of the whole periods, from the record's start."""
    series = record.test.series
    part, period = moving_part(series), 1.0 / frequency
    start, stop = float(part.time[0] - series.time[0]), float(part.time[-1] - series.time[0])
    # The low-pass rings where the motion begins and ends, as it does at the ends of the record.
    edge = FILTER_EDGE / (cutoff or min(CUTOFF, LARGEST_SHARE * series.sample_rate))
    if stop - start >= period + 2.0 * edge:
        start, stop = start + edge, stop - edge
    start, stop = max(start, edge), min(stop, series.duration - edge)
    if segment:
        start, stop = max(start, segment[0]), min(stop, segment[1])
    if stop - start >= 3.0 * period:
        start += period
    count = int((stop - start) / period + 1e-6)
    if count < 1:
        where = f" between {segment[0]:g} and {segment[1]:g} s" if segment else ""
        what = f"it moves for {max(stop - start, 0.0):.3g} s{where}, less than one period of {frequency:.4g} Hz"
        raise TooShortError(what, path=record.test.source)
    return stop - count * period, stop


# ---- Static tests: force over displacement in both directions, gas rate, seal drag (Fig 3.22 and 3.23) --------------

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
    hysteresis = _static_hysteresis(holds)
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


def _static_hysteresis(holds: tuple[Hold, ...]) -> float | None:
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


# ---- Bumps: the error in time and over velocity, and its peak forces (Fig 3.24 and 3.25) ----------------------------

#: Share of the record's peak speed above which the shock counts as moving.
_MOVES = 0.05

#: Motions separated by less than this time are one event [s].
_APART = 0.15

#: Time before and after its motion that belongs to an event [s].
_BEFORE, _AFTER = 0.03, 0.1

#: Low-pass of a bump [Hz], at most 0.4 of the sampling rate. The 50 Hz of 3.3 would smooth the 17 ms of a bump so much
#: that the true law has an error of 5 % RMS and 1.4 % at the peaks (tests/validation).
BUMP_CUTOFF = 200.0

#: Minimum number of samples for the evaluation; with fewer around the events the whole record is used.
_ENOUGH = 200


@dataclass(frozen=True, slots=True)
class BumpEvent:
    """One motion of a bump test."""

    start: float  #: Start from the record's start [s].
    stop: float  #: End from the record's start [s].
    speed: float  #: Velocity of largest magnitude [m/s]; positive in compression.
    measured_peak: float  #: Measured force farthest from the force before the motion [N].
    predicted_peak: float  #: Predicted force farthest from the force before the motion [N].
    rms: float  #: RMS of the error within the event [N].

    @property
    def peak_error(self) -> float:
        """Predicted over measured peak minus one [percent]."""
        return 100.0 * (self.predicted_peak / self.measured_peak - 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class BumpValidation:
    """Error of a shock on a bump record."""

    prediction: Validation  #: Prediction from the first event to the last, including the times between them.
    events: tuple[BumpEvent, ...]  #: Events in the order of time.
    rms: float  #: RMS of the error over the events [N].
    deviation: float  #: Standard deviation of the measured force over the events [N].

    @property
    def percent(self) -> float:
        """The RMS error in percent of the standard deviation over the events."""
        return 100.0 * self.rms / self.deviation

    @property
    def beyond(self) -> float:
        """Share of the moving time outside the fitted velocities [1]."""
        moving = sum(event.stop - event.start for event in self.events)
        return min(1.0, self.prediction.beyond * self.prediction.measured.duration / moving)


def validate_bump(
    shock: Shock, record: DynoRecord, *, segment: tuple[float, float] | None = None, cutoff: float | None = None
) -> BumpValidation:
    """Return a shock's error on a bump record.

    Args:
        shock: Fitted shock.
        record: DynoRecord that stands still, moves fast and stands still again, once or several times.
        segment: Start and end [s], from the record's start, between which events count; default all.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 200, at most 0.4 of the sampling rate.

    Raises:
        ParameterError: Nothing moves, or the record never stands still.
    """
    first, last = segment or (0.0, record.test.series.duration)
    spans = [span for span in _spans(record.test.series) if first <= span[0] and span[1] <= last]
    if not spans:
        where = f" from {first:g} to {last:g} s" if segment else ""
        what = f"{record.name}: no motion between two rests was found{where}"
        raise ParameterError(f"{what}; give another --segment" if segment else f"{what}; give another --kind for it")
    segment = (spans[0][0], spans[-1][1])
    if (segment[1] - segment[0]) * record.test.series.sample_rate < _ENOUGH:
        segment = (0.0, record.test.series.duration)
    cutoff = cutoff or min(BUMP_CUTOFF, LARGEST_SHARE * record.test.series.sample_rate)
    prediction = evaluate(shock, record.test, segment=segment, cutoff=cutoff)
    inside = np.zeros(len(prediction.measured), dtype=bool)
    time = prediction.measured.time
    for start, stop in spans:
        inside |= (time >= start) & (time <= stop)
    return BumpValidation(
        prediction=prediction,
        events=tuple(_event(prediction, span) for span in spans),
        rms=float(np.sqrt(np.mean(prediction.error[inside] ** 2))),
        deviation=float(np.std(prediction.measured["force"][inside])),
    )


def _spans(series: TimeSeries) -> list[tuple[float, float]]:
    """Return start and stop [s], from the record's start, of each event."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    # Means over 2 ms keep noise from being taken for motion.
    smooth = block_means(even, int(0.002 * even.sample_rate))
    speed = np.abs(smooth["velocity"])
    time = smooth.time - even.time[0]
    spans: list[tuple[float, float]] = []
    for first, last in stretches(speed > _MOVES * speed.max()):
        start, stop = float(time[first]), float(time[last])
        if spans and start - spans[-1][1] < _APART:
            spans[-1] = (spans[-1][0], stop)
        else:
            spans.append((start, stop))
    return [(max(start - _BEFORE, 0.0), min(stop + _AFTER, even.duration)) for start, stop in spans]


def _event(prediction: Validation, span: tuple[float, float]) -> BumpEvent:
    measured = prediction.measured.window(*span)
    predicted = prediction.predicted.window(*span)["force"]
    velocity, force = measured["velocity"], measured["force"]
    return BumpEvent(
        start=span[0],
        stop=span[1],
        speed=float(velocity[np.argmax(np.abs(velocity))]),
        measured_peak=_peak(force),
        predicted_peak=_peak(predicted),
        rms=float(np.sqrt(np.mean((force - predicted) ** 2))),
    )


def _peak(force: Array) -> float:
    """Return the force [N] that is farthest from the first."""
    return float(force[np.argmax(np.abs(force - force[0]))])
