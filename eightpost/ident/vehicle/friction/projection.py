"""Friction forces from bands of spectra: the responses are eliminated, Gauss-Newton finds the forces.

    Y = (U + T diag(F) S) H + E

U are the inputs without friction, T the spectra of tanh(v / v_f) at the ports, S puts them onto the force inputs, which
are the last ones. For given F the polynomials of H are solved in every band; the slope of the residual with F is that
of Kaufman, `-P T H`, P what the band's columns cannot explain.
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


class Found(NamedTuple):
    """What came out.

    Attributes:
        forces: F (P,) [N].
        covariance: Of the forces (P, P) [N2], from the scatter of the bands' gradients.
        residual: By output, the mean square residual over that without friction (p,) [1].
    """

    forces: Array
    covariance: Array
    residual: Array

    @property
    def cost(self) -> float:
        """The mean of the residual over the outputs."""
        return float(self.residual.mean())


def found_in(parts: Sequence[Band], inputs: int, iterations: int) -> Found:
    """Find the forces.

    Args:
        parts: Bands whose inputs are the `inputs`, force inputs last, then the ports' directions.
        inputs: How many inputs there are without the directions.
        iterations: Gauss-Newton steps from no friction.
    """
    ports = parts[0].U.shape[2] - inputs
    forces = np.zeros(ports)
    noise = for_each(parts, lambda part: _Solved.of(part, inputs, forces).noise)
    for _ in range(iterations):
        slopes = _slopes(parts, noise, inputs, forces)
        matrix = np.sum([slope.matrix for slope in slopes], axis=0)
        gradients = np.stack([slope.gradient for slope in slopes])
        inverse = np.linalg.inv(matrix)
        forces = forces + inverse @ gradients.sum(axis=0)
    # At the minimum the gradients of independent bands scatter about zero.
    scatter = gradients - gradients.mean(axis=0)
    left = np.divide(for_each(parts, lambda part: _Solved.of(part, inputs, forces).noise), noise)
    return Found(forces, inverse @ (scatter.T @ scatter) @ inverse, np.mean(np.square(left), axis=0))


def _slopes(parts: Sequence[Band], noise: Sequence[Array], inputs: int, forces: Array) -> list[_Slopes]:
    weighted = zip(parts, noise, strict=True)
    return for_each(weighted, lambda pair: _Solved.of(pair[0], inputs, forces).slopes(pair[1]))


class _Slopes(NamedTuple):
    matrix: Array
    gradient: Array


class _Solved(NamedTuple):
    """A band, solved for given friction forces."""

    band: Band
    inputs: int
    active: NDArray[np.bool_]
    Q: Complex
    coefficients: Complex
    misfit: Complex

    @classmethod
    def of(cls, band: Band, inputs: int, forces: Array) -> _Solved:
        """Solve a band."""
        U = band.U[..., :inputs].copy()
        U[..., inputs - forces.size :] += band.U[..., inputs:] * forces
        # A port's friction is there wherever its force is.
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
        """The residual's RMS per free equation (p,)."""
        free = max(len(self.misfit) - self.Q.shape[1], 1)
        return np.asarray(np.sqrt(np.sum(np.abs(self.misfit) ** 2, axis=0) / free))

    def slopes(self, noise: Array) -> _Slopes:
        """Return curvature (P, P) and gradient (P,) of half the weighted residual, with F growing downhill."""
        ports = self.band.U.shape[2] - self.inputs
        explained = np.stack([self._explained(port, ports) / noise for port in range(ports)])
        flat = explained.reshape(ports, -1)
        misfit = (self.misfit / noise).reshape(-1)
        return _Slopes(np.real(flat.conj() @ flat.T), np.real(flat.conj() @ misfit))

    def _explained(self, port: int, ports: int) -> Complex:
        """Return what a unit of friction at a port adds to the outputs (rows, p) that the columns cannot explain."""
        place = self.inputs - ports + port
        if not self.active[place]:
            return np.zeros_like(self.misfit)
        own, count = int(self.active[:place].sum()), int(self.active.sum())
        columns = self.band.columns(self.band.U[..., [self.inputs + port]])
        answer = columns @ self.coefficients[own::count][: columns.shape[1]]
        return np.asarray(answer - self.Q @ (self.Q.conj().T @ answer))
