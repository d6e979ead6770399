"""Choice of the number of states: by a gap in the singular values, else by the description length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.vehicle.common_poles.refinement import evaluate
from eightpost.ident.vehicle.common_poles.shapes import solve_inputs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle.common_poles.feedthrough import Feedthrough
    from eightpost.ident.vehicle.common_poles.points import Points
    from eightpost.ident.vehicle.common_poles.refinement import Solution
    from eightpost.ident.vehicle.common_poles.subspace import Subspace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Ratio of a singular value to the next one from which the gap is clear [1].
CLEAR_GAP = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class OrderStudy:
    """Comparison of models of increasing order.

    Attributes:
        orders: Even numbers of states (R,).
        costs: Sum of squares of each model's weighted misfit, with optimal inputs and outputs for its poles (R,).
        gaps: Ratio of the singular value of the order to the next one [1] (R,).
        poles: Poles of each model before unstable ones are mirrored [1/s].
        samples: Number of real values that were fitted.
        parameters: Number of parameters of each model (R,).
    """

    orders: tuple[int, ...]
    costs: Array
    gaps: Array
    poles: tuple[Complex, ...]
    samples: int
    parameters: Array

    @property
    def clear(self) -> bool:
        """Whether the singular values have a clear gap."""
        return bool(self.gaps.max() >= CLEAR_GAP)

    @property
    def suggested(self) -> int:
        """The highest order with a clear gap; without one, the order with the minimum description length.

            N log(cost / N) + parameters log N

        Source: J. Rissanen, "Modeling by shortest data description", Automatica 14 (1978) 465-471, doi
        10.1016/0005-1098(78)90005-5.
        """
        if self.clear:
            return self.orders[int(np.flatnonzero(self.gaps >= CLEAR_GAP)[-1])]
        N = float(self.samples)
        length = N * np.log(np.maximum(self.costs, 1e-300) / N) + self.parameters * np.log(N)
        return self.orders[int(np.argmin(length))]


def study_orders(points: Points, subspace: Subspace, through: Feedthrough, orders: tuple[int, ...]) -> OrderStudy:
    """Compare the models of several orders that one subspace gives.

    Args:
        points: Response values.
        subspace: Subspace of the response.
        through: Direct terms and lags.
        orders: Even numbers of states in increasing order.
    """
    values = subspace.values
    found = [start(points, subspace, order, through)[0] for order in orders]
    p, m = through.direct.shape
    return OrderStudy(
        orders,
        np.array([solution.cost for solution in found]),
        np.array([values[order - 1] / max(values[order], 1e-12 * values[0]) for order in orders]),
        tuple(solution.blocks.poles for solution in found),
        2 * int(points.known.sum()),
        np.array([order * (p + m) + through.count for order in orders]),
    )


def start(points: Points, subspace: Subspace, order: int, through: Feedthrough) -> tuple[Solution, int]:
    """Return the subspace's model of an order and the number of unstable poles that were mirrored."""
    blocks, C, mirrored = subspace.blocks(order)
    return evaluate(points, solve_inputs(points, blocks, C, through), through), mirrored


def description_length(solution: Solution, points: Points) -> float:
    """Return the description length of a model as defined in `OrderStudy.suggested`."""
    N = 2.0 * float(points.known.sum())
    p, m = solution.through.direct.shape
    parameters = solution.blocks.states * (p + m) + solution.through.count
    return float(N * np.log(max(solution.cost, 1e-300) / N) + parameters * np.log(N))
