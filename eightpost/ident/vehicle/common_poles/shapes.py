"""Exact solutions of the linear parts of a common-pole model: inputs for given outputs, outputs for given inputs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.vehicle.common_poles.realisation import Blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle.common_poles.feedthrough import Feedthrough
    from eightpost.ident.vehicle.common_poles.points import Points

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


class Row(NamedTuple):
    """Least-squares solution of one output.

    Attributes:
        c: Row of the output matrix (n,).
        d: Direct terms (m,); 0 for inputs without one.
        lagged: Gains of the lagged inputs (m,); 0 for inputs without a lag.
        misfit: Weighted complex misfit (m, K).
        Q: Orthonormal basis of the responses that the row can represent (m, 2 K, r): real parts, then imaginary parts.
    """

    c: Array
    d: Array
    lagged: Array
    misfit: Complex
    Q: Array


def solve_row(points: Points, i: int, X: Complex, through: Feedthrough) -> Row:
    """Fit output `i` for given poles and inputs.

    Args:
        points: Response values.
        i: Index of the output.
        X: Response of the states (s I - A)^-1 B (n, m, K).
        through: Direct terms and lags.
    """
    weight, (n, m, _) = points.weight[i], X.shape
    target = weight * points.H[i]
    terms = through.of_output(i, weight, points.s)
    solution, Q = _solved(np.moveaxis(X * weight, 0, -1), terms, target)
    d, lagged, direct = np.zeros(m), np.zeros(m), through.direct[i]
    split = n + int(direct.sum())
    d[direct], lagged[through.lagged] = solution[n:split], solution[split:]
    explained = np.tensordot(solution[:n], X * weight, 1) + terms @ solution[n:]
    return Row(solution[:n], d, lagged, np.asarray(target - explained), Q.reshape(m, -1, solution.size))


def solve_inputs(points: Points, blocks: Blocks, C: Array, through: Feedthrough) -> Blocks:
    """Return the blocks with the best inputs for given poles and output matrix C (p, n)."""
    shapes = np.einsum("pna,nabk->pnbk", C.reshape(len(C), -1, 2), blocks.resolvent(points.s))
    shapes = shapes.reshape(len(C), blocks.states, points.s.size)
    inputs = [_input(points, j, shapes, through) for j in range(points.H.shape[1])]
    return Blocks(blocks.w, blocks.zeta, np.stack(inputs, axis=1).reshape(blocks.w.size, 2, -1)).normalised()


def _input(points: Points, j: int, shapes: Complex, through: Feedthrough) -> Array:
    weight = points.weight[:, j]
    weighted = np.moveaxis(shapes * weight[:, None, :], 1, -1)
    terms = through.of_input(j, weight, points.s)
    return _solved(weighted, terms, weight * points.H[:, j])[0][: shapes.shape[1]]


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
