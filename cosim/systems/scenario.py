"""Scenario of a run: its length, its drive and what is recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError
from eightpost.signals import Drivefile


@dataclass(frozen=True, repr=False)
class Scenario(Summarized):
    """A run of a system.

    Raises:
        InputError: A time is not positive and finite, or the drive does not cover the run.
    """

    stop: float  #: Duration [s].
    drive: Drivefile | None = None  #: Signals for the inputs that no component feeds.
    #: Input that each channel of `drive` feeds: `{"lf.road": "car.lf.road"}`. Empty: every channel feeds the only
    #: component input of that name.
    targets: Mapping[str, str] = field(default_factory=dict)
    record: tuple[str, ...] = ()  #: Variables to record, as `component.variable`; empty: every output.
    #: Time between recorded samples [s], a whole number of coupling steps; None: every step.
    record_step: float | None = None
    settling: float = 0.0  #: Time at the start that is excluded from response measures [s].
    drive_start: float = 0.0  #: Time in the drive at which the run starts [s]; the drive must cover the whole run.

    def __post_init__(self) -> None:
        self._check_types()
        if not (isfinite(self.stop) and self.stop > 0.0):
            raise InputError(f"scenario: stop must be a positive time, not {self.stop!r} s")
        if self.record_step is not None and not (isfinite(self.record_step) and self.record_step > 0.0):
            raise InputError(f"scenario: record_step must be a positive time, not {self.record_step!r} s")
        self._check_cover()
        if not 0.0 <= self.settling < self.stop:
            raise InputError(
                f"scenario: settling must be shorter than the run ({self.stop} s), not {self.settling!r} s"
            )

    def _check_types(self) -> None:
        for name in ("stop", "record_step", "settling", "drive_start"):
            if isinstance(value := getattr(self, name), str):
                raise InputError(f"scenario: {name} is {value!r}; give a number of seconds")
        if self.drive is not None and not isinstance(self.drive, Drivefile):
            what = f"Drivefile.read({str(self.drive)!r})" if isinstance(self.drive, str | Path) else "a Drivefile"
            raise InputError(f"scenario: drive is a {type(self.drive).__name__}; give {what}")
        if isinstance(self.record, str):
            raise InputError(f"scenario: record is a text; give a list of names: [{self.record!r}]")

    def _summary(self) -> Summary:
        return Summary.of("Scenario", *self.summary_rows())

    def summary_rows(self) -> tuple[tuple[str, str], ...]:
        """Return duration, drive and recorded variables as rows of a summary."""
        every = "every step" if self.record_step is None else f"every {1e3 * self.record_step:g} ms"
        return (
            ("duration", f"{self.stop:g} s"),
            ("drive", "none" if self.drive is None else f"{some(self.drive.names)} from {self.drive_start:g} s"),
            ("record", f"{some(self.record) or 'every output'}, {every}"),
            ("settling", f"{self.settling:g} s" if self.settling else ""),
        )

    def _check_cover(self) -> None:
        if self.drive is None:
            return
        first, last = float(self.drive.series.time[0]), float(self.drive.series.time[-1])
        begin, end = self.drive_start, self.drive_start + self.stop
        slack = 1e-9 * max(abs(last), 1.0)
        if first > begin + slack or last < end - slack:
            raise InputError(
                f"scenario: the run takes {begin:g} to {end:g} s of the drive file, it holds {first:g} to {last:g} s: "
                "change stop or drive_start"
            )
