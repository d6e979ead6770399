"""A first force model that is accurate enough to find outlying samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.force.gas import gas_columns
from eightpost.ident.shock.force.limits import limits_for
from eightpost.ident.shock.force.models import Models
from eightpost.ident.shock.laws.closed import FullLag
from eightpost.ident.shock.laws.projection import best_lag

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.record.runs import Runs

    Array = NDArray[np.float64]

#: Order of the inner polynomial.
_ORDER = 5


def screened_force(runs: Runs) -> list[Array]:
    """Return the force of a single-lag model (N,) [N] over each run."""
    limits = limits_for(runs.measured, runs.rate)
    model = Models(runs, gas_columns(runs, "estimate")[0], FullLag(limits))("slope", _ORDER)
    force = model.force(best_lag(model, limits.time_constant))
    return [np.asarray(force[part]) for part in runs.parts]
