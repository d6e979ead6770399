"""Prepared records, with descriptions of their preparation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.ident.preparation.lags import Lag
    from eightpost.signals.timeseries import TimeSeries


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Records of one car at one rate, without means.

    Attributes:
        records: One record per test, in the order given, with the channels that all records have.
        means: Means of each record by channel, SI, over the samples that were kept.
        names: Name of each record: its file, or its number.
        corners: Names of the corners: lf, rf, lr, rr, or one empty name for a quarter car.
        lags: Lags within each record, and of each record behind the first one.
        steps: Descriptions of the steps that were applied to all records, a sentence each.
        notes: Findings that the user should check, a sentence each.
        sources: SHA-256 digest of each file by name.
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
        """Sample rate [Hz]."""
        return self.records[0].sample_rate

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that all records have."""
        return self.records[0].names

    def summary(self) -> tuple[str, ...]:
        """Return lines on the records, the steps and the notes, for printing."""
        lines = [
            f"{name}: {record.duration:.6g} s at {record.sample_rate:.6g} Hz, {len(record.names)} channels"
            for name, record in zip(self.names, self.records, strict=True)
        ]
        return (*lines, *self.steps, *(f"note: {note}" for note in self.notes))
