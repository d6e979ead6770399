"""What the report kit needs to know of a time series; eightpost.signals.TimeSeries has it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from eightpost.array_types import Array


class Series(Protocol):
    """Channels sampled at common times: times (N,) [s], and samples (C, N) in the SI unit of each channel."""

    @property
    def time(self) -> Array:
        """Times (N,) [s]."""

    @property
    def values(self) -> Array:
        """Samples (C, N), each row in the SI unit of its channel."""

    @property
    def names(self) -> tuple[str, ...]:
        """C names of channels."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""

    @property
    def is_uniform(self) -> bool:
        """Whether all time steps are equal."""

    @property
    def sample_rate(self) -> float:
        """Sample rate [Hz]."""

    def __len__(self) -> int:
        """Return the number of samples."""

    def __getitem__(self, name: str, /) -> Array:
        """Return a channel (N,)."""

    def unit(self, name: str, /) -> str:
        """Return the SI unit of a channel."""

    def select(self, names: Iterable[str], /) -> Series:
        """Return a series with these channels in this order."""

    def window(self, start: float, stop: float, /) -> Series:
        """Return the samples between two times [s]."""

    def resample(self, rate: float, /) -> Series:
        """Return a series with a uniform sample rate [Hz]."""
