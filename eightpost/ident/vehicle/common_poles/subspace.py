"""Frequency-domain subspace identification: poles and mode shapes from a response without iteration.

The bilinear map `z = (alpha + s) / (alpha - s)` maps the frequencies to the unit circle, where powers are well
conditioned, and a rational response to one of the same order; the inverse map is exact. For every input j and frequency
k the column [H_j; z H_j; ... z^(q-1) H_j] is the extended observability matrix times the state, plus powers of z times
direct terms. When these powers are projected out, the remaining columns span the range of the observability matrix.

Inputs without power at a frequency have no column there; missing values are not replaced.

Source: T. McKelvey, H. Akcay, L. Ljung, "Subspace-based multivariable system identification from frequency response
data", IEEE Trans. Automatic Control 41 (1996) 960-979, doi 10.1109/9.508900 (algorithm 2, any frequencies).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.errors import TooShortError
from eightpost.ident.vehicle.common_poles.points import Blocks, Points, blocks_of

#: Frequency that the bilinear map takes to a right angle, relative to the highest frequency [1].
_MIDDLE = 0.25

#: Limit of the ratio of a pole to alpha and of alpha to a pole [1]; poles beyond it are rounding errors.
_FASTEST = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Subspace:
    """Range of the observability matrix, which gives models of any order."""

    vectors: Array  #: Left singular vectors (q p, r).
    values: Array  #: Singular values (r,).
    outputs: int  #: Number of outputs p.
    alpha: float  #: Parameter of the bilinear map [1/s].

    def poles(self, order: int) -> tuple[Complex, Complex, int]:
        """Return poles [1/s] (order,), mode shapes (p, order), and the number of unstable poles that were mirrored."""
        O = self.vectors[:, :order] * np.sqrt(self.values[:order])  # noqa: E741  the symbol of the literature
        A = np.linalg.lstsq(O[: -self.outputs], O[self.outputs :], rcond=None)[0]
        z, V = np.linalg.eig(A)
        shapes = O[: self.outputs] @ V / (1.0 + z)
        s = _within(np.asarray(self.alpha * (z - 1.0) / (z + 1.0), dtype=np.complex128), self.alpha)
        unstable = s.real >= 0.0
        return np.where(unstable, -s.conj(), s), shapes, int(unstable.sum())

    def blocks(self, order: int) -> tuple[Blocks, Array, int]:
        """Return blocks without inputs, their output matrix (p, order), and the number of mirrored poles."""
        poles, shapes, mirrored = self.poles(order)
        return *blocks_of(poles, shapes), mirrored


def subspace_of(points: Points, *, max_states: int) -> Subspace:
    """Return the subspace of a response.

    Args:
        points: Response values.
        max_states: Highest order that will be requested.

    Raises:
        TooShortError: The response has too few values for the number of states.
    """
    p = len(points.H)
    q = max(8, 2 * (-(-max_states // p) + 1))  # block rows: twice as many as needed, at least 8
    alpha = _MIDDLE * float(np.abs(points.s).max())
    columns = [_columns(points, j, q, alpha) for j in range(points.H.shape[1])]
    stacked = np.concatenate(columns, axis=1)
    if stacked.shape[1] < max_states + q:
        raise TooShortError(f"{stacked.shape[1] // 2} known response values are too few for {max_states} states")
    vectors, values, _ = np.linalg.svd(np.linalg.qr(stacked.T)[1].T, full_matrices=False)
    sizes = np.tile(_row_sizes(points), q)
    return Subspace(vectors * sizes[:, None], values, p, alpha)


def _row_sizes(points: Points) -> Array:
    """Return a typical standard deviation of each output (p,).

    It is the same at all frequencies, which the shift structure of the subspace requires.
    """
    return np.array([np.median(row[np.isfinite(row)]) for row in points.deviation])


def _columns(points: Points, j: int, q: int, alpha: float) -> Array:
    """Return the whitened columns (q p, 2 K') of one input with its direct terms projected out."""
    known = points.known[:, j].all(axis=0)
    s, sizes = points.s[known], _row_sizes(points)
    spread = np.sqrt(np.mean((points.deviation[:, j][:, known] / sizes[:, None]) ** 2, axis=0))
    powers = ((alpha + s) / (alpha - s))[None, :] ** np.arange(q)[:, None] / spread
    H = points.H[:, j][:, known] / sizes[:, None]
    Y = (powers[:, None, :] * H[None]).reshape(q * len(H), -1)
    Q = np.linalg.qr(_real(powers).T)[0]
    real = _real(Y)
    return np.asarray(real - (real @ Q) @ Q.T)


def _real(values: Complex) -> Array:
    return np.concatenate((values.real, values.imag), axis=-1)


def _within(s: Complex, alpha: float) -> Complex:
    """Return poles (n,) with those near infinity or zero, which are real, limited to the resolvable range."""
    size = np.abs(s)
    limited = np.clip(size, alpha / _FASTEST, alpha * _FASTEST)
    return np.asarray(np.where(size > 0.0, s * (limited / np.where(size > 0.0, size, 1.0)), -limited))
