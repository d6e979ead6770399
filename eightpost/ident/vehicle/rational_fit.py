"""Rational fits of one frequency response, like MATLAB's invfreqs and invfreqz (4.3.3, 5.2.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import ParameterError, TooShortError
from eightpost.ident.vehicle.basis import PolynomialBasis, orthonormal_basis
from eightpost.ident.vehicle.transfer_function import TransferFunction, plane_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

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

    Attributes:
        denominator: Degree of A.
        numerator: Degree of B in s (or z): that of A with a direct term, one less without.
        dt: Sample time of a discrete model [s] (invfreqz), or None for a continuous one (invfreqs).
        iterations: Maximum number of Gauss-Newton steps; 0 returns the best of the reweighted equation-error solutions.
    """

    denominator: int
    numerator: int
    dt: float | None = None
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
        points = plane_points(frequency[used], self.dt)
        scale = float(np.abs(points).max()) if self.dt is None else 1.0
        basis = orthonormal_basis(points / scale, weight[used], self.denominator)
        problem = _Problem(basis, basis.values(points / scale), H[used], np.sqrt(weight[used]), self)
        return _modal(basis, problem.solve(), scale, self.dt)


class _Ratio(NamedTuple):
    """Coefficients of B and A in the basis; the last coefficient of `a` is 1."""

    b: Array
    a: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    basis: PolynomialBasis
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
        outside = self._unstable(poles)
        if not outside.any():
            return ratio
        mirrored = -poles.conj() if self.recipe.dt is None else 1.0 / poles.conj()
        poles = np.where(outside, mirrored, poles)
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

    def _unstable(self, poles: Complex) -> NDArray[np.bool_]:
        return np.asarray(poles.real >= 0.0 if self.recipe.dt is None else np.abs(poles) >= 1.0, dtype=np.bool_)

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
            if reached < cost and not self._unstable(self.basis.roots(tried.a)).any():
                return tried, reached
        return ratio, cost


def _least_squares(matrix: Complex, target: Complex) -> Array:
    """Return the real least-squares solution (n,) of complex equations, computed with scaled columns."""
    stacked = np.vstack((matrix.real, matrix.imag))
    size = np.linalg.norm(stacked, axis=0)
    size[size == 0.0] = 1.0
    solution = np.linalg.lstsq(stacked / size, np.concatenate((target.real, target.imag)), rcond=1e-14)[0]
    return np.asarray(solution / size, dtype=np.float64)


def _modal(basis: PolynomialBasis, ratio: _Ratio, scale: float, dt: float | None) -> TransferFunction:
    """Return the transfer function with poles p_i and residues `r_i = B(p_i) / A'(p_i)`."""
    poles = basis.roots(ratio.a)
    degree = ratio.b.size - 1
    distance = poles[:, None] - poles[None, :] + np.eye(poles.size)
    if np.abs(distance).min() < 1e-9 * np.abs(poles).max():
        raise ParameterError("the fit has a double pole, which has no parallel form; choose another order")
    slope = basis.leading(ratio.a) * np.prod(distance, axis=1)
    values = basis.values(poles)[:, : degree + 1] @ ratio.b
    direct = float(ratio.b[-1] / ratio.a[-1]) if degree == poles.size else 0.0
    return TransferFunction(poles * scale, values / slope * scale, direct, dt)
