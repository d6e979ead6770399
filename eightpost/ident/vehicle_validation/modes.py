"""Modes of an identified vehicle, matched with those of another car by the modal assurance criterion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.vehicle import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class VehicleMode:
    """A mode and the most similar mode of another car.

    Attributes:
        frequency: Frequency [Hz].
        damping: Damping ratio [1].
        match: Frequency [Hz] and damping ratio of the other car's mode; None without another car.
        mac: Modal assurance criterion of the two shapes [1]: 1 if they are equal up to a factor.
    """

    frequency: float
    damping: float
    match: tuple[float, float] | None = None
    mac: float | None = None


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
