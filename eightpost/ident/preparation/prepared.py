"""Records ready for estimation, and all that was done to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.ident.preparation.lags import Lag
    from eightpost.signals.timeseries import TimeSeries


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Records of one car at one rate, without their means.

    Attributes:
        records: One per test, in the order given, with the channels that all of them have.
        means: Of each record, by channel, SI; over the samples that were kept.
        names: What each record is called: its file, or its number.
        corners: One empty name for a quarter car, else lf, rf, lr, rr.
        lags: Of each record: within it, and against the first one.
        steps: What was done to all records, a sentence each.
        notes: What a person should look at, a sentence each.
        sources: SHA-256 digest of each file, by name.
    """

    records: tuple[TimeSeries, ...]
    means: tuple[Mapping[str, float], ...]
    names: tuple[str, ...]
    corners: tuple[str, ...]
    lags: tuple[tuple[Lag, ...], ...]
    steps: tuple[str, ...]
    notes: tuple[str, ...]
    sources: Mapping[str, str]

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return self.records[0].sample_rate

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that all records have."""
        return self.records[0].names

    def summary(self) -> tuple[str, ...]:
        """Return what was read, done and found, a line each, for printing."""
        lines = [
            f"{name}: {record.duration:.6g} s at {record.sample_rate:.6g} Hz, {len(record.names)} channels"
            for name, record in zip(self.names, self.records, strict=True)
        ]
        return (*lines, *self.steps, *(f"note: {note}" for note in self.notes))
