"""What is linear in a common-pole model is solved exactly: inputs for given outputs, outputs for given inputs."""

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
    """One output, solved.

    Attributes:
        c: Outputs per state (n,).
        d: Direct terms (m,), 0 where there is none.
        lagged: Answers to the lagged inputs (m,), 0 where there is no lag.
        misfit: Weighted (m, K), complex.
        Q: Orthonormal basis of what the row can explain (m, 2 K, r): real parts, then imaginary ones.
    """

    c: Array
    d: Array
    lagged: Array
    misfit: Complex
    Q: Array


def solve_row(points: Points, i: int, X: Complex, through: Feedthrough) -> Row:
    """Fit output `i` for given poles and inputs.

    Args:
        points: The response.
        i: The output.
        X: (s I - A)^-1 B (n, m, K).
        through: What there is beside the poles.
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
    """Return the blocks with the inputs that fit best for given poles and outputs C (p, n)."""
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
    """Return the real least-squares solution over (rows, K, columns) by scaled columns, and their orthonormal basis."""
    matrix = np.concatenate((states, terms), axis=2)
    real = np.concatenate((matrix.real, matrix.imag), axis=1).reshape(-1, matrix.shape[2])
    size = np.linalg.norm(real, axis=0)
    size[size == 0.0] = 1.0
    Q, R = np.linalg.qr(real / size)
    goal = np.concatenate((target.real, target.imag), axis=1).reshape(-1)
    solution = np.linalg.lstsq(R, Q.T @ goal, rcond=1e-13)[0]
    return np.asarray(solution / size), np.asarray(Q)
