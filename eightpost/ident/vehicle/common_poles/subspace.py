"""Poles and mode shapes from a response in one step: frequency-domain subspace identification.

The bilinear map `z = (alpha + s) / (alpha - s)` takes the frequencies to the unit circle, where powers are well
conditioned, and a rational response to one of the same order: the way back is exact. For every input j and frequency k
the column [H_j; z H_j; ... z^(q-1) H_j] is the extended observability matrix times the state, plus powers of z times
direct terms. What is left of the columns when those powers are projected out has the observability matrix' range.

An input without power at a frequency gives no column there: nothing is filled in.

Source: T. McKelvey, H. Akcay, L. Ljung, "Subspace-based multivariable system identification from frequency response
data", IEEE Trans. Automatic Control 41 (1996) 960-979, doi 10.1109/9.508900 (algorithm 2, any frequencies).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import TooShortError
from eightpost.ident.vehicle.common_poles.realisation import Blocks, blocks_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle.common_poles.points import Points

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Where the bilinear map puts a right angle, as a part of the highest frequency.
_MIDDLE = 0.25

#: Real poles this close to the ends of the band's map stand for none: nearer they are rounding.
_FASTEST = 1e3


@dataclass(frozen=True, slots=True, eq=False)
class Subspace:
    """The range of the observability matrix, from which models of any order are read.

    Attributes:
        vectors: Left singular vectors (q p, r).
        values: Singular values (r,).
        outputs: p.
        alpha: Of the bilinear map [1/s].
    """

    vectors: Array
    values: Array
    outputs: int
    alpha: float

    def poles(self, order: int) -> tuple[Complex, Complex, int]:
        """Return poles (order,) [1/s], mode shapes (p, order), and how many poles were mirrored to be stable."""
        O = self.vectors[:, :order] * np.sqrt(self.values[:order])  # noqa: E741  the symbol of the literature
        A = np.linalg.lstsq(O[: -self.outputs], O[self.outputs :], rcond=None)[0]
        z, V = np.linalg.eig(A)
        shapes = O[: self.outputs] @ V / (1.0 + z)
        s = _within(np.asarray(self.alpha * (z - 1.0) / (z + 1.0), dtype=np.complex128), self.alpha)
        unstable = s.real >= 0.0
        return np.where(unstable, -s.conj(), s), shapes, int(unstable.sum())

    def blocks(self, order: int) -> tuple[Blocks, Array, int]:
        """Return the poles as blocks without inputs, their outputs (p, order), and how many poles were mirrored."""
        poles, shapes, mirrored = self.poles(order)
        return *blocks_of(poles, shapes), mirrored


def subspace_of(points: Points, *, most_states: int, block_rows: int | None = None) -> Subspace:
    """Return the subspace of a response.

    Args:
        points: The response.
        most_states: The highest order that will be asked for.
        block_rows: q; None takes twice as many as `most_states` needs, 8 at least.

    Raises:
        TooShortError: Too few values for so many states.
    """
    p = len(points.H)
    q = block_rows or max(8, 2 * (-(-most_states // p) + 1))
    alpha = _MIDDLE * float(np.abs(points.s).max())
    columns = [_columns(points, j, q, alpha) for j in range(points.H.shape[1])]
    stacked = np.concatenate(columns, axis=1)
    if stacked.shape[1] < most_states + q:
        raise TooShortError(f"{stacked.shape[1] // 2} known response values cannot carry {most_states} states")
    vectors, values, _ = np.linalg.svd(np.linalg.qr(stacked.T)[1].T, full_matrices=False)
    sizes = np.tile(_row_sizes(points), q)
    return Subspace(vectors * sizes[:, None], values, p, alpha)


def _row_sizes(points: Points) -> Array:
    """Return a typical deviation of each output (p,): the same at all frequencies, or the shift would not hold."""
    return np.array([np.median(row[np.isfinite(row)]) for row in points.deviation])


def _columns(points: Points, j: int, q: int, alpha: float) -> Array:
    """Return the columns (q p, 2 K') of one input, whitened, what its direct terms explain taken out."""
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
    """Return poles (n,) with those at infinity or zero, which are real, moved to the ends of what can be told."""
    size = np.abs(s)
    limited = np.clip(size, alpha / _FASTEST, alpha * _FASTEST)
    return np.asarray(np.where(size > 0.0, s * (limited / np.where(size > 0.0, size, 1.0)), -limited))
