"""Validation on sine tests: the error by amplitude and velocity (3.4.2, Fig 3.20), and the loops (Fig 3.21)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError, TooShortError
from eightpost.ident.shock.record import CUTOFF, FILTER_EDGE, LARGEST_SHARE
from eightpost.ident.validation.dyno_record import DynoRecord, frequency_of, moving_part
from eightpost.ident.validation.evaluation import Predicted, Validation, evaluate
from eightpost.rig.motion import displacement_of
from eightpost.shock import Shock

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
