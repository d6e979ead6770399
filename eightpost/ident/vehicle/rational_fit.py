"""Rational functions fitted to frequency responses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError, TooShortError
from eightpost.vehicle.statespace import Channel, Mode, StateSpace

# ---- Polynomials that are orthonormal on the points of a fit, so that high orders remain well conditioned -----------


@dataclass(frozen=True, slots=True, eq=False)
class _PolynomialBasis:
    """Real polynomials of degree 0 to n."""

    hessenberg: Array  #: Hessenberg matrix (n + 1, n).
    first: float  #: Constant polynomial p_0.

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


def _orthonormal_basis(points: Complex, weight: Array, degree: int) -> _PolynomialBasis:
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
    return _PolynomialBasis(hessenberg, 1.0)


# ---- Weights of fits over frequency (4.4.1, 5.3.3, Eq 6.9) ----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class BandWeights:
    """One weight per frequency band, zero elsewhere."""

    #: Tuples (low, high, weight) [Hz, Hz, 1]; a band includes its lower limit but not its upper.
    bands: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        """Check the bands."""
        for low, high, weight in self.bands:
            if not (0.0 <= low < high and weight >= 0.0):
                raise ParameterError(f"the band ({low:g}, {high:g}, {weight:g}) needs 0 <= low < high and weight >= 0")

    def at(self, frequency: Array) -> Array:
        """Return the weights (K,) at frequencies (K,) [Hz]."""
        weights = np.zeros_like(frequency)
        for low, high, weight in self.bands:
            weights[(frequency >= low) & (frequency < high)] = weight
        return weights


#: 4.4.1, quarter car: 1 below 20 Hz.
QUARTER_CAR = BandWeights(((0.0, 20.0, 1.0),))
#: 5.3.3, seven-DOF car.
SEVEN_DOF = BandWeights(((0.5, 10.0, 1.0), (10.0, 20.0, 0.5)))
#: Eq 6.9, aeroloaders.
AEROLOADERS = BandWeights(((0.1, 5.0, 1.0), (5.0, 7.0, 0.5), (7.0, 12.0, 0.1)))
#: Eq 6.9, wheelloaders and shock forces.
WHEELLOADERS = BandWeights(((0.5, 10.0, 1.0), (10.0, 15.0, 0.5), (15.0, 20.0, 0.1)))


# ---- Transfer functions with one input and one output in parallel modal form ----------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """`H(s) = d + sum_i r_i / (s - p_i)`.

    The coefficients of a direct form of order eight overflow at 500 Hz; those of this form are never large.
    """

    poles: Complex  #: Poles p (n,) [1/s]; complex ones in conjugate pairs.
    residues: Complex  #: Residues r (n,), in the same conjugate pairs.
    direct: float  #: Direct term d.

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
        points = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        parts = self.residues[:, None] / (points[None, :] - self.poles[:, None])
        return np.asarray(self.direct + parts.sum(axis=0), dtype=np.complex128)

    def modes(self) -> tuple[Mode, ...]:
        """Return the natural frequency and damping ratio of every pole pair and real pole, slowest first."""
        A, B, C, D = self.sections()
        return StateSpace(A, B, C, D, (Channel("input", "1"),), (Channel("output", "1"),)).modes()

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


# ---- Rational fits of one frequency response, like MATLAB's invfreqs (4.3.3, 5.2.3) ---------------------------------

_REWEIGHTINGS = 10
_HALVINGS = 12
#: Relative reduction of the cost by a step below which the search ends [1]; it is far below the effect of noise.
_CONVERGED = 1e-6


@dataclass(frozen=True, slots=True)
class RationalFit:
    """Settings of a fit by a stable rational function B / A.

    Eq 4.28 (equation error) is solved first, then repeatedly with the weights divided by |A|^2 of the previous solution
    (Sanathanan and Koerner), which leads close to the minimum of Eq 4.29 (output error). Gauss-Newton steps then find
    the minimum. Unstable poles are mirrored, and steps that would make a pole unstable are shortened.
    """

    denominator: int  #: Degree of A.
    numerator: int  #: Degree of B: that of A with a direct term, one less without.
    #: Maximum number of Gauss-Newton steps; 0 returns the best of the reweighted equation-error solutions.
    iterations: int = 30

    def __post_init__(self) -> None:
        """Check the degrees."""
        if not 0 <= self.numerator <= self.denominator or self.denominator < 1:
            raise ParameterError(
                f"a numerator of degree {self.numerator} over a denominator of degree {self.denominator} cannot be "
                "simulated; give degrees with 0 <= numerator <= denominator"
            )

    def fit(self, frequency: Array, H: Complex, weight: Array) -> TransferFunction:
        """Fit a response.

        Args:
            frequency: Frequencies [Hz] (K,).
            H: Response (K,).
            weight: Weight w of Eq 4.28 (K,), zero where the response is not fitted.

        Raises:
            TooShortError: There are too few frequencies with weight for the number of coefficients.
        """
        used = (weight > 0.0) & (frequency > 0.0)
        count = self.denominator + self.numerator + 1
        if 2 * int(used.sum()) < count:
            raise TooShortError(f"{int(used.sum())} frequencies with weight are too few for {count} coefficients")
        points: Complex = np.asarray(2j * np.pi * frequency[used], dtype=np.complex128)
        scale = float(np.abs(points).max())
        basis = _orthonormal_basis(points / scale, weight[used], self.denominator)
        problem = _Problem(basis, basis.values(points / scale), H[used], np.sqrt(weight[used]), self)
        return _modal(basis, problem.solve(), scale)


class _Ratio(NamedTuple):
    """Coefficients of B and A in the basis; the last coefficient of `a` is 1."""

    b: Array
    a: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    basis: _PolynomialBasis
    P: Complex
    H: Complex
    root: Array
    recipe: RationalFit

    def solve(self) -> _Ratio:
        """Return the coefficients of the best fit."""
        found = self._reweighted()
        costs = [self.cost(ratio) for ratio in found]
        best = int(np.argmin(costs))
        ratio, cost = found[best], costs[best]
        for _ in range(self.recipe.iterations):
            following, reached = self._improved(ratio, cost)
            if reached >= cost * (1.0 - _CONVERGED):
                break
            ratio, cost = following, reached
        return ratio

    def cost(self, ratio: _Ratio) -> float:
        """Return the output error (Eq 4.29)."""
        return float(np.sum(np.abs(self._misfit(ratio)) ** 2))

    def _misfit(self, ratio: _Ratio) -> Complex:
        with np.errstate(all="ignore"):
            misfit = self.root * (self.H - (self.P[:, : ratio.b.size] @ ratio.b) / (self.P @ ratio.a))
        return np.asarray(np.where(np.isfinite(misfit), misfit, np.inf), dtype=np.complex128)

    def _reweighted(self) -> list[_Ratio]:
        """Return stable equation-error solutions (Eq 4.28), each reweighted with the previous one."""
        found, A = [], np.ones(self.H.size, dtype=np.complex128)
        for _ in range(_REWEIGHTINGS):
            ratio = self._stable(self._equation_error(A))
            found.append(ratio)
            A = self.P @ ratio.a
        return found

    def _equation_error(self, A: Complex) -> _Ratio:
        row = (self.root / np.abs(A))[:, None]
        columns = self.recipe.numerator + 1
        matrix = np.hstack((self.P[:, :columns], -self.H[:, None] * self.P[:, :-1])) * row
        solution = _least_squares(matrix, (self.H * self.P[:, -1]) * row[:, 0])
        return _Ratio(solution[:columns], np.append(solution[columns:], 1.0))

    def _stable(self, ratio: _Ratio) -> _Ratio:
        """Mirror unstable poles and fit the numerator again."""
        poles = self.basis.roots(ratio.a)
        outside = poles.real >= 0.0
        if not outside.any():
            return ratio
        poles = np.where(outside, -poles.conj(), poles)
        # The basis is orthonormal on the points, so the coefficients of a polynomial are its projections.
        share = self.root**2 / np.sum(self.root**2)
        product = np.prod((self._points()[:, None] - poles[None, :]), axis=1)
        a = np.real(self.P.conj().T @ (share * product))
        a = a / a[-1]
        A = self.P @ a
        matrix = self.P[:, : self.recipe.numerator + 1] * (self.root / A)[:, None]
        return _Ratio(_least_squares(matrix, self.root * self.H), a)

    def _points(self) -> Complex:
        """Return the points s from p_1 = (s - h_00) p_0 / h_10."""
        h = self.basis.hessenberg
        return np.asarray(self.P[:, 1] / self.P[:, 0] * h[1, 0] + h[0, 0], dtype=np.complex128)

    def _improved(self, ratio: _Ratio, cost: float) -> tuple[_Ratio, float]:
        """Take a Gauss-Newton step of Eq 4.29, halved until the cost falls; return the new coefficients and cost."""
        A, B = self.P @ ratio.a, self.P[:, : ratio.b.size] @ ratio.b
        by_b = self.P[:, : ratio.b.size] / A[:, None]
        by_a = -self.P[:, :-1] * (B / A**2)[:, None]
        step = _least_squares(np.hstack((by_b, by_a)) * self.root[:, None], self._misfit(ratio))
        for k in range(_HALVINGS):
            moved = step * 0.5**k
            tried = _Ratio(ratio.b + moved[: ratio.b.size], ratio.a + np.append(moved[ratio.b.size :], 0.0))
            reached = self.cost(tried)
            if reached < cost and (self.basis.roots(tried.a).real < 0.0).all():
                return tried, reached
        return ratio, cost


def _least_squares(matrix: Complex, target: Complex) -> Array:
    """Return the real least-squares solution (n,) of complex equations, computed with scaled columns."""
    stacked = np.vstack((matrix.real, matrix.imag))
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0.0] = 1.0
    solution = np.linalg.lstsq(stacked / size, np.concatenate((target.real, target.imag)), rcond=1e-14)[0]
    return np.asarray(solution / size, dtype=np.float64)


def _modal(basis: _PolynomialBasis, ratio: _Ratio, scale: float) -> TransferFunction:
    """Return the transfer function with poles p_i and residues `r_i = B(p_i) / A'(p_i)`."""
    poles = basis.roots(ratio.a)
    degree = ratio.b.size - 1
    distance = poles[:, None] - poles[None, :] + np.eye(poles.size)
    if np.abs(distance).min() < 1e-9 * np.abs(poles).max():
        raise ParameterError("the fit has a double pole, which has no parallel form; choose another order")
    slope = basis.leading(ratio.a) * np.prod(distance, axis=1)
    values = basis.values(poles)[:, : degree + 1] @ ratio.b
    direct = float(ratio.b[-1] / ratio.a[-1]) if degree == poles.size else 0.0
    return TransferFunction(poles * scale, values / slope * scale, direct)
