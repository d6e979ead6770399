"""Search for a common-pole model: the points of a response, the model's form, a first model and its refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from eightpost.array_types import Array, Complex
from eightpost.errors import InputError, TooShortError
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.progress import advance

# ==== Points, and the model's form ===================================================================================

# ---- Effects of inputs on outputs besides the common poles ----------------------------------------------------------


class Lag(NamedTuple):
    """First-order lag `1 / (1 + s / rate)` of an input."""

    input: int  #: Index of the input.
    rate: float  #: Rate [1/s].
    outputs: NDArray[np.bool_]  #: Mask of the outputs that it acts on (p,).

    def response(self, s: Complex) -> Complex:
        """Return the response at points s (K,) of the complex plane [1/s]."""
        return np.asarray(1.0 / (1.0 + s / self.rate))


@dataclass(frozen=True, slots=True, eq=False)
class Feedthrough:
    """Direct terms, and terms of lags.

    A damped tire responds to the velocity of the road, which a proper model cannot represent: the tire force grows with
    frequency, and a part of the wheel velocity follows the road directly. Likewise, rubber in series with a shock
    yields with the rate of its force. Lags above the band approximate these and leave shock velocities without direct
    terms.
    """

    direct: NDArray[np.bool_]  #: Mask of the direct terms that exist (p, m).
    lags: tuple[Lag, ...] = ()

    @property
    def count(self) -> int:
        """Number of unknown coefficients."""
        return int(self.direct.sum()) + sum(int(lag.outputs.sum()) for lag in self.lags)

    def of_output(self, i: int, weight: Array, s: Complex) -> Complex:
        """Return the weighted terms of output `i` as columns (m, K, r): direct ones, then those of its lags."""
        terms = [(lag.input, lag.response(s)) for lag in self.lags if lag.outputs[i]]
        return _columns(weight, np.flatnonzero(self.direct[i]), terms)

    def of_input(self, j: int, weight: Array, s: Complex) -> Complex:
        """Return the weighted terms of input `j` as columns (p, K, r): direct ones, then those of its lags."""
        terms = [
            (i, lag.response(s)) for lag in self.lags if lag.input == j for i in np.flatnonzero(lag.outputs).tolist()
        ]
        return _columns(weight, np.flatnonzero(self.direct[:, j]), terms)


def _columns(weight: Array, direct: NDArray[np.intp], terms: Sequence[tuple[int, Complex]]) -> Complex:
    columns = np.zeros((*weight.shape, direct.size + len(terms)), dtype=np.complex128)
    for k, place in enumerate(direct):
        columns[place, :, k] = weight[place]
    for k, (place, term) in enumerate(terms, start=direct.size):
        columns[place, :, k] = weight[place] * term
    return columns


# ---- Common-pole model made of real second-order blocks; each is a pair of poles shared by all paths ----------------

#: Lower limit of the damping ratio of a block [1].
_LIGHTEST = 1e-6

#: Distance of two poles of a block, relative to their size, below which they count as a double pole [1].
_DOUBLE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Poles and input matrices of N blocks."""

    w: Array  #: Natural frequencies [1/s] (N,), above zero.
    zeta: Array  #: Damping ratios [1] (N,), above zero.
    B: Array  #: Input matrices (N, 2, m).

    @property
    def states(self) -> int:
        """The number of states."""
        return 2 * self.w.size

    @property
    def poles(self) -> Complex:
        """The poles (2 N,) [1/s]."""
        root = np.sqrt(self.zeta.astype(np.complex128) ** 2 - 1.0)
        poles = np.concatenate((self.w * (-self.zeta + root), self.w * (-self.zeta - root)))
        return poles.astype(np.complex128)

    @property
    def A(self) -> Array:  # noqa: N802  the symbol of the equation
        """The state matrix (2 N, 2 N)."""
        return np.asarray(block_diag(*self._matrices()), dtype=np.float64)

    @property
    def input_matrix(self) -> Array:
        """The input matrix (2 N, m)."""
        return self.B.reshape(self.states, -1)

    def _matrices(self) -> Array:
        zero = np.zeros_like(self.w)
        return np.stack((np.stack((zero, self.w), -1), np.stack((-self.w, -2.0 * self.zeta * self.w), -1)), -2)

    def resolvent(self, s: Complex) -> Complex:
        """Return (s I - A_k)^-1 (N, 2, 2, K)."""
        w, z = self.w[:, None], self.zeta[:, None]
        divisor = s**2 + 2.0 * z * w * s + w**2
        full = np.broadcast_to(w, divisor.shape)
        rows = [[s + 2.0 * z * w, full], [-full, s + 0.0 * w]]
        return np.asarray(np.stack([np.stack(row, 1) for row in rows], 1) / divisor[:, None, None, :])

    def states_response(self, s: Complex) -> Complex:
        """Return (s I - A)^-1 B (2 N, m, K) at points s (K,) of the complex plane [1/s]."""
        response = np.einsum("nabk,nbj->najk", self.resolvent(s), self.B)
        return np.asarray(response.reshape(self.states, self.B.shape[2], s.size))

    def slower_than(self, rate: float) -> Blocks:
        """Return the blocks with a natural frequency below `rate` [1/s], or all of them if no block is that slow."""
        slow = self.w < rate
        return Blocks(self.w[slow], self.zeta[slow], self.B[slow]) if slow.any() else self

    def normalised(self) -> Blocks:
        """Return the same poles with the input matrix of every block scaled to norm 1."""
        size = np.linalg.norm(self.B, axis=(1, 2), keepdims=True)
        return Blocks(self.w, self.zeta, self.B / np.where(size > 0.0, size, 1.0))


def blocks_of(poles: Complex, C: Complex) -> tuple[Blocks, Array]:
    """Return blocks with the given poles and without inputs (m = 0), and their output matrix (p, 2 N).

    Poles [1/s] (2 N,) are stable, complex ones in conjugate pairs, like the mode shapes C (p, 2 N).
    """
    w, zeta, outputs = [], [], []
    for first, second in _pairs(poles):
        product, total = float((poles[first] * poles[second]).real), float((poles[first] + poles[second]).real)
        rate = np.sqrt(product)
        w.append(rate)
        zeta.append(max(-0.5 * total / rate, _LIGHTEST))
        # Modal coordinates of the block: x = T (z1, z2) with rows (1, 1) and (lambda1, lambda2) / w. Two equal poles,
        # as at a limit of the subspace method, have no such coordinates; the refinement moves them.
        apart = abs(poles[first] - poles[second]) > _DOUBLE * rate
        T = np.array([[1.0, 1.0], [poles[first] / rate, poles[second] / rate * (1.0 if apart else 1.0 + _DOUBLE)]])
        outputs.append(np.real(C[:, [first, second]] @ np.linalg.inv(T)))
    return Blocks(np.array(w), np.array(zeta), np.zeros((len(w), 2, 0))), np.concatenate(outputs, axis=1)


def _pairs(poles: Complex) -> list[tuple[int, int]]:
    """Pair each complex pole with its conjugate and each real pole with the next faster one."""
    upper = [int(i) for i in np.flatnonzero(poles.imag > 0.0)]
    pairs = [(i, int(np.argmin(np.abs(poles - poles[i].conj())))) for i in upper]
    real = sorted((int(i) for i in np.flatnonzero(poles.imag == 0.0)), key=lambda i: float(abs(poles[i])))
    return pairs + list(zip(real[::2], real[1::2], strict=True))


# ---- Data of a common-pole fit --------------------------------------------------------------------------------------

_SWEEPS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Response values in channels scaled to similar size: `H_scaled = H u_size / y_size`."""

    s: Complex  #: Laplace variable 2 pi j f [1/s] (K,).
    H: Complex  #: Scaled response (p, m, K).
    deviation: Array  #: Standard deviation of the scaled response (p, m, K); infinite where a value is unknown.
    input_size: Array  #: Scale of the inputs [input units] (m,).
    output_size: Array  #: Scale of the outputs [output units] (p,).

    @property
    def weight(self) -> Array:
        """Inverse of the standard deviation (p, m, K); 0 where a value is unknown."""
        return np.asarray(1.0 / self.deviation, dtype=np.float64)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the known values (p, m, K)."""
        return np.asarray(np.isfinite(self.deviation))

    def thinned(self, count: int) -> Points:
        """Return evenly selected frequencies, about `count` of them."""
        step = max(1, self.s.size // count)
        chosen = slice(self.s.size % step, None, step)
        return replace(self, s=self.s[chosen], H=self.H[..., chosen], deviation=self.deviation[..., chosen])


def points_of(response: FrequencyResponse, *, floor: float) -> Points:
    """Return the values of a response with their standard deviations.

    The standard deviation is that of the estimate, but at least `floor` times the size of the output at that frequency.
    The floor is needed because an estimate without noise has errors too, and unbounded weights would fit only a few
    values.

    Raises:
        InputError: An input or an output has no value at all.
    """
    variance = response.variance
    if variance is None:
        variance = np.where(np.abs(response.H) > 0.0, 0.0, np.inf)
    known = np.isfinite(variance)
    for axes, names, kind in (((1, 2), response.output_names, "output"), ((0, 2), response.input_names, "input")):
        for name, is_known in zip(names, np.atleast_1d(known.any(axis=axes)), strict=True):
            if not is_known:
                raise InputError(f"the {kind} {name!r} has no response in the frequency band of the fit; leave it out")
    H = np.where(known, response.H, 0.0)
    output_size, input_size = _sizes(np.abs(H), known)
    scale = (input_size[None, :] / output_size[:, None])[:, :, None]
    scaled = np.asarray(H * scale, dtype=np.complex128)
    counted = np.maximum(known.sum(axis=1), 1)
    local = np.sqrt(np.sum(np.abs(scaled) ** 2, axis=1) / counted)
    noise = np.sqrt(np.where(known, variance, 0.0)) * scale
    deviation = np.where(known, np.hypot(noise, floor * local[:, None, :]), np.inf)
    s = np.asarray(2j * np.pi * response.frequency, dtype=np.complex128)
    return Points(s, scaled, deviation, input_size, output_size)


def _sizes(H: Array, known: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return scales y (p,) and u (m,) for which the RMS of `H u / y` is near 1 in every row and column."""
    power, counted = np.sum(H**2, axis=2), np.maximum(known.sum(axis=2), 1)
    mean = power / counted
    y, u = np.ones(len(mean)), np.ones(mean.shape[1])
    for _ in range(_SWEEPS):
        y = _root(np.mean(mean * u**2, axis=1))
        u = 1.0 / _root(np.mean(mean / y[:, None] ** 2, axis=0))
    return y, u


def _root(power: Array) -> Array:
    return np.sqrt(np.where(power > 0.0, power, 1.0))


# ---- Exact solutions of the linear parts of a common-pole model -----------------------------------------------------


class Row(NamedTuple):
    """Least-squares solution of one output."""

    c: Array  #: Row of the output matrix (n,).
    d: Array  #: Direct terms (m,); 0 for inputs without one.
    lagged: Array  #: Gains of the lags (r,); 0 for those that do not act on it.
    misfit: Complex  #: Weighted complex misfit (m, K).
    #: Orthonormal basis of the responses that the row can represent (m, 2 K, r): real parts, then imaginary parts.
    Q: Array


def _solve_row(points: Points, i: int, X: Complex, through: Feedthrough) -> Row:
    """Fit output `i` for given poles and inputs, from the states' response X = (s I - A)^-1 B (n, m, K)."""
    weight, (n, m, _) = points.weight[i], X.shape
    target = weight * points.H[i]
    terms = through.of_output(i, weight, points.s)
    solution, Q = _solved(np.moveaxis(X * weight, 0, -1), terms, target)
    d, direct = np.zeros(m), through.direct[i]
    acts = np.array([lag.outputs[i] for lag in through.lags], dtype=np.bool_)
    lagged, split = np.zeros(acts.size), n + int(direct.sum())
    d[direct], lagged[acts] = solution[n:split], solution[split:]
    explained = np.tensordot(solution[:n], X * weight, 1) + terms @ solution[n:]
    return Row(solution[:n], d, lagged, np.asarray(target - explained), Q.reshape(m, -1, solution.size))


def solve_inputs(points: Points, blocks: Blocks, C: Array, through: Feedthrough) -> Blocks:
    """Return the blocks with the best inputs for given poles and output matrix C (p, n)."""
    shapes = np.einsum("pna,nabk->pnbk", C.reshape(len(C), -1, 2), blocks.resolvent(points.s))
    shapes = shapes.reshape(len(C), blocks.states, points.s.size)
    inputs = []
    for j in range(points.H.shape[1]):
        weight = points.weight[:, j]
        weighted = np.moveaxis(shapes * weight[:, None, :], 1, -1)
        terms = through.of_input(j, weight, points.s)
        inputs.append(_solved(weighted, terms, weight * points.H[:, j])[0][: shapes.shape[1]])
    return Blocks(blocks.w, blocks.zeta, np.stack(inputs, axis=1).reshape(blocks.w.size, 2, -1)).normalised()


def _solved(states: Complex, terms: Complex, target: Complex) -> tuple[Array, Array]:
    """Return the real least-squares solution of equations (rows, K, columns), and the basis Q of the columns."""
    matrix = np.concatenate((states, terms), axis=2)
    real = np.concatenate((matrix.real, matrix.imag), axis=1).reshape(-1, matrix.shape[2])
    size = np.linalg.norm(real, axis=0)
    size[size == 0.0] = 1.0
    Q, R = np.linalg.qr(real / size)
    goal = np.concatenate((target.real, target.imag), axis=1).reshape(-1)
    solution = np.linalg.lstsq(R, Q.T @ goal, rcond=1e-13)[0]
    return np.asarray(solution / size), np.asarray(Q)


# ==== Frequency-domain subspace identification: poles and mode shapes from a response without iteration ==============
# The bilinear map `z = (alpha + s) / (alpha - s)` maps the frequencies to the unit circle, where powers are well
# conditioned, and a rational response to one of the same order; the inverse map is exact. For every input j and
# frequency k the column [H_j; z H_j; ... z^(q-1) H_j] is the extended observability matrix times the state, plus powers
# of z times direct terms. When these powers are projected out, the remaining columns span the range of the
# observability matrix.
#
# Inputs without power at a frequency have no column there; missing values are not replaced.
#
# Source: T. McKelvey, H. Akcay, L. Ljung, "Subspace-based multivariable system identification from frequency response
# data", IEEE Trans. Automatic Control 41 (1996) 960-979, doi 10.1109/9.508900 (algorithm 2, any frequencies).

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
        shapes = np.asarray(O[: self.outputs] @ V / (1.0 + z), dtype=np.complex128)
        s = _within(np.asarray(self.alpha * (z - 1.0) / (z + 1.0), dtype=np.complex128), self.alpha)
        unstable = s.real >= 0.0
        return np.where(unstable, -s.conj(), s).astype(np.complex128), shapes, int(unstable.sum())

    def blocks(self, order: int) -> tuple[Blocks, Array, int]:
        """Return blocks without inputs, their output matrix (p, order), and the number of mirrored poles."""
        poles, shapes, mirrored = self.poles(order)
        return *blocks_of(poles, shapes), mirrored


def subspace_of(points: Points, *, max_states: int) -> Subspace:
    """Return the subspace of a response; TooShortError: the response has too few values for the number of states."""
    p = len(points.H)
    q = max(8, 2 * (-(-max_states // p) + 1))  # block rows: twice as many as needed, at least 8
    alpha = _MIDDLE * float(np.abs(points.s).max())
    columns = [_block_columns(points, j, q, alpha) for j in range(points.H.shape[1])]
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


def _block_columns(points: Points, j: int, q: int, alpha: float) -> Array:
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


def _within(s: Complex, alpha: float) -> Complex:
    """Return poles (n,) with those near infinity or zero, which are real, limited to the resolvable range."""
    size = np.abs(s)
    limited = np.clip(size, alpha / _FASTEST, alpha * _FASTEST)
    return np.asarray(np.where(size > 0.0, s * (limited / np.where(size > 0.0, size, 1.0)), -limited))


# ---- Maximum-likelihood estimate of poles and inputs with the minimum weighted misfit; outputs are ------------------

#: Limits of the damping of a step [1].
_MIN_DAMPING, _MAX_DAMPING = 1e-9, 1e8

#: Smallest damping ratio of any mode, and largest one that a mode above the band must have [1]. A car with its dampers
#: has no mode below the first; the fit gives one to a mode that only follows rounding.
_LEAST, _BEYOND = 2e-3, 0.7

#: Largest ratio of a natural frequency, and of a pole, to the upper end of the band [1]. Faster blocks imitate lags and
#: direct terms in the band; beyond it, they give a shock port that is not passive, so that friction that sticks there
#: makes the car unstable.
FASTEST = 5.0

#: Mean square misfit, in squared standard deviations, below which the fit is exact [1].
_EXACT = 1e-12

#: Number of steps that are reported as half of the refinement.
_HALF = 10

#: Curvature, relative to the largest, below which a direction has no effect on the cost [1].
_NOTHING = 1e-30


class Solution(NamedTuple):
    """A model and its misfit."""

    blocks: Blocks  #: Poles and inputs.
    rows: tuple[Row, ...]  #: Solutions of the outputs, in order.
    through: Feedthrough  #: Direct terms and lags.
    cost: float  #: Sum of the squares of the weighted misfit.

    @property
    def C(self) -> Array:  # noqa: N802  the symbol of the equation
        """Output matrix (p, n)."""
        return np.stack([row.c for row in self.rows])

    @property
    def D(self) -> Array:  # noqa: N802  the symbol of the equation
        """Direct terms (p, m)."""
        return np.stack([row.d for row in self.rows])

    @property
    def lagged(self) -> Array:
        """Gains of the lags (p, r)."""
        return np.stack([row.lagged for row in self.rows])

    @property
    def misfit(self) -> Complex:
        """Weighted misfit (p, m, K)."""
        return np.stack([row.misfit for row in self.rows])


class RefinementResult(NamedTuple):
    """Result of the refinement."""

    solution: Solution  #: Best model.
    iterations: int  #: Number of steps taken.
    converged: bool  #: Whether the last step lowered the cost by less than the tolerance.


@dataclass(frozen=True, slots=True)
class Refinement:
    """Settings of the refinement."""

    max_iterations: int = 60  #: Maximum number of steps.
    tolerance: float = 1e-4  #: Relative reduction of the cost by a step below which the search ends [1].

    def refine(self, points: Points, start: Blocks, through: Feedthrough) -> RefinementResult:
        """Return the best model near the blocks `start` (with inputs), with direct terms and lags as in `through`."""
        fastest = float(np.abs(points.s).max())
        best, damping = evaluate(points, plausibly_damped(start, fastest).normalised(), through), 1e-3
        for iteration in range(self.max_iterations):
            advance(iteration, iteration + _HALF)
            slope = curvature(points, best)
            while True:
                tried = evaluate(points, _stepped(best.blocks, slope.step(damping), fastest), through)
                if tried.cost < best.cost or damping > _MAX_DAMPING:
                    break
                damping *= 10.0
            gained = best.cost - tried.cost
            if gained <= self.tolerance * best.cost + _EXACT * points.H.size:
                return RefinementResult(tried if gained > 0.0 else best, iteration, True)
            best, damping = tried, max(damping * 0.1, _MIN_DAMPING)
        return RefinementResult(best, self.max_iterations, False)


def evaluate(points: Points, blocks: Blocks, through: Feedthrough) -> Solution:
    """Return the solution with the best outputs for the given poles and inputs."""
    X = blocks.states_response(points.s)
    rows = tuple(for_each(range(len(points.H)), lambda i: _solve_row(points, i, X, through)))
    return Solution(blocks, rows, through, float(sum(np.sum(np.abs(row.misfit) ** 2) for row in rows)))


class _Curvature(NamedTuple):
    """Gradient (t,) and Gauss-Newton matrix (t, t) of half the cost over (log w, log zeta, B)."""

    gradient: Array
    matrix: Array

    def step(self, damping: float) -> Array:
        """Return the damped step (t,); it is zero in directions without effect on the cost."""
        diagonal = np.maximum(np.diag(self.matrix), 0.0)
        size = np.sqrt(np.where(diagonal > _NOTHING * diagonal.max(), diagonal, 1.0))
        scaled = self.matrix / np.outer(size, size)
        scaled[np.diag_indices_from(scaled)] = 1.0 + damping
        return np.asarray(np.linalg.solve(scaled, -self.gradient / size) / size)


def curvature(points: Points, solution: Solution) -> _Curvature:
    """Return gradient and curvature at a solution, summed over the outputs."""
    blocks = solution.blocks
    resolvent, by_pole = blocks.resolvent(points.s), _pole_slopes(blocks, points.s)
    total = 4 * blocks.w.size // 2 + blocks.B.size
    gradient, matrix = np.zeros(total), np.zeros((total, total))
    for i, row in enumerate(solution.rows):
        c = row.c.reshape(-1, 2)
        poles = np.einsum("na,qnajk->qnjk", c, by_pole).reshape(2 * len(c), *row.misfit.shape)
        inputs = np.einsum("na,nabk->nbk", c, resolvent).reshape(2 * len(c), -1)
        _add_row(gradient, matrix, (poles, inputs), points.weight[i], row)
    return _Curvature(gradient, matrix)


def _pole_slopes(blocks: Blocks, s: Complex) -> Complex:
    """Return the derivatives of the states' response by log w and log zeta (2, N, 2, m, K)."""
    N, resolvent = blocks.w.size, blocks.resolvent(s)
    X = blocks.states_response(s).reshape(N, 2, -1, s.size)
    A = blocks.A.reshape(N, 2, N, 2)[np.arange(N), :, np.arange(N), :]
    lower = np.zeros_like(A)
    lower[:, 1, 1] = A[:, 1, 1]
    changes = np.stack((A, lower))
    return np.asarray(np.einsum("nack,qncb,nbjk->qnajk", resolvent, changes, X, optimize=True))


def _add_row(gradient: Array, matrix: Array, slopes: tuple[Complex, Complex], weight: Array, row: Row) -> None:
    """Add the contribution of one output: `J^T r` and `J^T J - (Q^T J)^T (Q^T J)`.

    `slopes` are the derivatives by the poles (2 N, m, K) and by B_aj (2 N, K), which acts on input j only.
    """
    n, m, _ = slopes[0].shape
    poles = _real(slopes[0] * weight).transpose(1, 2, 0)
    inputs = _real(slopes[1][:, None, :] * weight).transpose(1, 2, 0)
    misfit = _real(row.misfit)
    explained = np.zeros((row.Q.shape[2], len(gradient)))
    for j in range(m):
        # The entries of B (N, 2, m) follow the poles; every m-th of them belongs to input j.
        at = slice(n + j, None, m)
        P, E, r, Q = poles[j], inputs[j], misfit[j], row.Q[j]
        gradient[:n] -= P.T @ r
        gradient[at] -= E.T @ r
        crossed = P.T @ E
        matrix[:n, :n] += P.T @ P
        matrix[:n, at] += crossed
        matrix[at, :n] += crossed.T
        matrix[at, at] += E.T @ E
        explained[:, :n] += Q.T @ P
        explained[:, at] += Q.T @ E
    matrix -= explained.T @ explained


def _real(values: Complex) -> Array:
    return np.concatenate((values.real, values.imag), axis=-1)


def plausibly_damped(blocks: Blocks, fastest: float) -> Blocks:
    """Return the blocks with at least a damping ratio of `(w / w_max - 1) / 2`, at most 0.7, above the fitted band.

    In the band, up to the angular frequency w_max (`fastest`) [1/s], the damping ratio is at least 0.002. Its upper
    limit is that at which the faster of two real poles is at `FASTEST` times w_max.

    The response in the band hardly depends on the damping of a mode beyond it. Without the lower limit such a mode may
    ring in simulations, or be unstable with other shocks.
    """
    least = np.clip(0.5 * (blocks.w / fastest - 1.0), _LEAST, _BEYOND)
    ratio = np.maximum(FASTEST * fastest / blocks.w, 1.0)
    most = np.maximum(0.5 * (ratio + 1.0 / ratio), least)
    return replace(blocks, zeta=np.clip(blocks.zeta, least, most))


def _stepped(blocks: Blocks, step: Array, fastest: float) -> Blocks:
    N = blocks.w.size
    limited = np.clip(step[: 2 * N], -1.0, 1.0)
    w, zeta = blocks.w * np.exp(limited[:N]), blocks.zeta * np.exp(limited[N:])
    moved = Blocks(w, zeta, blocks.B + step[2 * N :].reshape(blocks.B.shape)).normalised()
    return plausibly_damped(moved, fastest)
