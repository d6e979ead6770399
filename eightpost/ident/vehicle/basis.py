"""Polynomials that are orthonormal on the points of a fit, so that high orders remain well conditioned.

Powers of s are too ill conditioned above order six or so. The Arnoldi iteration for multiplication by s gives
polynomials p_0, p_1, ... with real coefficients, orthonormal in `Re sum_k w_k conj(p_i(s_k)) p_j(s_k)`, and a
Hessenberg matrix with

    s p_k = sum_{i <= k + 1} h_ik p_i

This relation evaluates the polynomials at any point and gives the zeros of any combination as eigenvalues.

Source: P. D. Brubeck, Y. Nakatsukasa, L. N. Trefethen, "Vandermonde with Arnoldi", SIAM Review 63 (2021) 405-415, doi
10.1137/19M130100X.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class PolynomialBasis:
    """Real polynomials of degree 0 to n.

    Attributes:
        hessenberg: Hessenberg matrix (n + 1, n).
        first: Constant polynomial p_0.
    """

    hessenberg: Array
    first: float

    def values(self, points: Complex) -> Complex:
        """Return p_0 ... p_n (K, n + 1) at complex points (K,)."""
        n = self.hessenberg.shape[1]
        values = np.empty((points.size, n + 1), dtype=np.complex128)
        values[:, 0] = self.first
        for k in range(n):
            column = self.hessenberg[: k + 2, k]
            values[:, k + 1] = (points * values[:, k] - values[:, : k + 1] @ column[:-1]) / column[-1]
        return values

    def roots(self, coefficients: Array) -> Complex:
        """Return the zeros of `sum_k c_k p_k` (degree,); leading coefficients that are zero are ignored."""
        n = coefficients.size - 1
        while n > 0 and coefficients[n] == 0.0:
            n -= 1
        if n < 1:
            return np.empty(0, dtype=np.complex128)
        companion = self.hessenberg[:n, :n].copy()
        companion[:, -1] -= (self.hessenberg[n, n - 1] / coefficients[n]) * coefficients[:n]
        return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)

    def leading(self, coefficients: Array) -> float:
        """Return the coefficient of the highest power of s."""
        n = coefficients.size - 1
        return float(coefficients[-1] * self.first / np.prod(np.diag(self.hessenberg, -1)[:n]))


def orthonormal_basis(points: Complex, weight: Array, degree: int) -> PolynomialBasis:
    """Return polynomials of degree 0 to `degree`, orthonormal on `points` (K,) with a nonnegative `weight` (K,)."""
    root = np.sqrt(weight / weight.sum())
    Q = np.zeros((points.size, degree + 1), dtype=np.complex128)
    hessenberg = np.zeros((degree + 1, degree))
    Q[:, 0] = 1.0
    for k in range(degree):
        moved = points * Q[:, k]
        for _ in range(2):  # the second pass removes rounding errors
            share = np.real((root[:, None] * Q[:, : k + 1]).conj().T @ (root * moved))
            moved -= Q[:, : k + 1] @ share
            hessenberg[: k + 1, k] += share
        hessenberg[k + 1, k] = np.linalg.norm(root * moved)
        Q[:, k + 1] = moved / hessenberg[k + 1, k]
    return PolynomialBasis(hessenberg, 1.0)
