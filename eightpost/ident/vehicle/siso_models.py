"""Models of single responses (recipe boggs): rational functions, all of them in parallel, and their reduction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh, svd
from scipy.sparse import coo_array, csr_array

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.least_squares import linear_solution
from eightpost.progress import parts
from eightpost.vehicle.statespace import Channel, Mode, StateSpace

# ==== Rational functions fitted to frequency responses ===============================================================

# ---- Polynomials that are orthonormal on the points of a fit, so that high orders remain well conditioned -----------


@dataclass(frozen=True, slots=True, eq=False)
class _PolynomialBasis:
    """Real polynomials of degree 0 to n with p_0 = 1 and a Hessenberg matrix (n + 1, n)."""

    hessenberg: Array

    @classmethod
    def orthonormal(cls, points: Complex, weight: Array, degree: int) -> _PolynomialBasis:
        """Return polynomials that are orthonormal on `points` (K,) with a nonnegative `weight` (K,)."""
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
        return cls(hessenberg)

    def values(self, points: Complex) -> Complex:
        """Return p_0 ... p_n (K, n + 1) at complex points (K,)."""
        n = self.hessenberg.shape[1]
        values = np.empty((points.size, n + 1), dtype=np.complex128)
        values[:, 0] = 1.0
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


# ---- Weights of fits over frequency (4.4.1, 5.3.3, Eq 6.9) ----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class BandWeights:
    """One weight per frequency band, zero elsewhere."""

    #: Tuples (low, high, weight) [Hz, Hz, 1]; a band includes its lower limit but not its upper.
    bands: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
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
        if not 0 <= self.numerator <= self.denominator or self.denominator < 1:
            raise ParameterError(
                f"a numerator of degree {self.numerator} over a denominator of degree {self.denominator} cannot be "
                "simulated; give degrees with 0 <= numerator <= denominator"
            )

    def fit(self, frequency: Array, H: Complex, weight: Array) -> TransferFunction:
        """Fit a response H (K,) at frequencies (K,) [Hz] with the weight of Eq 4.28 (K,), zero where it is not fitted.

        Raises:
            TooShortError: There are too few frequencies with weight for the number of coefficients.
        """
        used = (weight > 0.0) & (frequency > 0.0)
        count = self.denominator + self.numerator + 1
        if 2 * int(used.sum()) < count:
            raise TooShortError(f"{int(used.sum())} frequencies with weight are too few for {count} coefficients")
        points: Complex = np.asarray(2j * np.pi * frequency[used], dtype=np.complex128)
        scale = float(np.abs(points).max())
        basis = _PolynomialBasis.orthonormal(points / scale, weight[used], self.denominator)
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
        solutions = self._reweighted()
        costs = [self.cost(ratio) for ratio in solutions]
        best = int(np.argmin(costs))
        ratio, cost = solutions[best], costs[best]
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
    return linear_solution(stacked, np.concatenate((target.real, target.imag)), weakest=1e-14)


def _modal(basis: _PolynomialBasis, ratio: _Ratio, scale: float) -> TransferFunction:
    """Return the transfer function with poles p_i and residues `r_i = B(p_i) / A'(p_i)`."""
    poles = basis.roots(ratio.a)
    degree = ratio.b.size - 1
    distance = poles[:, None] - poles[None, :] + np.eye(poles.size)
    if np.abs(distance).min() < 1e-9 * np.abs(poles).max():
        raise ParameterError("the fit has a double pole, which has no parallel form; choose another order")
    leading = ratio.a[-1] / np.prod(
        np.diag(basis.hessenberg, -1)[: ratio.a.size - 1]
    )  # coefficient of the highest power
    slope = leading * np.prod(distance, axis=1)
    values = basis.values(poles)[:, : degree + 1] @ ratio.b
    direct = float(ratio.b[-1] / ratio.a[-1]) if degree == poles.size else 0.0
    return TransferFunction(poles * scale, values / slope * scale, direct)


# ==== Models in parallel, and the reduction by balanced truncation ===================================================
# 154 path fits of order eight have 1200 states, while the car itself has 14 to 20. As the poles are known, both
# Gramians have a closed form in modal coordinates,
#
#     W_c = -b_i b_j* / (p_i + p_j*),     W_o = -c_i* c_j / (p_i* + p_j)
#
# and the states that are weakly controllable or weakly observable are removed. The direct terms do not change.
#
# Source: B. C. Moore, "Principal component analysis in linear systems", IEEE Trans. Autom. Control 26 (1981) 17-32, doi
# 10.1109/TAC.1981.1102568.

#: Orders to try if all requested orders give artificial fits.
_LAST_ORDERS = (7, 6, 5, 4, 3, 2)

#: Ratio of the error to that of the next lower order above which a higher order only fits noise [1].
_NO_BETTER = 0.9

#: Limits of a fit that is not artificial: damping ratio of a mode, response outside the weighted band over that inside,
#: and frequency of a pole over the end of the weighted band [1].
_LIGHTEST, _EXCESS, _FASTEST = 0.01, 2.0, 10.0


class PathFit(NamedTuple):
    """Fit of one path."""

    model: TransferFunction
    error: float  #: Weighted RMS of the misfit relative to that of the response [1].
    lightest: float  #: Smallest damping ratio of the poles [1].
    excess: float  #: Largest response outside the weighted band relative to the largest inside [1].
    fastest: float  #: Frequency of the fastest pole relative to the upper end of the weighted band [1].

    @property
    def is_acceptable(self) -> bool:
        """Whether the fit is not artificial; see `SisoFits`."""
        return self.excess <= _EXCESS and self.fastest <= _FASTEST and self.lightest >= _LIGHTEST


def has_direct_term(output: str, source: str) -> bool:
    """Return whether an input has a direct term in an output, judged by the channels' names (Eq 4.6, 5.20 to 5.23).

    Tire forces have a direct term in the road of their corner, ride heights in every road, hub accelerations in the
    road and the force of their corner, other accelerations in every force and moment; shock velocities and
    displacements have none.
    """
    kind, place = source.rpartition(".")[2], source.rpartition(".")[0]
    if output.endswith("tire_force"):
        return kind == "road" and output.rpartition(".")[0] == place
    if output.endswith("ride_height"):
        return kind == "road"
    if output.endswith("hub_acceleration"):
        return kind in ("road", "force") and output.rpartition(".")[0] == place
    if output.endswith("acceleration"):
        return kind != "road"
    return False


def may_have_direct_term(output: str, source: str) -> bool:
    """Return whether an input may have a direct term in an output of any car, e.g. with solid axles and damped tires.

    Shock velocities and displacements have no direct terms; ride heights have them only in the roads, from which they
    are measured.
    """
    kind = source.rpartition(".")[2]
    if output.endswith(("velocity", "displacement")):
        return False
    return kind == "road" if output.endswith("ride_height") else True


@dataclass(frozen=True, slots=True)
class SisoFits:
    """Settings of the path fits: "denominators from 4 up until acceptable, without artificial modes" (6.3.3).

    A fit is artificial if it has a mode with almost no damping, a much larger response outside the weighted band than
    inside, or a pole so fast that it acts as a direct term. Such a fit is used only if no order down to 2 gives a
    better one.
    """

    #: Denominator degrees to try, in this order. The first one with an error below `tolerance` is used, else the best
    #: one; the search stops when a higher order is barely better.
    orders: tuple[int, ...] = (4, 6, 8)
    tolerance: float = 0.02  #: Accepted error of a path [1].
    #: Weights by input; other inputs have `AEROLOADERS` if their name is that of a load, else `WHEELLOADERS`.
    weights: Mapping[str, BandWeights] = field(default_factory=dict)
    #: Function that returns whether a path (output, input) has a direct term.
    direct: Callable[[str, str], bool] = has_direct_term

    def fit(self, response: FrequencyResponse) -> SisoModels:
        """Fit every path that is not zero; InputError: all paths are zero in their weighted bands."""
        paths = {}
        sources, outputs = enumerate(response.input_names), enumerate(response.output_names)
        for (j, source), (i, output) in parts(product(sources, outputs)):
            is_load = any(word in source for word in ("heave", "roll", "pitch", "warp", "aero"))
            weights = self.weights.get(source, AEROLOADERS if is_load else WHEELLOADERS).at(response.frequency)
            if (
                response.variance is not None
            ):  # only where the input had power, or a residual fit filled the response in
                known = np.isfinite(response.variance[i, j]) | (np.abs(response.H[i, j]) > 0.0)
                weights = weights * known.astype(np.float64)
            if np.abs(response.H[i, j] * weights).any():
                data = (response.frequency, response.H[i, j], weights)
                paths[output, source] = self._fit_path(data, self.direct(output, source))
        if not paths:
            raise InputError(
                "every path is zero in its weighted band, so there is nothing to fit; check the inputs of the tests"
            )
        models = {path: fit.model for path, fit in paths.items()}
        return SisoModels(parallel_model(models, response.inputs, response.outputs, name="siso"), paths)

    def _fit_path(self, data: tuple[Array, Complex, Array], direct: bool) -> PathFit:
        tried: list[PathFit] = []
        for order in self.orders:
            tried += _fit_order(order, data, direct)
            if tried and tried[-1].error <= self.tolerance and tried[-1].is_acceptable:
                return tried[-1]
            if len(tried) > 1 and tried[-2].is_acceptable and tried[-1].error > _NO_BETTER * tried[-2].error:
                break
        for order in _LAST_ORDERS:
            if any(fit.is_acceptable for fit in tried):
                break
            tried += _fit_order(order, data, direct)
        acceptable = [fit for fit in tried if fit.is_acceptable]
        return min(acceptable or tried, key=lambda fit: fit.error)


def _fit_order(order: int, data: tuple[Array, Complex, Array], direct: bool) -> list[PathFit]:
    """Return the fit in a list, which is empty if the fit has a double pole."""
    try:
        model = RationalFit(order, order if direct else order - 1).fit(*data)
    except ParameterError:
        return []
    used = data[2] > 0.0
    frequency, H, weight = (values[used] for values in data)
    misfit = np.sum(weight * np.abs(model.frequency_response(frequency) - H) ** 2)
    modes, low, high = model.modes(), float(frequency[0]), float(frequency[-1])
    # The largest response outside the band, from 0 to four times its end.
    outside = np.concatenate(([0.0], np.geomspace(1e-3 * low, low, 30), np.geomspace(high, 4.0 * high, 60)))
    return [
        PathFit(
            model,
            float(np.sqrt(misfit / np.sum(weight * np.abs(H) ** 2))),
            min(mode.damping_ratio for mode in modes),
            float(np.abs(model.frequency_response(outside)).max() / np.abs(H).max()),
            max(mode.frequency_hz for mode in modes) / high,
        )
    ]


@dataclass(frozen=True, slots=True, eq=False)
class SisoModels:
    """Models of all paths."""

    model: StateSpace  #: Linear model of all paths, including the baseline damping.
    paths: Mapping[tuple[str, str], PathFit]  #: Path fits by (output, input).

    def response(self, frequency: Array) -> FrequencyResponse:
        """Return the response at frequencies [Hz] (K,), path by path, as the whole model has a thousand states."""
        inputs, outputs = self.model.inputs, self.model.outputs
        rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
        H = np.zeros((len(rows), len(columns), frequency.size), dtype=np.complex128)
        for (output, source), fit in self.paths.items():
            H[rows.index(output), columns.index(source)] = fit.model.frequency_response(frequency)
        return FrequencyResponse(frequency, H, inputs, outputs)


# ---- All paths in parallel, and the reduction -----------------------------------------------------------------------


def parallel_model(
    paths: Mapping[tuple[str, str], TransferFunction],
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
    *,
    name: str = "parallel",
) -> StateSpace:
    """Return the model whose paths (output, input) are the given functions, with their own poles; others are zero."""
    rows, columns = [channel.name for channel in outputs], [channel.name for channel in inputs]
    n = sum(path.order for path in paths.values())
    A, B = np.zeros((n, n)), np.zeros((n, len(columns)))
    C, D = np.zeros((len(rows), n)), np.zeros((len(rows), len(columns)))
    at = 0
    for (output, source), path in paths.items():
        i, j, part = rows.index(output), columns.index(source), slice(at, at + path.order)
        sections = path.sections()
        A[part, part], B[part, j], C[i, part], D[i, j] = sections[0], sections[1][:, 0], sections[2][0], path.direct
        at += path.order
    return StateSpace(A, B, C, D, tuple(inputs), tuple(outputs), name=name)


# ---- Balanced truncation --------------------------------------------------------------------------------------------

#: Eigenvalue of a Gramian, relative to the largest, below which it is a rounding error [1].
_ROUNDING = 1e-14


class _BalancedModel(NamedTuple):
    """A model in balanced coordinates, most important state first."""

    model: StateSpace  #: Balanced model, without states at the level of rounding errors.
    hankel: Array  #: Hankel singular values of the scaled model (n,).

    def truncated(self, states: int) -> StateSpace:
        """Return the model of the first `states`; it is stable if the full model is."""
        model, n = self.model, min(states, self.hankel.size)
        return replace(model, A=model.A[:n, :n], B=model.B[:n], C=model.C[:, :n])


def balance(model: StateSpace, input_sizes: Array, output_sizes: Array) -> _BalancedModel:
    """Balance a stable continuous model of first- and second-order sections, such as `parallel_model` returns.

    The state matrix has blocks of one state and of two states `((re, -im), (im, re))`; typical sizes of the inputs (m,)
    and outputs (p,) scale the model before balancing.
    """
    modal, poles = _modal_basis(model.A)
    # The inverse: for a block ((1, i), (1, -i)) it is half the conjugate transpose.
    real = csr_array(modal.conj().T.multiply(1.0 / np.asarray(abs(modal).sum(axis=1)).ravel()[None, :]))
    B, C = modal @ (model.B * input_sizes), (model.C / output_sizes[:, None]) @ real
    reach = np.asarray(real @ (-(B @ B.conj().T) / (poles[:, None] + poles.conj()[None, :])) @ real.conj().T)
    sight = np.asarray(modal.conj().T @ (-(C.conj().T @ C) / (poles.conj()[:, None] + poles[None, :])) @ modal)
    # Scale each state to be equally controllable and observable, as newtons and metres differ by orders of magnitude.
    units = (np.diag(sight).real / np.diag(reach).real) ** 0.25
    reached = _factor(reach * np.outer(units, units)) / units[:, None]
    seen = _factor(sight / np.outer(units, units)) * units[:, None]
    left, hankel, right = svd(seen.T @ reached, full_matrices=False)
    used = hankel > np.sqrt(_ROUNDING) * hankel[0]
    root = 1.0 / np.sqrt(hankel[used])
    to = reached @ (right[used].T * root)
    back = (seen @ (left[:, used] * root)).T
    A = back @ (csr_array(model.A) @ to)
    return _BalancedModel(replace(model, A=A, B=back @ model.B, C=model.C @ to), hankel[used])


def _modal_basis(A: Array) -> tuple[csr_array, Complex]:
    """Return T (n, n), which gives the modal state `xi = x_1 + i x_2` and its conjugate for sections of two states.

    Also return the poles (n,); the two poles of a section of two states are adjacent.
    """
    first = np.flatnonzero(np.diag(A, 1))  # first state of every section of two states
    poles = np.diag(A).astype(np.complex128)
    imaginary = A[first + 1, first]
    poles[first] += 1j * imaginary
    poles[first + 1] -= 1j * imaginary
    ones = np.ones(len(A), dtype=np.complex128)
    ones[first + 1] = -1j
    rows = np.concatenate((np.arange(len(A)), first, first + 1))
    columns = np.concatenate((np.arange(len(A)), first + 1, first))
    values = np.concatenate((ones, np.full(first.size, 1j), np.ones(first.size)))
    return csr_array(coo_array((values, (rows, columns)), shape=A.shape)), poles


def _factor(gramian: Array | Complex) -> Array:
    """Return a factor F of the Gramian `F F^T`."""
    values, vectors = eigh(0.5 * (gramian + gramian.conj().T).real)
    used = values > _ROUNDING * values[-1]
    return np.asarray(vectors[:, used] * np.sqrt(values[used]))
