"""Sine records: gain and phase of the prediction, and the share that is not sinusoidal (Figs 6.29, 6.30)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle_validation.comparison import Comparison

    Array = NDArray[np.float64]


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
