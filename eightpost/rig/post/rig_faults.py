"""What goes wrong in rig records, each with its own error: dead, clipped, slow, reversed and swapped channels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ClippedChannelError, DataError
from eightpost.rig.post.rig_signs import check_corners_and_signs
from eightpost.signals import faults
from eightpost.signals.origin import IN_MEMORY, Origin

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries

#: Shortest record [s] and fewest samples.
SHORTEST, FEWEST = 4.0, 1000

#: Share of samples that repeat the one before them, from which a channel is called held ...
HELD = 0.4
#: ... while it is longer in motion than this share of the record.
MOVING = 0.9

_RESPONSES = ("tire_force", "displacement", "velocity", "force", "hub_acceleration", "chassis_acceleration")


class MismatchedRateError(DataError):
    """A channel was sampled at another rate than the others."""


def check_rig_record(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin = IN_MEMORY) -> None:
    """Check a rig record; raise on the first fault."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    judge = _Judge(series, corners, origin)
    judge.dead_channels()
    judge.held_channels()
    judge.clipped_loads()
    check_corners_and_signs(series, corners, origin=origin)


class _Judge:
    """One record under examination."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...], origin: Origin) -> None:
        self._series, self._corners, self._origin = series, corners, origin
        self._rate = series.sample_rate

    def _name(self, corner: str, quantity: str) -> str:
        return f"{corner}.{quantity}" if corner else quantity

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
        changes = np.flatnonzero(values[1:] != values[:-1])
        share = 1.0 - changes.size / (values.size - 1)
        if share <= HELD or changes.size < 2 or changes[-1] - changes[0] < MOVING * values.size:
            return
        hold = float(np.median(np.diff(changes)))
        # A slow signal of a coarse sensor repeats itself too, but by single levels and for times of every length.
        even = float(np.mean(np.diff(changes) == hold))
        if hold >= 2.0 and even > 0.8:
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
