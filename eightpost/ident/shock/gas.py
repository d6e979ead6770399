"""The gas force F_0 + K (x - x_ref) of a record (Eq 3.14), as columns of the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.preparation import Prepared

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GasColumns:
    """Columns of the gas force over a record of N samples, of unit size.

    Attributes:
        columns: (N, g): none, [1], or [1, (x - x_ref) / size].
        sizes: (g,) [1, m].
    """

    columns: Array
    sizes: Array

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.sizes.size)

    def values(self, weights: Array) -> tuple[float, float]:
        """Return preload [N] and stiffness [N/m] of the columns' weights (g,) [N]; what is not there is 0."""
        preload, stiffness = np.pad(weights / self.sizes, (0, 2 - self.count))
        return float(preload), float(stiffness)

    def without_stiffness(self) -> GasColumns:
        """Return the columns without the stiffness."""
        return GasColumns(self.columns[:, :1], self.sizes[:1])


def gas_columns(prepared: Prepared, treatment: str) -> tuple[GasColumns, list[str]]:
    """Return the columns that a treatment of the gas force needs, and a sentence for what cannot be estimated.

    The stiffness needs a displacement, and a record of more than one frequency: in a single sine a spring force
    and a lag look alike (F_lag of c v is a spring of -c tau omega^2).
    """
    count = len(prepared.record)
    if treatment == "subtracted":
        return GasColumns(np.empty((count, 0)), np.empty(0)), []
    if "displacement" not in prepared.record:
        why = "gas stiffness held at 0: the record has no displacement"
        return GasColumns(np.ones((count, 1)), np.ones(1)), [why]
    displacement = prepared.record["displacement"]
    size = float(displacement[prepared.inside].std())
    columns = GasColumns(np.column_stack([np.ones(count), displacement / size]), np.array([1.0, size]))
    if prepared.single_frequency is not None:
        why = (
            f"gas stiffness held at 0: the record is essentially one sine of {prepared.single_frequency:.3g} Hz, "
            "in which a spring force and a lag look alike; the lag holds both"
        )
        return columns.without_stiffness(), [why]
    return columns, []
