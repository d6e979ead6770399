"""Refinement of a model by maximum likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.frequency_response import FrequencyResponse
from eightpost.ident.vehicle.points import Blocks, Feedthrough, Points, Row, solve_row
from eightpost.progress import advance
from eightpost.vehicle.statespace import Channel, StateSpace

# ---- Physical constraints on a vehicle model that follow from the names of its channels -----------------------------

#: Standard deviation of a velocity's zero response at 0 Hz, relative to its largest response [1].
_STILL = 1e-4


def direct_terms(outputs: Sequence[str], inputs: Sequence[str]) -> NDArray[np.bool_]:
    """Return which inputs may have a direct term in which outputs (p, m).

    Accelerations may have direct terms in all inputs (a solid axle and a rigid chassis connect the corners, damped
    tires the roads), tire forces and ride heights in the roads, other outputs in none.
    """
    roads_of = [_ends(name, "road") for name in inputs]
    return np.array([
        [output.endswith("acceleration") or (is_road and output.endswith(("tire_force", "ride_height")))
         for is_road in roads_of]
        for output in outputs
    ])  # fmt: skip


def roads(inputs: Sequence[str]) -> NDArray[np.bool_]:
    """Return which inputs are roads (m,)."""
    return np.array([_ends(name, "road") for name in inputs])


def integrals(outputs: Sequence[str]) -> dict[str, str]:
    """Return the velocity of each displacement whose velocity is an output too."""
    pairs = {name: name.removesuffix("displacement") + "velocity" for name in outputs if _ends(name, "displacement")}
    return {name: velocity for name, velocity in pairs.items() if velocity in outputs}


def _ends(name: str, quantity: str) -> bool:
    return name.rpartition(".")[2] == quantity


def without_integrals(response: FrequencyResponse) -> FrequencyResponse:
    """Return the response with displacements merged into their velocities and zero velocities at 0 Hz.

    `s H_x` is a second estimate of `H_v`; the two are averaged, weighted by their variances. If the velocity was
    derived from the displacement, both come from one potentiometer, so the smaller variance is not reduced by
    averaging.
    """
    pairs, names = integrals(response.output_names), list(response.output_names)
    H, variance, s = response.H.copy(), response.variance, 2j * np.pi * response.frequency
    if variance is not None:
        variance = variance.copy()
        for displacement, velocity in pairs.items():
            x, v = names.index(displacement), names.index(velocity)
            other, own = variance[x] * np.abs(s) ** 2, variance[v].copy()
            known = np.isfinite(other) & np.isfinite(own)
            share = np.divide(own, own + other, out=np.zeros_like(own), where=known & (own + other > 0.0))
            H[v] = (1.0 - share) * H[v] + share * s * H[x]
            variance[v] = np.where(known, np.minimum(own, other), own)
    joined = replace(response, H=H, variance=variance)
    return _with_rest(joined.select(outputs=[name for name in names if name not in pairs]))


def _with_rest(response: FrequencyResponse) -> FrequencyResponse:
    """Add 0 Hz, where velocities are zero and other outputs unknown."""
    if response.frequency[0] == 0.0:
        return response
    H = np.concatenate((np.zeros((*response.H.shape[:2], 1)), response.H), axis=2)
    variance = response.variance
    if variance is None:
        variance = np.where(np.abs(response.H) > 0.0, 0.0, np.inf)
    largest = np.abs(response.H).max(axis=2)
    moving = np.array([_ends(name, "velocity") for name in response.output_names])[:, None]
    still = np.where(moving & (largest > 0.0), (_STILL * largest) ** 2, np.inf)
    frequency, variance = np.concatenate(([0.0], response.frequency)), np.concatenate((still[:, :, None], variance), 2)
    return FrequencyResponse(frequency, H, response.inputs, response.outputs, None, None, variance)


def with_integrals(model: StateSpace, outputs: Sequence[Channel]) -> StateSpace:
    """Return the model with all `outputs`; displacements are the integrals `C_v A^-1` of their velocities."""
    pairs, names = integrals([channel.name for channel in outputs]), model.output_names
    C, D = np.zeros((len(outputs), len(model.A))), np.zeros((len(outputs), len(model.inputs)))
    inverse = np.linalg.inv(model.A)
    for i, channel in enumerate(outputs):
        row = names.index(pairs.get(channel.name, channel.name))
        if channel.name in pairs:
            C[i] = model.C[row] @ inverse
        else:
            C[i], D[i] = model.C[row], model.D[row]
    return StateSpace(model.A, model.B, C, D, model.inputs, tuple(outputs), None, model.name)


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
        """Gains of the lagged inputs (p, m)."""
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
    rows = tuple(for_each(range(len(points.H)), lambda i: solve_row(points, i, X, through)))
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
