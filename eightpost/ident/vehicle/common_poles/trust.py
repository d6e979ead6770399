"""Validity of an identified car: ranges that the tests covered, and signs of effects that the model does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse
    from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel
    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

#: Misfit, in standard deviations of the estimate, above which it is reported as more than noise [1].
EXCESS = 1.5

#: Unexplained part of an output above which it is reported, and coherence above which it is good [1].
_NOISY, _FINE = 0.05, 0.95

#: Ratio of a simulated amplitude to that of the tests above which it is extrapolated [1].
_MARGIN = 1.1

#: Tire force relative to its mean load at or below which the tire has left the ground [1].
_LIFTED = 0.01

_RANGED = ("velocity", "displacement", "force", "tire_force")


@dataclass(frozen=True, slots=True)
class Ranges:
    """Ranges that the tests covered.

    Attributes:
        frequency: Lowest and highest frequency of the fit [Hz].
        channels: Smallest and largest value by channel, SI.
    """

    frequency: tuple[float, float]
    channels: Mapping[str, tuple[float, float]]

    def as_mapping(self) -> dict[str, tuple[float, float]]:
        """Return the ranges by channel and the frequency range, in the form stored in a fit."""
        return {"frequency": self.frequency, **self.channels}

    @classmethod
    def of_mapping(cls, ranges: Mapping[str, tuple[float, float]]) -> Ranges:
        """Return the ranges stored in a fit."""
        return cls(ranges["frequency"], {name: span for name, span in ranges.items() if name != "frequency"})

    def beyond(self, series: TimeSeries) -> tuple[str, ...]:
        """Return one sentence for each channel of a simulation that exceeds the ranges of the tests."""
        notes = []
        for name, (low, high) in self.channels.items():
            if name not in series:
                continue
            largest, covered = float(np.abs(series[name]).max()), max(abs(low), abs(high))
            if largest > _MARGIN * covered:
                notes.append(
                    f"{name} reaches {largest:.4g} {series.unit(name)}, in the tests {covered:.4g}: extrapolated."
                )
        return (*notes, *self._beyond_frequency(series))

    def _beyond_frequency(self, series: TimeSeries) -> tuple[str, ...]:
        lines = np.fft.rfftfreq(len(series), 1.0 / series.sample_rate)
        notes = []
        for name in series.names:
            if name.rpartition(".")[2] not in ("velocity", "tire_force"):
                continue
            power = np.abs(np.fft.rfft(series[name] - series[name].mean())) ** 2
            share = float(np.sqrt(power[lines > self.frequency[1]].sum() / max(float(power.sum()), 1e-300)))
            if share > 0.1:
                part = f"{100.0 * share:.0f} % of {name} (RMS) is above {self.frequency[1]:g} Hz"
                notes.append(f"{part}, the highest fitted frequency: extrapolated.")
        return tuple(notes)


def ranges_of(tests: Sequence[TimeSeries], experiment: Experiment, frequency: tuple[float, float]) -> Ranges:
    """Return the ranges that the tests covered."""
    names = [name for name in (*experiment.forces, *experiment.outputs) if name.rpartition(".")[2] in _RANGED]
    low = {name: min(float(test[name].min()) for test in tests) for name in names}
    high = {name: max(float(test[name].max()) for test in tests) for name in names}
    return Ranges(frequency, {name: (low[name], high[name]) for name in names})


def unmodelled(
    response: FrequencyResponse, found: CommonPoleModel, tests: Sequence[TimeSeries], means: Mapping[str, float]
) -> dict[str, str]:
    """Return one sentence for each sign of an effect that is not in the model, by kind of effect.

    Args:
        response: Response that was fitted.
        found: Common-pole model.
        tests: Records of the tests, without means.
        means: Mean tire forces that the original records had [N], by channel.
    """
    sentences = {
        "misfit": _misfits(found),
        "lift-off": _lifted(tests, means),
        "unexplained": _coherence(response, found),
    }
    return {what: sentence for what, sentence in sentences.items() if sentence}


def _misfits(found: CommonPoleModel) -> str:
    worst: dict[str, float] = {}
    for name, value in found.excess.items():
        quantity = name.rpartition(".")[2]
        worst[quantity] = max(value, worst.get(quantity, 0.0))
    listed = ", ".join(f"{quantity} {value:.1f}" for quantity, value in worst.items() if value > EXCESS)
    if not listed:
        return ""
    return (
        f"The misfit is larger than noise (in standard deviations, worst of each: {listed}). Likely causes are "
        "nonlinear effects, above all stick-slip, or too few states. The reported standard deviations are increased "
        "accordingly."
    )


def _lifted(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> str:
    """Return a sentence on tires that leave the ground.

    Channels with means near zero are changes from rest and are skipped.
    """
    lifted = {
        name: min(float(test[name].min()) + mean for test in tests) / mean
        for name, mean in means.items()
        if name.rpartition(".")[2] == "tire_force" and name in tests[0] and mean > float(tests[0][name].std())
    }
    names = sorted(name for name, lowest in lifted.items() if lowest <= _LIFTED)
    if not names:
        return ""
    return (
        f"Tires leave the ground ({', '.join(names)}), which the linear model cannot represent; lower the road's peak."
    )


def _coherence(response: FrequencyResponse, found: CommonPoleModel) -> str:
    """Return a sentence on outputs that are noisy although their coherence is good: a sign of friction or springs."""
    if response.coherence is None:
        return ""
    low, high = found.band
    inside = (response.frequency >= low) & (response.frequency <= high)
    left = np.sqrt(1.0 - np.median(response.coherence[:, inside], axis=1))
    names = [
        f"{name} {100.0 * share:.0f} %"
        for name, share in zip(response.output_names, left, strict=True)
        if _NOISY < share < np.sqrt(1.0 - _FINE**2)
    ]
    if not names:
        return ""
    return (
        f"Not explained by any linear response although coherence is good: {', '.join(names)} of the output. If the "
        "sensors are less noisy than that, the cause is friction or nonlinear springs."
    )
