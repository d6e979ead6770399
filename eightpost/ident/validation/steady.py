"""Steady motions: sines and static loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.validation.comparison import Comparison, quantity
from eightpost.ident.vehicle.stability import holds
from eightpost.signals import TimeSeries

# ---- Sine records ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SineOutput:
    """One output of a sine record.

    Attributes:
        name: Name of the output.
        unit: SI unit.
        amplitude: Amplitude of the fundamental, measured and predicted.
        phase: Phase lead of the prediction [rad].
        harmonics: RMS of the measurement without its fundamental, over the measured RMS [1]; see 6.5.2.
    """

    name: str
    unit: str
    amplitude: tuple[float, float]
    phase: float
    harmonics: float

    @property
    def gain(self) -> float:
        """Predicted over measured amplitude [1]."""
        return self.amplitude[1] / self.amplitude[0]


def sine_output(output: Comparison, frequency: float, rate: float) -> SineOutput:
    """Return gain, phase and harmonics of an output of a sine record.

    Args:
        output: Measured and predicted output.
        frequency: Sine frequency [Hz].
        rate: Sample rate [Hz].
    """
    turns = 2.0 * np.pi * frequency * np.arange(output.measured.size) / rate
    basis = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    fitted = np.linalg.lstsq(basis, np.stack([output.measured, output.predicted], axis=1), rcond=None)[0]
    measured, predicted = (complex(a, -b) for a, b in fitted.T)
    rest = output.measured - basis @ fitted[:, 0]
    return SineOutput(
        output.name,
        output.unit,
        (abs(measured), abs(predicted)),
        float(np.angle(predicted / measured)) if predicted else 0.0,
        float(rest.std() / output.rms[0]),
    )


# ---- Static records -------------------------------------------------------------------------------------------------

#: Quantities that have a static level.
_STATIC = ("displacement", "tire_force", "ride_height")


@dataclass(frozen=True, slots=True, eq=False)
class StaticOutput:
    """One output over the holds of a static record: times of constant load.

    Attributes:
        name: Name of the output.
        unit: SI unit.
        load: Sum of all loads during each hold, minus the mean over holds (H,) [N or N.m].
        measured: Measured output during each hold, minus the mean over holds (H,).
        predicted: Predicted output during each hold, minus the mean over holds (H,).
    """

    name: str
    unit: str
    load: Array
    measured: Array
    predicted: Array

    @property
    def slopes(self) -> tuple[float, float]:
        """Least-squares change per load, measured and predicted."""
        whole = float(self.load @ self.load)
        if whole == 0.0:
            return 0.0, 0.0
        return float(self.load @ self.measured) / whole, float(self.load @ self.predicted) / whole


def static_outputs(measured: TimeSeries, predicted: TimeSeries, loads: Sequence[str]) -> tuple[StaticOutput, ...]:
    """Return the outputs during the holds; empty if the loads are never constant.

    Args:
        measured: The record.
        predicted: Outputs of the vehicle at the same times.
        loads: Names of the loads.
    """
    there = [name for name in loads if name in measured]
    if not there:
        return ()
    rows = np.stack([measured[name] for name in there])
    held = holds(rows, measured.sample_rate)
    if len(held) < 2:
        return ()
    signs = np.sign(rows @ rows[0])  # in pitch and roll some loads pull while others push
    names = [name for name in predicted.names if name in measured and quantity(name) in _STATIC]
    load = _levels(signs @ rows, held)
    return tuple(
        StaticOutput(n, measured.unit(n), load, _levels(measured[n], held), _levels(predicted[n], held)) for n in names
    )


def _levels(values: Array, held: Sequence[slice]) -> Array:
    found = np.array([values[hold].mean() for hold in held])
    return np.asarray(found - found.mean())
