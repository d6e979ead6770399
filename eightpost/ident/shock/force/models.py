"""The force models of a fit: one for each order of the curve and each way that its cubics join."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.basis import CurveBasis, working_basis
from eightpost.ident.shock.force.force_model import ForceModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import Join
    from eightpost.ident.shock.force.dynamics import Dynamics
    from eightpost.ident.shock.force.gas import GasColumns
    from eightpost.ident.shock.record.runs import Runs

    Array = NDArray[np.float64]

#: Fewest samples that an outer cubic is fitted to; with fewer it is the straight continuation of the inner part.
FEWEST_OUTER = 50


@dataclass(frozen=True, eq=False)
class Models:
    """Force models over the same runs.

    Attributes:
        runs: The records.
        gas: Columns of the gas force.
        dynamics: Of the law.
    """

    runs: Runs
    gas: GasColumns
    dynamics: Dynamics

    def __call__(self, join: Join, order: int) -> ForceModel:
        """Return the model of a join and an order; sides that have too few samples are straight."""
        basis = working_basis(self.curve, self.runs.velocity, self._ties(join, order))
        return ForceModel(self.runs, basis, self.gas, self.dynamics)

    @property
    def curve(self) -> CurveBasis:
        """The functions of the curve at the runs' transition."""
        return CurveBasis(self.runs.first.transition_speed, self.runs.first.transition_width)

    def rows_by_order(self, time_constant: float | None) -> Callable[[int], Array]:
        """Return what gives the columns (R, n) of an order at the rows, behind one lag [s] if given."""
        runs = self.runs
        design = self.curve.design(runs.velocity).T
        rows = [
            f.rows_of(f.spectrum(design[:, part]), time_constant=time_constant).T
            for f, part in zip(runs.filters, runs.parts, strict=True)
        ]
        all_rows, gas = np.concatenate(rows), runs.rows(self.gas.columns.T).T
        return lambda order: np.hstack([all_rows @ self._ties("slope", order), gas])

    def _ties(self, join: Join, order: int) -> Array:
        compression, rebound = ("straight" if side in self.straight else join for side in ("compression", "rebound"))
        return self.curve.ties(compression=compression, rebound=rebound, order=order)

    @cached_property
    def straight(self) -> dict[str, int]:
        """The sides, with their samples beyond the transition, that have too few for a cubic."""
        velocity = self.runs.velocity[self.runs.inside]
        beyond = {
            "compression": int(np.sum(velocity > self.curve.transition_speed)),
            "rebound": int(np.sum(velocity < -self.curve.transition_speed)),
        }
        return {side: count for side, count in beyond.items() if count < FEWEST_OUTER}

    @property
    def changes(self) -> list[str]:
        """A sentence for each side that is straight."""
        return [
            f"straight line instead of the cubic in {side}: {count} samples beyond the transition, "
            f"{FEWEST_OUTER} are needed"
            for side, count in self.straight.items()
        ]
