"""What a recipe hands back."""

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
    """Parameters of a force model that a recipe arrived at.

    Attributes:
        model: The force model, with the gas columns that were left in.
        parameters: (n + g + k,) curve, gas, theta.
        covariance: (n + g + k, n + g + k); NaN rows for what the record does not determine or the recipe held.
        converged: Whether the optimiser ended at a minimum.
        status: What happened, in words.
        notes: What the recipe changed on its way, a sentence each.
    """

    model: ForceModel
    parameters: Array
    covariance: Array
    converged: bool
    status: str
    notes: tuple[str, ...] = ()
