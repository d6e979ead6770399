"""Sine records: gain and phase of the prediction, and what of the measurement is no sine (Figs 6.29, 6.30)."""

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
        name: Of the output.
        unit: SI.
        amplitude: Of the fundamental, measured and predicted.
        phase: By how much the prediction leads [rad].
        harmonics: RMS of what is not the fundamental over the measured RMS [1]: 6.5.2's harmonics of tire force.
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


def sine_output(found: Comparison, frequency: float, rate: float) -> SineOutput:
    """Return how an output of a sine record is predicted.

    Args:
        found: The output.
        frequency: Of the sine [Hz].
        rate: Samples per second [Hz].
    """
    turns = 2.0 * np.pi * frequency * np.arange(found.measured.size) / rate
    basis = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    fitted = np.linalg.lstsq(basis, np.stack([found.measured, found.predicted], axis=1), rcond=None)[0]
    measured, predicted = (complex(a, -b) for a, b in fitted.T)
    left = found.measured - basis @ fitted[:, 0]
    return SineOutput(
        found.name,
        found.unit,
        (abs(measured), abs(predicted)),
        float(np.angle(predicted / measured)) if predicted else 0.0,
        float(left.std() / found.rms[0]),
    )
