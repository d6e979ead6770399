"""What a recipe hands back, and how well its parameters are determined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force_model import ForceModel

    Array = NDArray[np.float64]

#: Singular values of the scaled Jacobian below this share of the largest are directions without information.
_NO_INFORMATION = 1e-7


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


def linear_solution(columns: Array, target: Array) -> Array:
    """Return the least-squares weights (n,) of columns (N, n) for a target (N,), by singular values."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    weights, *_ = np.linalg.lstsq(columns / size, target, rcond=1e-12)
    return np.asarray(weights / size, dtype=np.float64)


def covariance(jacobian: Array, residual: Array, independent: float) -> Array:
    """Return the covariance (n, n) of parameters from a Jacobian (N, n) and a residual (N,) at the solution.

        C = sum r^2 / (M - n) (J'J)^-1

    with M independent samples instead of N: neighbours in a low-passed record say the same. What the record does
    not determine is NaN.

    Args:
        jacobian: (N, n).
        residual: (N,).
        independent: M, twice the cut-off times the duration [1].
    """
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    _, strength, directions = np.linalg.svd(jacobian / size, full_matrices=False)
    known = strength > _NO_INFORMATION * strength[0]
    unknown = 1.0 - np.sum(directions[known] ** 2, axis=0)
    inverse = (directions[known].T / strength[known] ** 2) @ directions[known] / np.outer(size, size)
    freedom = max(independent - jacobian.shape[1], 1.0)
    result = float(residual @ residual) / freedom * inverse
    result[unknown > 1e-6], result[:, unknown > 1e-6] = np.nan, np.nan
    return np.asarray(result, dtype=np.float64)


def independent_samples(model: ForceModel) -> float:
    """Return how many independent samples the low-passed segment holds: 2 * cut-off * duration [1]."""
    prepared = model.prepared
    return 2.0 * prepared.cutoff * float(np.sum(prepared.inside)) * prepared.step
