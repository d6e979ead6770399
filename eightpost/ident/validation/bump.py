"""Bump tests: the error of a transient in time and over velocity, and its peak forces (3.4.4, Fig 3.24 and 3.25)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError
from eightpost.ident.shock.record.preparation import LARGEST_SHARE
from eightpost.ident.validation.evaluation import evaluate
from eightpost.ident.validation.kinds import block_means
from eightpost.ident.validation.motion import stretches

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.validation.evaluation import Validation
    from eightpost.ident.validation.record import Record
    from eightpost.shock import Shock
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

#: A shock moves from this share of the record's peak speed.
_MOVES = 0.05

#: Moves that are less apart are one event [s].
_APART = 0.15

#: What belongs to an event before its motion and after it [s].
_BEFORE, _AFTER = 0.03, 0.1

#: Low-pass of a bump [Hz], at most 0.4 of the rate: through the 50 Hz of 3.3 the 17 ms of a bump come out so rounded
#: that the true law is off by 5 % RMS and 1.4 % at the peaks (tests/validation).
CUTOFF = 200.0

#: Samples that the evaluation needs at least; with fewer between the events all of the record is taken.
_ENOUGH = 200


@dataclass(frozen=True, slots=True)
class BumpEvent:
    """One motion of a bump test.

    Attributes:
        start: [s] from the record's start.
        stop: [s].
        speed: The velocity of greatest magnitude [m/s]; positive in compression.
        measured_peak: The force [N] of greatest distance from the one before the motion.
        predicted_peak: The law's force [N], the same way.
        rms: Of the error within the event [N].
    """

    start: float
    stop: float
    speed: float
    measured_peak: float
    predicted_peak: float
    rms: float

    @property
    def peak_error(self) -> float:
        """Predicted over measured peak less one [percent]."""
        return 100.0 * (self.predicted_peak / self.measured_peak - 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class BumpValidation:
    """A shock on a bump record.

    Attributes:
        prediction: From the first event to the last, with what stands between them.
        events: In time.
        rms: Of the error over the events [N].
        deviation: Standard deviation of the measured force over the events [N].
    """

    prediction: Validation
    events: tuple[BumpEvent, ...]
    rms: float
    deviation: float

    @property
    def percent(self) -> float:
        """Of the standard deviation over the events."""
        return 100.0 * self.rms / self.deviation

    @property
    def beyond(self) -> float:
        """Share of the moving time outside the fitted velocities [1]."""
        moving = sum(event.stop - event.start for event in self.events)
        return min(1.0, self.prediction.beyond * self.prediction.measured.duration / moving)


def validate_bump(shock: Shock, record: Record, *, cutoff: float | None = None) -> BumpValidation:
    """Return a shock's error on a bump record.

    Args:
        shock: As fitted.
        record: Which stands, moves fast and stands again, once or more often.
        cutoff: Of the low-pass [Hz]; default 200, at most 0.4 of the sampling rate.

    Raises:
        ParameterError: Nothing moves, or all of it does.
    """
    spans = _spans(record.test.series)
    if not spans:
        raise ParameterError(f"{record.name}: there is no motion between two rests; give another --kind for it")
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
    # Means over 2 ms: noise must not look like motion.
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
