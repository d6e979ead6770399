"""Checks of rig records for dead, clipped, slowly sampled, reversed and swapped channels, each with its own error."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ClippedChannelError, DataError
from eightpost.rig.post.rig_signs import check_corners_and_signs
from eightpost.signals import faults
from eightpost.signals.origin import IN_MEMORY, Origin

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries

#: Minimum duration [s] and minimum number of samples of a record.
SHORTEST, FEWEST = 4.0, 1000

#: Share of samples that repeat the previous one, above which a channel was sampled at a lower rate ...
HELD = 0.4
#: ... if it changes over at least this share of the record.
MOVING = 0.9

_RESPONSES = ("tire_force", "displacement", "velocity", "force", "hub_acceleration", "chassis_acceleration")


class MismatchedRateError(DataError):
    """A channel was sampled at a lower rate than the others."""


def check_rig_record(series: TimeSeries, corners: tuple[str, ...], *, origin: Origin = IN_MEMORY) -> None:
    """Check a rig record and raise an exception for the first fault."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    checks = _ChannelChecks(series, corners, origin)
    checks.check_dead_channels()
    checks.check_held_channels()
    checks.check_clipped_loads()
    check_corners_and_signs(series, corners, origin=origin)


class _ChannelChecks:
    """Checks of the individual channels of a record."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...], origin: Origin) -> None:
        self._series, self._corners, self._origin = series, corners, origin
        self._rate = series.sample_rate

    def _name(self, corner: str, quantity: str) -> str:
        return f"{corner}.{quantity}" if corner else quantity

    def check_dead_channels(self) -> None:
        """Check that every response varies, and every actuator whose command varies."""
        for corner in self._corners:
            for quantity in _RESPONSES:
                name = self._name(corner, quantity)
                if name in self._series:
                    faults.check_moves(self._series[name], channel=name, origin=self._origin)
        for name in self._series.names:
            command = f"{name}_command"
            if command in self._series and np.ptp(self._series[command]) > 0.0:
                faults.check_moves(self._series[name], channel=name, origin=self._origin)

    def check_held_channels(self) -> None:
        """Check that no measured channel repeats most of its samples."""
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
        # A slow signal of a coarse sensor also repeats samples, but for irregular times.
        even = float(np.mean(np.diff(changes) == hold))
        if hold >= 2.0 and even > 0.8:
            what = (
                f"it changes only every {hold:.0f} samples, at {self._rate / hold:.4g} Hz in a record of "
                f"{self._rate:.4g} Hz: two loggers with different sample rates; export both at one rate"
            )
            raise self._origin.header_fault(MismatchedRateError, what, channel=name)

    def check_clipped_loads(self) -> None:
        """Check that no load cell is clipped; an unloaded tire with zero force is not clipped."""
        for corner in self._corners:
            for quantity in ("tire_force", "force", "aero"):
                name = self._name(corner, quantity)
                if name in self._series:
                    self._check_not_clipped(name, self._name(corner, "velocity"))

    def _check_not_clipped(self, name: str, velocity: str) -> None:
        values, speed = self._series[name], np.abs(self._series[velocity])
        # While the car is at rest, as in static loading, a constant load is normal.
        moving = speed > 1e-3 * speed.max()
        if np.ptp(values) <= 1e-12 * np.abs(values).max():
            return
        for signed, end in ((values, "highest"), (-values, "lowest")):
            found = faults.clipped_samples(signed, moving)
            if found.size and abs(values[found[0]]) > 1e-6 * np.ptp(values):
                what = (
                    f"{found.size} of {values.size} samples are equal to the {end} value {values[found[0]]:.6g} N: the "
                    "load cell or its amplifier is clipped; record again with a larger range, or with a smaller drive"
                )
                raise self._origin.fault(ClippedChannelError, what, channel=name, sample=int(found[0]))
