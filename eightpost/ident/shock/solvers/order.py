"""The order of the inner polynomial by cross-validation on stretches of the record that are left out.

The lowest order that predicts as well as any leaves an error of the curve that is just about its scatter, which no
interval counts; so the next higher one is taken. The nominal 95 % intervals of 200 random shocks then hold the truth in
94.0 %; with the lowest order within 0.2 % of the best it was 89.1 % (tests/ident/test_coverage.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.solvers.uncertainty import blocks_of
from eightpost.shock.curve import INNER_ORDER

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eightpost.ident.shock.record.runs import Runs

    Array = NDArray[np.float64]

#: Orders that are tried: the dissertation's is the upper end.
ORDERS = (3, 5, 7, 9, 11, 13, INNER_ORDER)

#: An order is as good as the best while its error is within this share of it.
_AS_GOOD = 5e-4


def choose_order(runs: Runs, columns_of: Callable[[int], Array]) -> int:
    """Return the order next above the lowest whose fit predicts stretches of the record best that it has not seen.

    Args:
        runs: With target and weights.
        columns_of: Gives the columns (R, n) of an order at the rows: the force is linear in them, lag and all.
    """
    errors = np.array([left_out_error(runs, columns_of(order)) for order in ORDERS])
    good = np.flatnonzero(errors <= (1.0 + _AS_GOOD) * errors.min())
    return ORDERS[min(int(good[0]) + 1, len(ORDERS) - 1)]


def left_out_error(runs: Runs, columns: Array) -> float:
    """Return the RMS error [N] at rows that their own block's fit has not seen, in closed form.

    Without block b the error there is r_b + Q_b (I - Q_b' Q_b)^-1 Q_b' r_b, with Q'Q = I and r the residual.
    """
    root = np.sqrt(runs.weights)
    size = np.linalg.norm(columns, axis=0)
    orthogonal = np.linalg.qr(root[:, None] * columns[:, size > 0.0] / size[size > 0.0])[0]
    target = root * runs.target
    residual = target - orthogonal @ (orthogonal.T @ target)
    errors = []
    for block in blocks_of(runs):
        q, r = orthogonal[block], residual[block]
        inside = np.eye(q.shape[1]) - q.T @ q
        errors.append(r + q @ np.linalg.lstsq(inside, q.T @ r, rcond=1e-10)[0])
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
