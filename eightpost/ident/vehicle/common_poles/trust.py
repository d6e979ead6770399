"""How far an identified car is to be trusted: what its tests covered, and what no linear car with friction explains."""

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

#: A misfit of so many deviations of the estimate is no noise [1].
EXCESS = 1.5

#: What an output's own noise may reach of it where its coherence is fine [1].
_NOISY, _FINE = 0.05, 0.95

#: A channel may go this much beyond the tests.
_MARGIN = 1.1

#: A tire at this part of its mean load or less has lifted.
_LIFTED = 0.01

_RANGED = ("velocity", "displacement", "force", "tire_force")


@dataclass(frozen=True, slots=True)
class Ranges:
    """What the tests covered.

    Attributes:
        frequency: Of the fit [Hz].
        channels: Smallest and largest value by channel, SI.
    """

    frequency: tuple[float, float]
    channels: Mapping[str, tuple[float, float]]

    def as_mapping(self) -> dict[str, tuple[float, float]]:
        """Return the ranges by channel, and that of the frequency, as a fit keeps them."""
        return {"frequency": self.frequency, **self.channels}

    @classmethod
    def of_mapping(cls, ranges: Mapping[str, tuple[float, float]]) -> Ranges:
        """Return what a fit kept."""
        return cls(ranges["frequency"], {name: span for name, span in ranges.items() if name != "frequency"})

    def beyond(self, series: TimeSeries) -> tuple[str, ...]:
        """Return where a simulation left what the tests covered, a sentence each."""
        notes = []
        for name, (low, high) in self.channels.items():
            if name not in series:
                continue
            largest, covered = float(np.abs(series[name]).max()), max(abs(low), abs(high))
            if largest > _MARGIN * covered:
                notes.append(
                    f"{name} reaches {largest:.4g} {series.unit(name)}, the tests reached {covered:.4g}: extrapolated."
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
                part = f"{100.0 * share:.0f} % of {name} (RMS) lies above {self.frequency[1]:g} Hz"
                notes.append(f"{part}, where the model was not fitted: extrapolated.")
        return tuple(notes)


def ranges_of(tests: Sequence[TimeSeries], experiment: Experiment, frequency: tuple[float, float]) -> Ranges:
    """Return what the tests covered."""
    names = [name for name in (*experiment.forces, *experiment.outputs) if name.rpartition(".")[2] in _RANGED]
    low = {name: min(float(test[name].min()) for test in tests) for name in names}
    high = {name: max(float(test[name].max()) for test in tests) for name in names}
    return Ranges(frequency, {name: (low[name], high[name]) for name in names})


def unmodelled(
    response: FrequencyResponse, found: CommonPoleModel, tests: Sequence[TimeSeries], means: Mapping[str, float]
) -> dict[str, str]:
    """Return what hints at something that is not in the model, a sentence each, by what it is.

    Args:
        response: What was fitted.
        found: The model.
        tests: The records, without means.
        means: Of the tire forces, where the records had some [N].
    """
    said = {"misfit": _misfits(found), "lift-off": _lifted(tests, means), "unexplained": _coherence(response, found)}
    return {what: sentence for what, sentence in said.items() if sentence}


def _misfits(found: CommonPoleModel) -> str:
    worst: dict[str, float] = {}
    for name, value in found.excess.items():
        quantity = name.rpartition(".")[2]
        worst[quantity] = max(value, worst.get(quantity, 0.0))
    listed = ", ".join(f"{quantity} {value:.1f}" for quantity, value in worst.items() if value > EXCESS)
    if not listed:
        return ""
    return (
        f"The misfit is more than noise (in deviations, worst of each: {listed}): what is not linear, friction that "
        "sticks above all, or states that are missing. Deviations of responses and measures are raised by it."
    )


def _lifted(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> str:
    """Say which tires leave the ground; means near zero are changes from rest, which cannot say it."""
    lifted = {
        name: min(float(test[name].min()) + mean for test in tests) / mean
        for name, mean in means.items()
        if name.rpartition(".")[2] == "tire_force" and name in tests[0] and mean > float(tests[0][name].std())
    }
    names = sorted(name for name, least in lifted.items() if least <= _LIFTED)
    if not names:
        return ""
    return f"Tires leave the ground ({', '.join(names)}): no linear car does; lower the road's peak."


def _coherence(response: FrequencyResponse, found: CommonPoleModel) -> str:
    """Say it where outputs are noisy though coherent: friction and springs do that and coherence hides it."""
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
        f"Not explained by any linear response, though coherence is fine: {', '.join(names)} of the output; where the "
        "sensors are better than that, friction or springs are at work."
    )
