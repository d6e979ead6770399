"""Transfer functions with one input and one output in parallel modal form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError
from eightpost.vehicle.statespace import Channel, Mode, StateSpace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """`H(s) = d + sum_i r_i / (s - p_i)`, or the same in z.

    The coefficients of a direct form of order eight overflow at 500 Hz; those of this form are never large.

    Attributes:
        poles: Poles p [1/s], or in z if discrete (n,); complex ones in conjugate pairs.
        residues: Residues r (n,), in the same conjugate pairs.
        direct: Direct term d.
        dt: Sample time [s], or None for a continuous transfer function.
    """

    poles: Complex
    residues: Complex
    direct: float
    dt: float | None = None

    def __post_init__(self) -> None:
        """Check that there is one residue per pole."""
        if self.poles.shape != self.residues.shape or self.poles.ndim != 1:
            raise ParameterError(
                f"poles have shape {self.poles.shape}, residues {self.residues.shape}; give one residue per pole"
            )

    @property
    def order(self) -> int:
        """Number of poles."""
        return int(self.poles.size)

    def frequency_response(self, frequency_hz: ArrayLike) -> Complex:
        """Return H (K,) at frequencies (K,) [Hz]."""
        points = plane_points(np.asarray(frequency_hz, dtype=np.float64), self.dt)
        parts = self.residues[:, None] / (points[None, :] - self.poles[:, None])
        return np.asarray(self.direct + parts.sum(axis=0), dtype=np.complex128)

    def modes(self) -> tuple[Mode, ...]:
        """Return the natural frequency and damping ratio of every pole pair and real pole, slowest first."""
        A, B, C, D = self.sections()
        return StateSpace(A, B, C, D, (Channel("input", "1"),), (Channel("output", "1"),), self.dt).modes()

    def sections(self) -> tuple[Array, Array, Array, Array]:
        """Return A (n, n), B (n, 1), C (1, n), D (1, 1) of parallel real first- and second-order sections."""
        n = self.order
        A, B, C = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((1, n))
        at = 0
        for pole, residue in zip(self.poles, self.residues, strict=True):
            if pole.imag < 0.0:
                continue
            if pole.imag == 0.0:
                A[at, at], B[at, 0], C[0, at] = pole.real, 1.0, residue.real
                at += 1
                continue
            A[at : at + 2, at : at + 2] = [[pole.real, -pole.imag], [pole.imag, pole.real]]
            B[at, 0], C[0, at : at + 2] = 1.0, (2.0 * residue.real, -2.0 * residue.imag)
            at += 2
        return A, B, C, np.array([[self.direct]])


def plane_points(frequency: Array, dt: float | None) -> Complex:
    """Return s = 2 pi j f, or z = exp(2 pi j f dt)."""
    s = 2j * np.pi * frequency
    return np.asarray(s if dt is None else np.exp(s * dt), dtype=np.complex128)
