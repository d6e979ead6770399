"""Error of a shock on one record (3.4): random and track, sine (Fig 3.20), static (3.4.3) and bump records (3.4.4)."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import MissingChannelError, ParameterError, TooShortError
from eightpost.ident.shock.runs import CUTOFF, FILTER_EDGE, LARGEST_SHARE, prepare
from eightpost.ident.shock.simulation import as_measured, reference_of, simulate
from eightpost.ident.validation.records import (
    DynoRecord,
    ErrorSpectrum,
    block_means,
    error_spectrum,
    frequency_of,
    moving_part,
    standing,
)
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.motion import displacement_of
from eightpost.shock import Shock
from eightpost.signals import TimeSeries
from eightpost.signals.faults import runs

#: Start and end of a part of a record, from its start [s].
Segment = tuple[float, float]

# ---- The error of a prediction over time ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """The error of a prediction, with prediction and measurement through the same low-pass."""

    rms: float  #: RMS of the error [N]
    offset: float  #: Mean of the error, measured minus predicted [N]; part of `rms`
    deviation: float  #: Standard deviation of the low-passed measured force [N]
    beyond: float  #: Share of the samples whose velocity is outside the fitted range [1]
    measured: TimeSeries  #: Velocity, force and, if known, displacement from the shock's reference; low-passed
    predicted: TimeSeries  #: Predicted force [N]
    changes: tuple[str, ...]  #: Departures from the dissertation's treatment of the record (3.3), one sentence each
    cutoff: float  #: Cutoff frequency of the low-pass [Hz]
    seconds: float  #: Computing time of the law's evaluation [s]

    @property
    def percent(self) -> float:
        """The RMS error in percent of the standard deviation, as in Tables 3.4 and 3.5."""
        return 100.0 * self.rms / self.deviation

    @property
    def error(self) -> Array:
        """Measured minus predicted force (N,) [N]."""
        return np.asarray(self.measured["force"] - self.predicted["force"])


def evaluate(
    shock: Shock, test: DynoTest, *, segment: Segment | None = None, cutoff: float | None = None
) -> Validation:
    """Return the error of a shock's prediction on a dynamometer test.

    The displacement is relative to the shock's own reference. A gas force that the fit estimated but left to the car
    (`included`) is added, because the record contains it. The motion ratio is ignored, because a dynamometer moves the
    damper itself.

    Args:
        shock: Fitted shock.
        test: Another record of the same shock; on the fit's own record the result is the fit's error.
        segment: Start and end [s] from the record's start; default 1 to 10.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 50, at most 0.4 of the sampling rate.
    """
    prepared = prepare(test, segment=segment, cutoff=cutoff)
    record, law = prepared.record, as_measured(shock)
    if "displacement" in record:
        shifted = record["displacement"] + prepared.reference - reference_of(shock, prepared.reference)
        record = record.with_channel("displacement", "m", shifted)
    started = time.perf_counter()
    simulated = simulate(law, record)
    seconds = time.perf_counter() - started
    predicted = TimeSeries.from_channels(record.time, {"force": ("N", prepared.filtered(simulated))})
    start, stop = record.time[prepared.inside][[0, -1]]
    measured, predicted = record.window(start, stop), predicted.window(start, stop)
    error = measured["force"] - predicted["force"]
    beyond = [law.curve.is_beyond_fit(velocity) for velocity in measured["velocity"].tolist()]
    return Validation(
        float(np.sqrt(np.mean(error**2))), float(np.mean(error)), prepared.deviation, float(np.mean(beyond)),
        measured, predicted, prepared.changes, prepared.cutoff, seconds,
    )  # fmt: skip


class Outcome(Protocol):
    """Error of a shock on a record."""

    @property
    def prediction(self) -> Validation | None:
        """The prediction over time; None for a static record."""

    @property
    def rms(self) -> float:
        """The RMS of the error [N]."""

    @property
    def percent(self) -> float | None:
        """The error in percent of this record's standard deviation of force; None if there is nothing to scale it."""

    @property
    def beyond(self) -> float:
        """Share of the samples outside the fitted velocities [1]."""


class _Whole:
    """Outcome whose error is that of the prediction over the whole record."""

    __slots__ = ()
    prediction: Validation
    rms = property(lambda self: self.prediction.rms)
    percent = property(lambda self: self.prediction.percent)
    beyond = property(lambda self: self.prediction.beyond)


# ---- Random and track records (Table 3.5) ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RandomValidation(_Whole):
    """Error of a shock on a random or track record."""

    prediction: Validation  # type: ignore[override]
    residual: ErrorSpectrum | None  #: Spectra of the error, its coherence with velocity; None for less than 2.5 s


def validate_random(
    shock: Shock, record: DynoRecord, *, segment: Segment | None = None, cutoff: float | None = None
) -> RandomValidation:
    """Return a shock's error on a random record over seconds 1 to 10 or a segment; see `evaluate` for the arguments."""
    prediction = evaluate(shock, record.test, segment=segment, cutoff=cutoff)
    return RandomValidation(prediction, residual_of(prediction))


def residual_of(found: Validation) -> ErrorSpectrum | None:
    """Return an error's spectra and its coherence with the velocity: near 1, the law misses dynamics, say a lag."""
    measured, force = found.measured, found.predicted["force"]
    # Blocks of 1 s; periodograms of half-overlapping Hann blocks are correlated by 1 / 36 (Welch 1967).
    return error_spectrum(
        measured["force"], force, measured["velocity"], rate=measured.sample_rate, band=found.cutoff, block=1.0,
        fewest=4, overlap=1.0 / 36.0,
    )  # fmt: skip


# ---- Sine records: the error by amplitude and velocity, and the loops (Fig 3.20 and 3.21) ---------------------------

_BRANCH = 0.9  # share of the peak speed up to which the hysteresis is evaluated; at the peak the branches meet


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """The last period of a sine test."""

    displacement: Array  #: About its mean (N,) [m]
    velocity: Array  #: (N,) [m/s]
    force: Array  #: (N,) [N]

    @property
    def energy(self) -> float:
        """Energy dissipated in a period, the area of the force-displacement loop [J]."""
        means = 0.5 * (self.force + np.roll(self.force, -1))
        return float(means @ (np.roll(self.displacement, -1) - self.displacement))

    @property
    def hysteresis(self) -> float:
        """Largest difference of force between the branches below and above mid-stroke, to 90 % of peak speed [N]."""
        reach = _BRANCH * min(self.velocity.max(), -self.velocity.min())
        grid = np.linspace(-reach, reach, 181)
        branches = []
        for side in (self.displacement < 0.0, self.displacement >= 0.0):  # along each, the velocity is monotonic
            order = np.argsort(self.velocity[side])
            branches.append(np.interp(grid, self.velocity[side][order], self.force[side][order]))
        return float(np.abs(branches[0] - branches[1]).max())

    @property
    def compression_peak(self) -> float:
        """Maximum force [N]."""
        return float(self.force.max())

    @property
    def rebound_peak(self) -> float:
        """Minimum force [N]."""
        return float(self.force.min())


@dataclass(frozen=True, slots=True, eq=False)
class SineValidation(_Whole):
    """Error of a shock on a sine record."""

    #: Over whole periods
    prediction: Validation  # type: ignore[override]
    frequency: float  #: [Hz]
    amplitude: float  #: Half the peak-to-peak displacement, low-passed [m]
    measured: Loop
    predicted: Loop

    @property
    def speed(self) -> float:
        """Peak speed of a sine of this amplitude and frequency [m/s]."""
        return 2.0 * np.pi * self.frequency * self.amplitude


def validate_sine(
    shock: Shock, record: DynoRecord, *, segment: Segment | None = None, cutoff: float | None = None
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
        raise ParameterError(
            f"{record.name} has no single frequency and is no sine test; give another --set kind for it"
        )
    found = evaluate(shock, record.test, segment=_periods(record, frequency, segment, cutoff), cutoff=cutoff)
    displacement = displacement_of(found.measured)
    last = found.measured.time >= found.measured.time[-1] - 1.0 / frequency
    moved, velocity = displacement[last] - displacement[last].mean(), found.measured["velocity"][last]
    loops = (Loop(moved, velocity, series["force"][last]) for series in (found.measured, found.predicted))
    return SineValidation(found, frequency, 0.5 * float(np.ptp(displacement)), *loops)


def _periods(record: DynoRecord, frequency: float, segment: Segment | None, cutoff: float | None) -> Segment:
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


# ---- Static records: force over displacement in both directions, gas rate, seal drag (3.4.3, Fig 3.22 and 3.23) -----

#: Excluded from a hold: the first 5 s and the last second (3.4.3); of a hold under 12 s its first half and last 5 %.
SETTLING, ENDING, _SHORT = 5.0, 1.0, 12.0
_SHORTEST_HOLD, _RATE = 1.0, 100.0  # minimum length [s]; rate to which the record is averaged [Hz]

Direction = Literal["start", "compression", "rebound"]


@dataclass(frozen=True, slots=True)
class Hold:
    """A displacement that was held."""

    start: float  #: Start of the averaged time [s]
    stop: float
    displacement: float  #: Mean [m], with the record's zero
    force: float  #: Mean of the measured force [N]
    predicted: float  #: Mean of the law's force [N]
    direction: Direction  #: Of the move that led to it


@dataclass(frozen=True, slots=True, eq=False)
class StaticValidation:
    """Error of a shock on a static record; a law's drag is a function of velocity, so its gas force is compared."""

    holds: tuple[Hold, ...]  #: In the order of time
    series: TimeSeries  #: Averaged to at most 100 Hz: displacement [m], force [N] and predicted_force [N]
    settling: float  #: Time excluded at the beginning of the holds [s]: 5, or less if a hold is short
    prediction: None = None

    @property
    def compression_rate(self) -> float | None:
        """Slope (least squares) over the holds reached in compression [N/m]; None for fewer than two."""
        return _slope(self._towards("compression"))

    @property
    def rebound_rate(self) -> float | None:
        """Slope over the holds reached in rebound [N/m]; None for fewer than two."""
        return _slope(self._towards("rebound"))

    @property
    def gas_rate(self) -> float | None:
        """Slope after half the hysteresis is removed from each direction [N/m]; the first hold has no direction."""
        half = 0.5 * (self.hysteresis or 0.0)
        used = [hold for hold in self.holds if hold.direction != "start"]
        signs = [-1.0 if hold.direction == "compression" else 1.0 for hold in used]
        found = _slope(used, [hold.force + sign * half for hold, sign in zip(used, signs, strict=True)])
        return _slope(self.holds) if found is None else found

    @property
    def predicted_rate(self) -> float | None:
        """Slope of the law's forces over all holds [N/m]."""
        return _slope(self.holds, [hold.predicted for hold in self.holds])

    @property
    def hysteresis(self) -> float | None:
        """Mean difference [N] of the directions at displacements that both reach; None without such displacements."""
        up, down = self._towards("compression"), self._towards("rebound")
        if not (up and down):
            return None
        low, high = (end(side[k].displacement for side in (up, down)) for end, k in ((max, 0), (min, -1)))
        # Positions are repeated only to within the actuator's error.
        tolerance = 0.01 * float(np.ptp([hold.displacement for hold in self.holds]))
        if low > high + tolerance:
            return None
        held = [h.displacement for h in (*up, *down) if low - tolerance <= h.displacement <= high + tolerance]
        curves = (np.interp(held, [h.displacement for h in s], [h.force for h in s]) for s in (up, down))
        return float(np.mean(np.subtract(*curves)))

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

    def _towards(self, direction: Direction) -> list[Hold]:
        return sorted((h for h in self.holds if h.direction == direction), key=lambda hold: hold.displacement)


def _slope(holds: Iterable[Hold], forces: list[float] | None = None) -> float | None:
    """Return the slope (least squares) of forces over displacements [N/m]; None for fewer than two displacements."""
    places = [hold.displacement for hold in holds]
    if len(set(places)) < 2:
        return None
    return float(np.polyfit(places, [hold.force for hold in holds] if forces is None else forces, 1)[0])


def validate_static(shock: Shock, record: DynoRecord, *, segment: Segment | None = None) -> StaticValidation:
    """Return rates, drag and the error of a law on a static record: steps of displacement with a hold after each.

    Args:
        shock: Fitted shock. Its gas force is compared; its drag is a function of velocity and so zero at rest.
        record: Record of a static test.
        segment: Start and end [s], from the record's start, of the part whose holds count; default all.

    Raises:
        MissingChannelError: The record has no displacement.
        ParameterError: Fewer than two displacements are held for a second or more.
    """
    test = record.test.series
    if "displacement" not in test:
        what = "a static test needs displacement; without it only the other kinds can be validated"
        raise MissingChannelError(what, path=record.test.source, channel="displacement")
    even = test if test.is_uniform else test.resample(test.sample_rate)
    series = block_means(even.select(("displacement", "velocity", "force")), int(even.sample_rate // _RATE))
    reference = reference_of(shock, float(series["displacement"].mean()))
    about = series.with_channel("displacement", "m", series["displacement"] - reference)
    series = series.with_channel("predicted_force", "N", simulate(as_measured(shock), about))
    if segment:
        series = series.window(float(test.time[0]) + segment[0], float(test.time[0]) + segment[1])
    holds, settling = _holds(series)
    if len({round(hold.displacement, 4) for hold in holds}) < 2:
        where = f" from {segment[0]:g} to {segment[1]:g} s" if segment else ""
        remedy = "give another --set segment" if segment else "for another test give its --set kind"
        raise ParameterError(
            f"{record.name}: {len(holds)} holds of a second or more at fewer than two displacements{where}; a static "
            f"test has steps with a hold after each (Fig 3.12); {remedy}"
        )
    return StaticValidation(holds, series, settling)


def _holds(series: TimeSeries) -> tuple[tuple[Hold, ...], float]:
    """Return the holds, and the time excluded at their beginning [s]."""
    found: list[Hold] = []
    settling = SETTLING
    for first, last in runs(standing(series)):
        start, stop = float(series.time[first]), float(series.time[last - 1])
        length = stop - start
        if length < _SHORTEST_HOLD:
            continue
        before, after = (SETTLING, ENDING) if length >= _SHORT else (0.5 * length, 0.05 * length)
        settling = min(settling, before)
        part = series.window(start + before, stop - after)
        moved, force, predicted = (float(part[name].mean()) for name in ("displacement", "force", "predicted_force"))
        way: Direction = "start"
        if found:
            way = "compression" if moved > found[-1].displacement else "rebound"
        found.append(Hold(start + before, stop - after, moved, force, predicted, way))
    return tuple(found), settling


# ---- Bump records: the error of a transient in time and over velocity, and its peak forces (Fig 3.24 and 3.25) ------

_MOVES = 0.05  # share of the peak speed above which the shock counts as moving
_APART, _BEFORE, _AFTER = 0.15, 0.03, 0.1  # gap between two events, time before and after the motion in an event [s]
#: Low-pass of a bump [Hz], at most 0.4 of the sampling rate. The 50 Hz of 3.3 would smooth the 17 ms of a bump so much
#: That the true law has an error of 5 % RMS and 1.4 % at the peaks (tests/validation).
BUMP_CUTOFF = 200.0
_ENOUGH = 200  # with fewer samples around the events the whole record is used


@dataclass(frozen=True, slots=True)
class BumpEvent:
    """One motion of a bump test; a peak is the force farthest from the force before the motion."""

    start: float  #: From the record's start [s]
    stop: float
    speed: float  #: Velocity of largest magnitude [m/s]; positive in compression
    measured_peak: float  #: [N]
    predicted_peak: float  #: [N]
    rms: float  #: Of the error within the event [N]

    @property
    def peak_error(self) -> float:
        """Predicted over measured peak minus one [percent]."""
        return 100.0 * (self.predicted_peak / self.measured_peak - 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class BumpValidation:
    """Error of a shock on a bump record."""

    prediction: Validation  #: From the first event to the last, including the times between them
    events: tuple[BumpEvent, ...]  #: In the order of time
    rms: float  #: Of the error over the events [N]
    deviation: float  #: Of the measured force over the events [N]

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
    shock: Shock, record: DynoRecord, *, segment: Segment | None = None, cutoff: float | None = None
) -> BumpValidation:
    """Return a shock's error on a record that stands still, moves fast and stands still again, once or several times.

    Args:
        shock: Fitted shock.
        record: Record of a bump test.
        segment: Start and end [s], from the record's start, between which events count; default all.
        cutoff: Cutoff frequency of the low-pass [Hz]; default 200, at most 0.4 of the sampling rate.

    Raises:
        ParameterError: Nothing moves, or the record never stands still.
    """
    series = record.test.series
    first, last = segment or (0.0, series.duration)
    spans = [span for span in _spans(series) if first <= span[0] and span[1] <= last]
    if not spans:
        where = f" from {first:g} to {last:g} s" if segment else ""
        remedy = "give another --set segment" if segment else "give another --set kind for it"
        raise ParameterError(f"{record.name}: no motion between two rests was found{where}; {remedy}")
    segment = (spans[0][0], spans[-1][1])
    if (segment[1] - segment[0]) * series.sample_rate < _ENOUGH:
        segment = (0.0, series.duration)
    cutoff = cutoff or min(BUMP_CUTOFF, LARGEST_SHARE * series.sample_rate)
    found = evaluate(shock, record.test, segment=segment, cutoff=cutoff)
    time = found.measured.time
    inside = np.any([(time >= start) & (time <= stop) for start, stop in spans], axis=0)
    events = tuple(_event(found, span) for span in spans)
    rms = float(np.sqrt(np.mean(found.error[inside] ** 2)))
    return BumpValidation(found, events, rms, float(np.std(found.measured["force"][inside])))


def _spans(series: TimeSeries) -> list[tuple[float, float]]:
    """Return start and stop [s], from the record's start, of each event."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    # Means over 2 ms keep noise from being taken for motion.
    smooth = block_means(even, int(0.002 * even.sample_rate))
    speed, time = np.abs(smooth["velocity"]), smooth.time - even.time[0]
    spans: list[tuple[float, float]] = []
    for first, last in runs(speed > _MOVES * speed.max()):
        start, stop = float(time[first]), float(time[last - 1])
        joins = spans and start - spans[-1][1] < _APART
        spans.append((spans.pop()[0] if joins else start, stop))
    return [(max(start - _BEFORE, 0.0), min(stop + _AFTER, even.duration)) for start, stop in spans]


def _event(found: Validation, span: tuple[float, float]) -> BumpEvent:
    measured, predicted = found.measured.window(*span), found.predicted.window(*span)
    velocity, error = measured["velocity"], measured["force"] - predicted["force"]
    forces = (measured["force"], predicted["force"])
    measured_peak, predicted_peak = (float(force[np.argmax(np.abs(force - force[0]))]) for force in forces)
    speed = float(velocity[np.argmax(np.abs(velocity))])
    return BumpEvent(*span, speed, measured_peak, predicted_peak, float(np.sqrt(np.mean(error**2))))
