"""Ranges that the tests of a fit covered, and where another record or a simulation leaves them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass

#: Largest ratio of a channel's peak to that of the tests; largest share of an output's power above the fit's band,
#: as in a study.
_BEYOND, _ABOVE = 1.1, 0.1

#: Band of the records that fits are made from [Hz]; peaks are compared in it.
_BAND = 50.0

#: Shocks below this fraction of the tests' velocities barely move: friction holds them.
_GENTLE = 0.05

#: Fraction of its mean load at or below which a tire has lifted.
_LIFTED = 0.01

#: Quantities whose ranges a fit stores.
_RANGED = ("velocity", "displacement", "force", "tire_force")


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges that the tests covered."""

    frequency: tuple[float, float] | None  #: Lowest and highest frequency of the fit [Hz]; None if it is not known.
    channels: Mapping[str, tuple[float, float]]  #: Smallest and largest value by channel, SI.

    def as_mapping(self) -> dict[str, tuple[float, float]]:
        """Return the ranges by channel and the frequency range, in the form stored in a fit."""
        return {**({} if self.frequency is None else {"frequency": self.frequency}), **self.channels}

    @classmethod
    def of_mapping(cls, ranges: Mapping[str, tuple[float, float]]) -> Ranges:
        """Return the ranges stored in a fit."""
        channels = {name: span for name, span in ranges.items() if name != "frequency"}
        return cls(ranges.get("frequency"), channels)

    def beyond(self, series: TimeSeries) -> tuple[str, ...]:
        """Return up to two sentences on where a series without means leaves the tests' amplitudes and frequencies."""
        return (*self._amplitudes(series), *self._frequencies(series))

    def is_gentle(self, series: TimeSeries) -> bool:
        """Return whether all shocks stay below 5 % of the velocities of the tests; False if that is not known."""
        names = [name for name in self.channels if quantity(name) == "velocity" and name in series]
        return bool(names) and all(_peak(series, name) < _GENTLE * self._covered(name) for name in names)

    def _covered(self, name: str) -> float:
        return max(abs(end) for end in self.channels[name])

    def _amplitudes(self, series: TimeSeries) -> Iterator[str]:
        names = [name for name in self.channels if name in series and self._covered(name) > 0.0]
        peaks = {name: _peak(series, name) for name in names}
        times = {name: peaks[name] / self._covered(name) for name in names}
        over = sorted((name for name in names if times[name] > _BEYOND), key=lambda name: -times[name])
        if over:
            listed = ", ".join(f"{n} {times[n]:.2g} times ({peaks[n]:.3g} {series.unit(n)})" for n in over)
            yield f"amplitudes beyond the fit's tests: {listed}"

    def _frequencies(self, series: TimeSeries) -> Iterator[str]:
        if self.frequency is None:
            return
        high = self.frequency[1]
        shares = {n: _share_above(series, n, high) for n in series.names if quantity(n) in ("velocity", "tire_force")}
        over = sorted((name for name in shares if shares[name] > _ABOVE), key=lambda name: -shares[name])
        if over:
            listed = ", ".join(f"{name} {100.0 * shares[name]:.0f} %" for name in over)
            yield f"power above {high:.3g} Hz, where the model was not fitted and no criterion applies: {listed}"


def ranges_of(tests: Sequence[TimeSeries], experiment: Experiment, frequency: tuple[float, float]) -> Ranges:
    """Return the ranges that the tests covered."""
    names = [name for name in (*experiment.forces, *experiment.outputs) if quantity(name) in _RANGED]
    low = {name: min(float(test[name].min()) for test in tests) for name in names}
    high = {name: max(float(test[name].max()) for test in tests) for name in names}
    return Ranges(frequency, {name: (low[name], high[name]) for name in names})


def lifted_tires(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> tuple[str, ...]:
    """Return the channels of the tires that leave the ground.

    Tire forces with means near zero are changes from rest and cannot show it.

    Args:
        tests: Records without means.
        means: Means that the first record had, SI, by channel.
    """
    tires = {n: mean for n, mean in means.items() if quantity(n) == "tire_force" and n in tests[0]}
    return tuple(
        name
        for name, mean in tires.items()
        if mean > tests[0][name].std() and mean + min(float(test[name].min()) for test in tests) <= _LIFTED * mean
    )


def _peak(series: TimeSeries, name: str) -> float:
    rate = series.sample_rate
    return float(np.abs(lowpass(series[name], rate, min(_BAND, 0.4 * rate), order=4)).max())


def _share_above(series: TimeSeries, name: str, high: float) -> float:
    lines = np.fft.rfftfreq(len(series), 1.0 / series.sample_rate)
    power = np.abs(np.fft.rfft(series[name] - series[name].mean())) ** 2
    whole = float(power.sum())
    return float(power[lines > high].sum() / whole) if whole else 0.0
