"""What goes wrong in rig records, each with its own error: dead, clipped, slow, reversed and swapped channels.

Signs and corners are judged by physics that holds for every car and setup: a damper's force opposes its motion, a
wheel's inertia and its pan's load go with its accelerations, and a wheel follows its own wheelloader best.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ClippedChannelError, DataError, WrongSignError
from eightpost.signals import faults
from eightpost.signals.filters import derivative, lowpass, velocity_from_displacement
from eightpost.signals.origin import IN_MEMORY, Origin

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

    Array = NDArray[np.float64]

#: Shortest record [s] and fewest samples.
SHORTEST, FEWEST = 4.0, 1000

#: Share of samples that repeat the one before them, from which a channel is called held ...
HELD = 0.4
#: ... while it is longer in motion than this share of the record.
MOVING = 0.9

#: Another corner's correlation must exceed a channel's own by this much before corners are called swapped [1].
SWAPPED_BY = 0.15

#: Correlation below which a sign is called wrong [1]: weaker ones say nothing.
REVERSED = -0.2

#: A reference that moves less than this part of the largest says nothing of its corner [1].
RESTING = 0.2

#: Correlations count from this many standard deviations of what noise of the band and the record's length gives.
CERTAIN = 5.0

#: Band limit for the comparisons [Hz], at most 0.4 of the sample rate.
_BAND = 12.0

_RESPONSES = ("tire_force", "displacement", "velocity", "force", "hub_acceleration", "chassis_acceleration")


class MismatchedRateError(DataError):
    """A channel was sampled at another rate than the others."""


class SwappedCornersError(DataError):
    """A channel belongs to another corner."""


def check_rig_record(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin = IN_MEMORY) -> None:
    """Check a rig record; raise on the first fault."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    judge = _Judge(series, corners, origin)
    judge.dead_channels()
    judge.held_channels()
    judge.clipped_loads()
    judge.corners_and_signs()


class _Judge:
    """One record under examination."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...], origin: Origin) -> None:
        self._series, self._corners, self._origin = series, corners, origin
        self._rate = series.sample_rate
        self._cutoff = min(_BAND, 0.4 * self._rate)
        self._chance = CERTAIN / np.sqrt(2.0 * self._cutoff * series.duration)

    def _name(self, corner: str, quantity: str) -> str:
        return f"{corner}.{quantity}" if corner else quantity

    def _there(self, quantity: str) -> bool:
        return all(self._name(corner, quantity) in self._series for corner in self._corners)

    def dead_channels(self) -> None:
        """Every response moves in every test, and every actuator that is told to."""
        for corner in self._corners:
            for quantity in _RESPONSES:
                name = self._name(corner, quantity)
                if name in self._series:
                    faults.check_moves(self._series[name], channel=name, origin=self._origin)
        for name in self._series.names:
            command = f"{name}_command"
            if command in self._series and np.ptp(self._series[command]) > 0.0:
                faults.check_moves(self._series[name], channel=name, origin=self._origin)

    def held_channels(self) -> None:
        """No measured channel repeats most of its samples."""
        for corner in self._corners:
            for quantity in ("road", *_RESPONSES):
                name = self._name(corner, quantity)
                if name in self._series:
                    self._check_not_held(name)

    def _check_not_held(self, name: str) -> None:
        values = self._series[name]
        steps = np.diff(values)
        changes = np.flatnonzero(steps)
        if changes.size < 2 or changes[-1] - changes[0] < MOVING * values.size:
            return
        share = 1.0 - changes.size / steps.size
        hold = float(np.median(np.diff(changes)))
        # A slow signal of a coarse sensor repeats itself too, but by single levels and for times of every length.
        even = float(np.mean(np.diff(changes) == hold))
        if share > HELD and hold >= 2.0 and even > 0.8:
            what = (
                f"it changes every {hold:.0f} samples only, at {self._rate / hold:.4g} Hz in a record of "
                f"{self._rate:.4g} Hz: two loggers of different rates; export both at one rate"
            )
            raise self._origin.header_fault(MismatchedRateError, what, channel=name)

    def clipped_loads(self) -> None:
        """No load cell sits at an end of its range; an unloaded tire at zero is none."""
        for corner in self._corners:
            for quantity in ("tire_force", "force", "aero"):
                name = self._name(corner, quantity)
                if name in self._series:
                    self._check_not_clipped(name, self._name(corner, "velocity"))

    def _check_not_clipped(self, name: str, velocity: str) -> None:
        values, speed = self._series[name], np.abs(self._series[velocity])
        # While the car rests, as in static loading, a load that stays the same is no evidence.
        moving = speed > 1e-3 * speed.max()
        if np.ptp(values) <= 1e-12 * np.abs(values).max():
            return
        for signed, end in ((values, "highest"), (-values, "lowest")):
            found = faults.clipped_samples(signed, moving)
            if found.size and abs(values[found[0]]) > 1e-6 * np.ptp(values):
                what = (
                    f"{found.size} of {values.size} samples sit at the {end} value {values[found[0]]:.6g} N: the load "
                    "cell or its amplifier is clipped; record again with a larger range, or with less drive"
                )
                raise self._origin.fault(ClippedChannelError, what, channel=name, sample=int(found[0]))

    def corners_and_signs(self) -> None:
        """Compare what must go together, at its own corner and at the others'."""
        self._compare("force", self._plain("force"), "velocity", self._plain("velocity"))
        if self._there("displacement"):
            self._compare("velocity", self._plain("velocity"), "displacement", self._slope("displacement"))
        if self._there("hub_acceleration"):
            self._compare("hub_acceleration", self._plain("hub_acceleration"), "road", self._curvature("road"))
        if self._there("hub_acceleration") and self._there("chassis_acceleration"):
            self._check_loads()

    def _plain(self, quantity: str) -> Callable[[str], Array]:
        return lambda corner: self._low(self._series[self._name(corner, quantity)])

    def _slope(self, quantity: str) -> Callable[[str], Array]:
        return lambda corner: velocity_from_displacement(
            self._series[self._name(corner, quantity)], self._rate, self._cutoff
        )

    def _curvature(self, quantity: str) -> Callable[[str], Array]:
        slope = self._slope(quantity)
        return lambda corner: self._low(derivative(slope(corner), self._rate))

    def _low(self, values: Array) -> Array:
        return lowpass(values - values.mean(), self._rate, self._cutoff)

    def _compare(
        self, quantity: str, own: Callable[[str], Array], against: str, reference: Callable[[str], Array]
    ) -> None:
        """Raise unless every corner's `quantity` goes with its own reference and with none better."""
        references = np.stack([reference(corner) for corner in self._corners])
        size = references.std(axis=1)
        for place, corner in enumerate(self._corners):
            if size[place] < RESTING * size.max():
                continue  # with one actuator at a time the others rest, and what rests tells nothing
            likeness = _correlations(own(corner), references)
            best = int(np.argmax(np.abs(likeness)))
            if abs(likeness[best]) > abs(likeness[place]) + max(SWAPPED_BY, self._chance):
                self._say_swapped(corner, quantity, against, place, best, likeness)
            if likeness[place] < min(REVERSED, -self._chance):
                self._say_reversed(self._name(corner, quantity), self._name(corner, against), likeness[place])

    def _say_swapped(self, corner: str, quantity: str, against: str, place: int, best: int, likeness: Array) -> None:
        other = self._corners[best]
        what = (
            f"it goes with {self._name(other, against)} (correlation {likeness[best]:.2f}) rather than with "
            f"{self._name(corner, against)} ({likeness[place]:.2f}): the corners are swapped, of this channel or of "
            "that one; look which of the two goes with its neighbours, and exchange the columns in the channel map"
        )
        raise self._origin.header_fault(SwappedCornersError, what, channel=self._name(corner, quantity))

    def _say_reversed(self, name: str, against: str, likeness: float) -> None:
        what = (
            f"it correlates with {against} at {likeness:.2f}, so one is positive the other way (docs/ports.md); "
            f"set gain = -1 in the channel map for the one that is wrong, or pass --flip {name}"
        )
        raise self._origin.header_fault(WrongSignError, what, channel=name)

    def _check_loads(self) -> None:
        """A tire force carries its wheel and its share of the chassis: it goes with their accelerations."""
        names = ("hub_acceleration", "chassis_acceleration", "aero")
        known = [name for name in names if self._there(name)]
        parts = {corner: np.stack([self._plain(name)(corner) for name in known]) for corner in self._corners}

        def inertia(corner: str) -> Array:
            load = self._plain("tire_force")(corner)
            shares = np.linalg.lstsq(parts[corner].T, load, rcond=None)[0]
            return np.asarray(np.abs(shares) @ parts[corner])

        self._compare("tire_force", self._plain("tire_force"), "chassis_acceleration", inertia)


def _correlations(values: Array, references: Array) -> Array:
    """Return the correlation of `values` (N,) with each reference (C, N), 0 where one does not move."""
    scale = np.linalg.norm(values) * np.linalg.norm(references, axis=1)
    products = references @ values
    return np.asarray(np.divide(products, scale, out=np.zeros_like(products), where=scale > 0.0))
