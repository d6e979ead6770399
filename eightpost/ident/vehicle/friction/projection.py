"""Friction forces from bands of spectra: responses are eliminated, and Gauss-Newton finds the forces.

    Y = (U + T diag(F) S) H + E

U are the inputs without friction and T the spectra of tanh(v / v_f) at the ports; S adds them to the force inputs,
which are the last ones. For given F the polynomials of H are solved in every band. The derivative of the residual by F
is that of Kaufman, `-P T H`, where P projects onto the complement of the band's columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.threads import for_each

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle.friction.bands import Band

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


class ForceSolution(NamedTuple):
    """Estimated forces at the ports.

    Attributes:
        forces: Forces F [N] (P,).
        covariance: Covariance of the forces [N2] (P, P), from the scatter of the bands' gradients.
        residual: Mean square residual of each output relative to that without the forces [1] (p,).
    """

    forces: Array
    covariance: Array
    residual: Array

    @property
    def cost(self) -> float:
        """Mean of the residual over the outputs."""
        return float(self.residual.mean())


def solve_forces(parts: Sequence[Band], inputs: int, iterations: int) -> ForceSolution:
    """Estimate the forces at the ports.

    Args:
        parts: Bands with `inputs` inputs, force inputs last, followed by the signal of a unit force at each port.
        inputs: Number of inputs without the signals of unit forces.
        iterations: Number of Gauss-Newton steps, starting from zero forces.
    """
    ports = parts[0].U.shape[2] - inputs
    forces = np.zeros(ports)
    noise = for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise)
    for _ in range(iterations):
        slopes = _slopes(parts, noise, inputs, forces)
        matrix = np.sum([slope.matrix for slope in slopes], axis=0)
        gradients = np.stack([slope.gradient for slope in slopes])
        inverse = np.linalg.inv(matrix)
        forces = forces + inverse @ gradients.sum(axis=0)
    # At the minimum the gradients of independent bands scatter around zero.
    scatter = gradients - gradients.mean(axis=0)
    left = np.divide(for_each(parts, lambda part: _BandFit.of(part, inputs, forces).noise), noise)
    return ForceSolution(forces, inverse @ (scatter.T @ scatter) @ inverse, np.mean(np.square(left), axis=0))


def _slopes(parts: Sequence[Band], noise: Sequence[Array], inputs: int, forces: Array) -> list[_Slopes]:
    weighted = zip(parts, noise, strict=True)
    return for_each(weighted, lambda pair: _BandFit.of(pair[0], inputs, forces).slopes(pair[1]))


class _Slopes(NamedTuple):
    matrix: Array
    gradient: Array


class _BandFit(NamedTuple):
    """Least-squares fit of a band for given forces at the ports."""

    band: Band
    inputs: int
    active: NDArray[np.bool_]
    Q: Complex
    coefficients: Complex
    misfit: Complex

    @classmethod
    def of(cls, band: Band, inputs: int, forces: Array) -> _BandFit:
        """Fit a band."""
        U = band.U[..., :inputs].copy()
        U[..., inputs - forces.size :] += band.U[..., inputs:] * forces
        # The force at a port is active in the same bands as the force input.
        active = band.active[:inputs]
        matrix = np.concatenate((band.columns(U[..., active]), band.transients()), axis=1)
        size = np.linalg.norm(matrix, axis=0)
        size[size == 0.0] = 1.0
        Q, R = np.linalg.qr(matrix / size)
        Y = band.Y.reshape(len(matrix), -1)
        share = Q.conj().T @ Y
        coefficients = np.linalg.lstsq(R, share, rcond=1e-13)[0] / size[:, None]
        return cls(band, inputs, active, Q, coefficients, Y - Q @ share)

    @property
    def noise(self) -> Array:
        """RMS of the residual per degree of freedom (p,)."""
        free = max(len(self.misfit) - self.Q.shape[1], 1)
        return np.asarray(np.sqrt(np.sum(np.abs(self.misfit) ** 2, axis=0) / free))

    def slopes(self, noise: Array) -> _Slopes:
        """Return the curvature (P, P) and the negative gradient (P,) of half the weighted residual by F."""
        ports = self.band.U.shape[2] - self.inputs
        explained = np.stack([self._explained(port, ports) / noise for port in range(ports)])
        flat = explained.reshape(ports, -1)
        misfit = (self.misfit / noise).reshape(-1)
        return _Slopes(np.real(flat.conj() @ flat.T), np.real(flat.conj() @ misfit))

    def _explained(self, port: int, ports: int) -> Complex:
        """Return the effect of a unit force at a port on the outputs (rows, p) that the columns cannot explain."""
        place = self.inputs - ports + port
        if not self.active[place]:
            return np.zeros_like(self.misfit)
        own, count = int(self.active[:place].sum()), int(self.active.sum())
        columns = self.band.columns(self.band.U[..., [self.inputs + port]])
        answer = columns @ self.coefficients[own::count][: columns.shape[1]]
        return np.asarray(answer - self.Q @ (self.Q.conj().T @ answer))
