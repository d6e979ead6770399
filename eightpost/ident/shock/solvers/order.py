"""The order of the inner polynomial by cross-validation on blocks of the record that are left out.

The lowest order that predicts as well as any other has an error of the curve of about its standard error, which no
interval includes, so the next higher order is used. The nominal 95 % intervals of 200 random shocks then contain the
true value in 94.0 %; with the lowest order within 0.2 % of the best it was 89.1 % (tests/ident/test_coverage.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.solvers.uncertainty import blocks_of
from eightpost.shock.curve import INNER_ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.shock.record.runs import Runs

    Array = NDArray[np.float64]

#: Orders to compare, up to the dissertation's.
ORDERS = (3, 5, 7, 9, 11, 13, INNER_ORDER)

#: An order counts as equal to the best if its error is within this share of the best.
_AS_GOOD = 5e-4


#: Upper bound of a block's leverage is 1 minus this, because a block that alone determines a direction has leverage 1.
_CLEAR = 1e-8


def choose_order(runs: Runs, columns: Array) -> int:
    """Return the next order above the lowest one that predicts left-out blocks of the record as well as the best.

    Args:
        runs: Runs with target and weights.
        columns: Columns (R, n) at the rows; the force, lag included, is linear in them. The last columns are the powers
            of the inner polynomial.
    """
    errors = left_out_errors(runs, columns, [columns.shape[1] - INNER_ORDER + order for order in ORDERS])
    good = np.flatnonzero(errors <= (1.0 + _AS_GOOD) * errors.min())
    return ORDERS[min(int(good[0]) + 1, len(ORDERS) - 1)]


def left_out_errors(runs: Runs, columns: Array, counts: Sequence[int]) -> Array:
    """Return the RMS errors [N] of predictions of each block by a fit to all other blocks, in closed form.

    Without block b the error there is r_b + Q_b (I - Q_b' Q_b)^-1 Q_b' r_b, with Q'Q = I and r the residual.

    Args:
        runs: Runs with target and weights.
        columns: Columns (R, n).
        counts: Number of leading columns to fit, for each error.
    """
    root = np.sqrt(runs.weights)
    size = np.linalg.norm(columns, axis=0)
    used = size > 0.0
    orthogonal = np.linalg.qr(root[:, None] * columns[:, used] / size[used])[0]
    parts = [orthogonal[block] for block in blocks_of(runs)]
    inside = (1.0 + _CLEAR) * np.eye(orthogonal.shape[1]) - np.array([q.T @ q for q in parts])
    target = root * runs.target
    errors = []
    for count in np.cumsum(used)[np.array(counts) - 1].tolist():
        q = orthogonal[:, :count]
        residual = target - q @ (q.T @ target)
        scores = np.array([q[block].T @ residual[block] for block in blocks_of(runs)])
        moves = np.linalg.solve(inside[:, :count, :count], scores[..., None])[..., 0]
        moved = np.concatenate([part[:, :count] @ move for part, move in zip(parts, moves, strict=True)])
        errors.append(float(np.sqrt(np.mean((residual + moved) ** 2))))
    return np.array(errors)
