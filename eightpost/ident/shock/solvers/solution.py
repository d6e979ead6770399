"""The solution that a recipe returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Parameters of a force model found by a recipe.

    Attributes:
        model: Force model, with the gas columns that were kept.
        parameters: Parameters (n + g + k,) of curve, gas, theta.
        covariance: Covariance (n + g + k, n + g + k); NaN rows for parameters that are undetermined or were fixed.
        converged: Whether the optimiser ended at a minimum.
        status: Description of how the optimiser ended.
        notes: Changes that the recipe made, one sentence each.
    """

    model: ForceModel
    parameters: Array
    covariance: Array
    converged: bool
    status: str
    notes: tuple[str, ...] = ()
