"""Bump tests: the error of a transient in time and over velocity, and its peak forces (3.4.4, Fig 3.24 and 3.25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.record import LARGEST_SHARE
from eightpost.ident.validation.dyno_record import DynoRecord, block_means, stretches
from eightpost.ident.validation.evaluation import Validation, evaluate
from eightpost.shock import Shock
from eightpost.signals import TimeSeries

#: Share of the record's peak speed above which the shock counts as moving.
_MOVES = 0.05

#: Motions separated by less than this time are one event [s].
_APART = 0.15

#: Time before and after its motion that belongs to an event [s].
_BEFORE, _AFTER = 0.03, 0.1

#: Low-pass of a bump [Hz], at most 0.4 of the sampling rate. The 50 Hz of 3.3 would smooth the 17 ms of a bump so much
#: that the true law has an error of 5 % RMS and 1.4 % at the peaks (tests/validation).
CUTOFF = 200.0

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
    cutoff = cutoff or min(CUTOFF, LARGEST_SHARE * record.test.series.sample_rate)
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
