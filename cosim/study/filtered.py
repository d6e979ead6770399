"""Channels of one run as its measures look at them: each is filtered once, whatever number of measures asks."""

from __future__ import annotations

from dataclasses import dataclass, field

from cosim.study.band import Array, band_pass
from eightpost.signals import TimeSeries


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """A run and what its bands leave of it.

    Args:
        series: The run.
    """

    series: TimeSeries
    _kept: dict[tuple[str, tuple[float, float]], Array] = field(init=False, repr=False, default_factory=dict)

    def channel(self, name: str, band: tuple[float, float] | None, what: str) -> Array:
        """Return a channel (N,) in SI, as it is or within a band [Hz]; `what` is the measure, for the message.

        Raises:
            MissingChannelError: There is no such channel.
            InputError: The band does not fit the sample rate.
        """
        if band is None:
            return self.series[name]
        if (name, band) not in self._kept:
            self._kept[name, band] = band_pass(self.series[name], self.series.sample_rate, band, what)
        return self._kept[name, band]
