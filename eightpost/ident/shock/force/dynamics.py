"""Interface of a law's dynamics for the fit: the force and its derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.limits import Limits
    from eightpost.shock import Port, ShockLaw, StaticCurve

    Array = NDArray[np.float64]


class Dynamics(ABC):
    """A law without its curve: its parameters theta (k,) inside box bounds, and their effect on the force.

    theta is what the optimiser changes; `values` are the law's own parameters, in the order of `names`.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    limits: Limits

    @abstractmethod
    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return the valve force (N,) [N] of a curve b, before any low-pass."""

    @abstractmethod
    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return the valve force at the rows (R,) [N]."""

    @abstractmethod
    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives of `rows` by b (R, n) and by theta (R, k)."""

    @abstractmethod
    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law with its curve and port."""

    @property
    def needs_rise(self) -> bool:
        """Whether the law needs a curve that rises everywhere."""
        return False

    def sketched_on(self, model: ForceModel) -> ForceModel:
        """Return the model, on the thinned record, that finds starting points, shape and outliers."""
        return model.coarse

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta (k,)."""
        return np.empty(0), np.empty(0)

    def scale(self) -> Array:
        """Return the typical size of a change of theta (k,)."""
        return np.empty(0)

    def values(self, theta: Array) -> Array:
        """Return the law's own parameters (k,), SI."""
        return theta

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta (k, k)."""
        return np.eye(theta.size)

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of the law's own parameters."""
        return ()

    def changes(self) -> tuple[str, ...]:
        """Return a sentence for each bound that is not the dissertation's."""
        return ()

    def like_lpf1(self, model: ForceModel, lpf1: Array) -> Array:
        """Return the theta whose force is closest to that of LPF1's parameters (n + g + 1,)."""
        return lpf1[-1:]

    def starts(self, model: ForceModel, lpf1: Array, count: int) -> list[Array]:
        """Return further starting points (n + g + k,) from LPF1's parameters, the best first."""
        return []
