"""Responses of the model and of the estimate that it was fitted to, with coherence and confidence interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.vehicle_validation.comparison import JUDGED, quantity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse
    from eightpost.vehicle import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Half width of a 95 % interval, in standard deviations of a complex number's magnitude.
_WIDE = 1.96 / np.sqrt(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Response of an output to an input.

    Attributes:
        output: Name of the output.
        input: Name of the input.
        unit: Unit of the response.
        frequency: Frequencies at which the input had power (K,) [Hz].
        estimate: Estimated response (K,).
        model: Response of the model (K,).
        band: 95 % confidence interval of the estimate's magnitude (2, K); None if the estimate has no variance.
        coherence: Multiple coherence of the output (K,) [1]; None if it is not known.
    """

    output: str
    input: str
    unit: str
    frequency: Array
    estimate: Complex
    model: Complex
    band: Array | None
    coherence: Array | None

    @property
    def misfit(self) -> float:
        """RMS of model minus estimate, over the RMS of the estimate [1]."""
        return float(np.sqrt(np.sum(np.abs(self.model - self.estimate) ** 2) / np.sum(np.abs(self.estimate) ** 2)))

    @property
    def inside(self) -> float | None:
        """Fraction of frequencies at which the model's magnitude is inside the band [1]; None without a band."""
        if self.band is None:
            return None
        size = np.abs(self.model)
        return float(np.mean((size >= self.band[0]) & (size <= self.band[1])))


def main_paths(response: FrequencyResponse, model: StateSpace, band: tuple[float, float]) -> tuple[Path, ...]:
    """Return the strongest response of every judged quantity's outputs to a road and to a shock force.

    Args:
        response: Estimate that the model was fitted to.
        model: Identified model, around the same damping.
        band: Frequency range of the fit [Hz].
    """
    low, high = max(band[0], float(response.frequency[0])), min(band[1], float(response.frequency[-1]))
    estimate = response.band(low, high)
    outputs = [n for n in estimate.output_names if quantity(n) in JUDGED and n in model.output_names]
    found = []
    for output in outputs:
        for kind in ("road", "force"):
            inputs = [n for n in estimate.input_names if quantity(n) == kind and n in model.input_names]
            if strongest := _strongest(estimate, output, inputs):
                found.append(_path(estimate, model, output, strongest))
    return tuple(found)


def _strongest(estimate: FrequencyResponse, output: str, inputs: list[str]) -> str | None:
    sizes = {name: float(np.sum(np.abs(estimate.between(output, name)) ** 2)) for name in inputs}
    best = max(sizes, key=lambda name: sizes[name], default=None)
    return best if best is not None and sizes[best] > 0.0 else None


def _path(estimate: FrequencyResponse, model: StateSpace, output: str, name: str) -> Path:
    one = estimate.select(inputs=[name], outputs=[output])
    H = one.H[0, 0]
    powered = np.abs(H) > 0.0
    frequency, H = one.frequency[powered], H[powered]
    modelled = model.select(inputs=[name], outputs=[output]).frequency_response(frequency)[0, 0]
    unit = f"({one.outputs[0].unit})/({one.inputs[0].unit})"
    coherence = None if one.coherence is None else one.coherence[0, powered]
    return Path(output, name, unit, frequency, H, modelled, _band(one, powered), coherence)


def _band(one: FrequencyResponse, powered: NDArray[np.bool_]) -> Array | None:
    if one.variance is None:
        return None
    size = np.abs(one.H[0, 0, powered])
    wide = _WIDE * np.sqrt(one.variance[0, 0, powered])
    if not np.isfinite(wide).all():
        return None
    return np.stack([np.maximum(size - wide, 0.0), size + wide])
