"""Static records: measured and predicted outputs while loads are constant (6.1.3, Fig 6.32)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.vehicle.holds import holds
from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

#: Quantities that have a static level.
_STATIC = ("displacement", "tire_force", "ride_height")


@dataclass(frozen=True, slots=True, eq=False)
class StaticOutput:
    """One output over the holds of a static record: times of constant load.

    Attributes:
        name: Name of the output.
        unit: SI unit.
        load: Sum of all loads during each hold, minus the mean over holds (H,) [N or N.m].
        measured: Measured output during each hold, minus the mean over holds (H,).
        predicted: Predicted output during each hold, minus the mean over holds (H,).
    """

    name: str
    unit: str
    load: Array
    measured: Array
    predicted: Array

    @property
    def slopes(self) -> tuple[float, float]:
        """Least-squares change per load, measured and predicted."""
        whole = float(self.load @ self.load)
        if whole == 0.0:
            return 0.0, 0.0
        return float(self.load @ self.measured) / whole, float(self.load @ self.predicted) / whole


def static_outputs(measured: TimeSeries, predicted: TimeSeries, loads: Sequence[str]) -> tuple[StaticOutput, ...]:
    """Return the outputs during the holds; empty if the loads are never constant.

    Args:
        measured: The record.
        predicted: Outputs of the vehicle at the same times.
        loads: Names of the loads.
    """
    there = [name for name in loads if name in measured]
    if not there:
        return ()
    rows = np.stack([measured[name] for name in there])
    held = holds(rows, measured.sample_rate)
    if len(held) < 2:
        return ()
    signs = np.sign(rows @ rows[0])  # in pitch and roll some loads pull while others push
    names = [name for name in predicted.names if name in measured and quantity(name) in _STATIC]
    load = _levels(signs @ rows, held)
    return tuple(
        StaticOutput(n, measured.unit(n), load, _levels(measured[n], held), _levels(predicted[n], held)) for n in names
    )


def _levels(values: Array, held: Sequence[slice]) -> Array:
    found = np.array([values[hold].mean() for hold in held])
    return np.asarray(found - found.mean())
