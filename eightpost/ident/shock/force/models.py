"""The force models of a fit: one for each order of the curve and each type of join of its cubics."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.basis import CurveBasis, working_basis
from eightpost.ident.shock.force.force_model import ForceModel
from eightpost.shock.curve import INNER_ORDER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import Join
    from eightpost.ident.shock.force.dynamics import Dynamics
    from eightpost.ident.shock.force.gas import GasColumns
    from eightpost.ident.shock.record.runs import Runs

    Array = NDArray[np.float64]

#: Minimum number of samples for fitting an outer cubic; with fewer the inner polynomial continues as a straight line.
FEWEST_OUTER = 50


@dataclass(frozen=True, eq=False)
class Models:
    """Force models over the same runs.

    Attributes:
        runs: The records.
        gas: Columns of the gas force.
        dynamics: Dynamics of the law.
    """

    runs: Runs
    gas: GasColumns
    dynamics: Dynamics
    _models: dict[tuple[Join, int], ForceModel] = field(default_factory=dict, repr=False)

    def __call__(self, join: Join, order: int) -> ForceModel:
        """Return the model of a join and an order, computed once; sides with too few samples are straight."""
        found = self._models.get((join, order))
        if found is None:
            basis = working_basis(self.curve, self.runs.velocity, self._ties(join, order))
            found = ForceModel(self.runs, basis, self.gas, self.dynamics)
        elif found.runs.weights is not self.runs.weights:
            found = found.weighted(self.runs.weights)
        self._models[join, order] = found
        return found

    def weighted(self, weights: Array) -> Models:
        """Return the models with other weights (R,) of the rows; computed values of their curves are kept."""
        return replace(self, runs=self.runs.weighted(weights))

    @property
    def curve(self) -> CurveBasis:
        """The basis functions of the curve with the transition of the runs."""
        return CurveBasis(self.runs.first.transition_speed, self.runs.first.transition_width)

    def order_rows(self, time_constant: float | None) -> Array:
        """Return columns (R, n) at the rows, behind a lag [s] if given; lower orders leave out the last columns.

        Gas and outer cubics, which join in value and slope, come first, then the powers of the inner polynomial.
        """
        runs, ties = self.runs, self._ties("slope", INNER_ORDER)
        design = self.curve.design(runs.velocity).T
        rows = [
            f.rows_of(f.spectrum(design[:, part]), time_constant=time_constant).T
            for f, part in zip(runs.filters, runs.parts, strict=True)
        ]
        powers, cubics = np.split(np.concatenate(rows) @ ties, [INNER_ORDER], axis=1)
        return np.hstack([runs.rows(self.gas.columns.T).T, cubics, powers])

    def _ties(self, join: Join, order: int) -> Array:
        compression, rebound = ("straight" if side in self.straight else join for side in ("compression", "rebound"))
        return self.curve.ties(compression=compression, rebound=rebound, order=order)

    @cached_property
    def straight(self) -> dict[str, int]:
        """Each side with too few samples beyond the transition for a cubic, with the number of these samples."""
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
