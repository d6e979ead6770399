"""Modes of a vehicle, and its responses beside those that it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.validation.comparison import JUDGED
from eightpost.ident.vehicle.experiment import quantity
from eightpost.vehicle import StateSpace

# ---- Modes of an identified vehicle, matched with those of another car by the modal assurance criterion -------------


@dataclass(frozen=True, slots=True)
class VehicleMode:
    """A mode and the most similar mode of another car."""

    frequency: float  #: Frequency [Hz].
    damping: float  #: Damping ratio [1].
    #: Frequency [Hz] and damping ratio of the other car's mode; None without another car.
    match: tuple[float, float] | None = None
    mac: float | None = None  #: Modal assurance criterion of the two shapes [1]: 1 if they are equal up to a factor.


def modes_of(model: StateSpace, other: StateSpace | None = None) -> tuple[VehicleMode, ...]:
    """Return the oscillating modes, slowest first, each with the mode of another car that has the most similar shape.

        MAC = |a^H b|^2 / (a^H a  b^H b)

    of shapes over the outputs that both cars have. Each output is scaled by its largest value over the model's modes,
    so that the result does not depend on units.

    Args:
        model: Identified vehicle.
        other: True car or another fit, around the same damping.

    Raises:
        ParameterError: The two cars have no output in common.

    Source: R. J. Allemang, "The modal assurance criterion - twenty years of use and abuse", Sound and Vibration 37
    (2003) 14-21.
    """
    names = model.output_names if other is None else [n for n in model.output_names if n in other.output_names]
    if not names:
        raise ParameterError(f"{model.name} has no output in common with the vehicle it is compared with")
    poles, shapes = _shapes(model, names)
    if other is None:
        return tuple(VehicleMode(*_frequency_and_damping(pole)) for pole in poles)
    other_poles, other_shapes = _shapes(other, names)
    scale = np.abs(shapes).max(axis=1, keepdims=True)
    scale[scale == 0.0] = 1.0
    mac = _assurance(shapes / scale, other_shapes / scale)
    modes = []
    for pole, row in zip(poles, mac, strict=True):
        k = int(np.argmax(row)) if row.size else -1
        match = (_frequency_and_damping(other_poles[k]), float(row[k])) if row.size else (None, None)
        modes.append(VehicleMode(*_frequency_and_damping(pole), *match))
    return tuple(modes)


def _shapes(model: StateSpace, names: list[str] | tuple[str, ...]) -> tuple[Complex, Complex]:
    """Return the oscillating poles (n,) [1/s] and their shapes at the outputs (p, n), scaled to unit length."""
    z, V = np.linalg.eig(model.A)
    poles = z if model.dt is None else np.log(z.astype(np.complex128)) / model.dt
    upper = poles.imag > 1e-9 * np.abs(poles).max(initial=0.0)
    order = np.argsort(np.abs(poles[upper]))
    rows = [model.output_names.index(name) for name in names]
    shapes = (model.C[rows] @ V[:, upper])[:, order]
    length = np.linalg.norm(shapes, axis=0)
    return np.asarray(poles[upper][order]), np.asarray(shapes / np.where(length > 0.0, length, 1.0))


def _assurance(a: Complex, b: Complex) -> Array:
    """Return the MAC of every pair of columns (n, k)."""
    across = np.abs(a.conj().T @ b) ** 2
    return np.asarray(across / np.outer(np.sum(np.abs(a) ** 2, axis=0), np.sum(np.abs(b) ** 2, axis=0)))


def _frequency_and_damping(pole: complex) -> tuple[float, float]:
    return float(abs(pole) / (2.0 * np.pi)), float(-pole.real / abs(pole))


# ---- Responses of the model and of the estimate that it was fitted to, with coherence and confidence ----------------

#: Half width of a 95 % interval, in standard deviations of a complex number's magnitude.
_WIDE = 1.96 / np.sqrt(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Response of an output to an input."""

    output: str  #: Name of the output.
    input: str  #: Name of the input.
    unit: str  #: Unit of the response.
    frequency: Array  #: Frequencies at which the input had power (K,) [Hz].
    estimate: Complex  #: Estimated response (K,).
    model: Complex  #: Response of the model (K,).
    #: 95 % confidence interval of the estimate's magnitude (2, K); None if the estimate has no variance.
    band: Array | None
    coherence: Array | None  #: Multiple coherence of the output (K,) [1]; None if it is not known.

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


def main_paths(response: FrequencyResponse, model: StateSpace, band: tuple[float, float]) -> tuple[Response, ...]:
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


def _path(estimate: FrequencyResponse, model: StateSpace, output: str, name: str) -> Response:
    one = estimate.select(inputs=[name], outputs=[output])
    H = one.H[0, 0]
    powered = np.abs(H) > 0.0
    frequency, H = one.frequency[powered], H[powered]
    modelled = model.select(inputs=[name], outputs=[output]).frequency_response(frequency)[0, 0]
    unit = f"({one.outputs[0].unit})/({one.inputs[0].unit})"
    coherence = None if one.coherence is None else one.coherence[0, powered]
    return Response(output, name, unit, frequency, H, modelled, _band(one, powered), coherence)


def _band(one: FrequencyResponse, powered: NDArray[np.bool_]) -> Array | None:
    if one.variance is None:
        return None
    size = np.abs(one.H[0, 0, powered])
    wide = _WIDE * np.sqrt(one.variance[0, 0, powered])
    if not np.isfinite(wide).all():
        return None
    return np.stack([np.maximum(size - wide, 0.0), size + wide])
