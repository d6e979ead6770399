"""Maxwell's law in the fit: stepped by its own functions, its derivatives from its equation.

With F = f(w) and dF/dt = k (v - w), a change D of the force obeys, to first order,

    tau dD/dt = change of f at w - D + f'(w) (v - w) dk/k,   tau = f'(w) / k

a first-order lag that varies: one pass over the record gives the derivatives by all parameters at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.laws.compiled import lagged_columns
from eightpost.ident.shock.laws.stepped import SteppedLaw

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]

#: Points of the table of the curve that w is looked up in.
_TABLE = 4001


@dataclass(frozen=True)
class SeriesSpring(SteppedLaw):
    """Maxwell: theta = (ln k,), k [N/m] the stiffness in series with the valves."""

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """By one pass of a lag that varies over the curve's columns at w."""
        force, stiffness = self.force(model, b, theta), float(np.exp(theta[0]))
        through, slope = _through_valves(model, b, force)
        strain = slope * (model.runs.velocity - through)
        columns = np.column_stack([model.basis.at(through), strain])
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        lagged = [lagged_columns(columns[part], slope[part] / stiffness, p.step) for p, part in pairs]
        rows = model.runs.rows(np.concatenate(lagged).T).T
        return rows[:, :-1], rows[:, -1:]

    def like_lpf1(self, model: ForceModel, lpf1: Array) -> Array:
        """k = slope / tau, the slope being the curve's mean over the samples."""
        b = lpf1[: model.curve_count]
        _, slope = _through_valves(model, b, model.static(b))
        low, high = self.bounds()
        return np.clip(np.log([float(slope.mean()) / float(lpf1[-1])]), low, high)


def _through_valves(model: ForceModel, b: Array, force: Array) -> tuple[Array, Array]:
    """Return the velocity w (N,) [m/s] at which a curve b gives a force (N,) [N], and its slope f'(w) there."""
    velocity = np.linspace(model.runs.velocity.min(), model.runs.velocity.max(), _TABLE)
    static = model.basis.at(velocity) @ b
    slope = np.maximum(np.gradient(static, velocity), 1.0)
    # A curve on its way to its minimum may fall: what is looked up in must not.
    rising = np.maximum.accumulate(static) + 1e-9 * np.arange(_TABLE)
    through = np.interp(force, rising, velocity)
    return through, np.interp(through, velocity, slope)
