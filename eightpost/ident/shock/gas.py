"""The gas force F_0 + K (x - x_ref) of records (Eq 3.14) as columns of the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.runs import Runs

#: Treatment of the gas force in a force channel; see `Choices`.
GasTreatment = Literal["estimate", "included", "subtracted"]


@dataclass(frozen=True, slots=True, eq=False)
class GasColumns:
    """Columns of the gas force over all N samples of the runs, of unit size."""

    columns: Array  #: Columns (N, g): empty, or an offset per run and, if fitted, (x - x_ref) / size.
    offsets: int  #: Number of offsets.
    size: float | None  #: Standard deviation of the displacement [m] if a stiffness is fitted; else None.
    reference: float  #: x_ref [m].

    @property
    def count(self) -> int:
        """The number of columns."""
        return int(self.columns.shape[1])

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters that the columns determine."""
        return (("gas_preload",) if self.offsets else ()) + (("gas_stiffness",) if self.size else ())

    @property
    def to_values(self) -> Array:
        """The matrix (., g) from the columns' weights [N] to preload [N] and, if fitted, stiffness [N/m]."""
        matrix = np.zeros((len(self.names), self.count))
        matrix[:1, : self.offsets] = 1.0 / max(self.offsets, 1)
        if self.size:
            matrix[-1, -1] = 1.0 / self.size
        return matrix

    def values(self, weights: Array) -> tuple[float, float]:
        """Return preload [N], the mean of the runs, and stiffness [N/m]; 0 if not fitted."""
        found = dict(zip(self.names, (self.to_values @ weights).tolist(), strict=True))
        return found.get("gas_preload", 0.0), found.get("gas_stiffness", 0.0)

    def without_stiffness(self) -> GasColumns:
        """Return the columns without the stiffness."""
        return GasColumns(self.columns[:, : self.offsets], self.offsets, None, self.reference)


def gas_columns(runs: Runs, treatment: str) -> tuple[GasColumns, list[str]]:
    """Return the columns for a treatment of the gas force, and a sentence about anything that cannot be estimated.

    The stiffness needs a displacement and a record with more than one frequency: in a single sine a spring force and a
    lag cannot be distinguished (F_lag of c v is a spring of -c tau omega^2).
    """
    count = runs.velocity.size
    if treatment == "subtracted":
        return GasColumns(np.empty((count, 0)), 0, None, _reference(runs)), []
    offsets = np.zeros((count, len(runs.parts)))
    for number, part in enumerate(runs.parts):
        offsets[part, number] = 1.0
    offsets_only = GasColumns(offsets, len(runs.parts), None, _reference(runs))
    if any("displacement" not in p.record for p in runs.prepared):
        return offsets_only, ["gas stiffness fixed at 0: the record has no displacement"]
    frequencies = [p.single_frequency for p in runs.prepared]
    if len(frequencies) == 1 and frequencies[0] is not None:
        return offsets_only, [
            f"gas stiffness fixed at 0: the record is essentially one sine of {frequencies[0]:.3g} Hz, "
            "in which a spring force and a lag cannot be distinguished; the lag includes both"
        ]
    displacement = np.concatenate(
        [p.record["displacement"] + (p.reference - offsets_only.reference) for p in runs.prepared]
    )
    size = float(displacement[runs.inside].std())
    return GasColumns(
        np.column_stack([offsets, displacement / size]), offsets_only.offsets, size, offsets_only.reference
    ), []


def _reference(runs: Runs) -> float:
    """Return the reference displacement of the gas force [m], the mean of the runs."""
    return float(np.mean([p.reference for p in runs.prepared]))
