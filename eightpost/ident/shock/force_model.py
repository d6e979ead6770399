"""The force that a fit predicts, as a function of every parameter at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.lagging import lag

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.basis import WorkingBasis
    from eightpost.ident.shock.dynamics import Dynamics
    from eightpost.ident.shock.gas import GasColumns
    from eightpost.ident.shock.preparation import Prepared

    Array = NDArray[np.float64]

#: Samples per cut-off period that the optimiser looks at: the low-pass leaves 1e-5 at twice the cut-off.
_SAMPLES_PER_PERIOD = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class ForceModel:
    """F(b, g, theta) = valve(curve @ b, theta) + gas @ g over a prepared record of N samples.

    Attributes:
        prepared: The record.
        basis: Of the curve, n columns.
        gas: Columns of the gas force.
        dynamics: Of the law.
    """

    prepared: Prepared
    basis: WorkingBasis
    gas: GasColumns
    dynamics: Dynamics

    @property
    def curve_count(self) -> int:
        """The number n of curve parameters b."""
        return int(self.basis.columns.shape[1])

    @property
    def linear_count(self) -> int:
        """The number of linear parameters (b, g)."""
        return self.curve_count + self.gas.count

    @property
    def linear_columns(self) -> Array:
        """Curve and gas columns side by side (N, n + g)."""
        return np.hstack([self.basis.columns, self.gas.columns])

    @property
    def rows(self) -> NDArray[np.intp]:
        """The samples that an optimiser looks at: inside the segment, thinned to what the low-pass leaves."""
        every = max(int(self.prepared.rate // (_SAMPLES_PER_PERIOD * self.prepared.cutoff)), 1)
        return np.flatnonzero(self.prepared.inside)[::every]

    @property
    def target(self) -> Array:
        """The measured force at `rows` [N]."""
        return np.asarray(self.prepared.record["force"][self.rows])

    def force(self, parameters: Array) -> Array:
        """Return the force (N,) [N]."""
        b, g, theta = self.split(parameters)
        return self.dynamics.blend(self.basis.columns @ b, theta, self.prepared.step).force + self.gas.columns @ g

    def jacobian(self, parameters: Array) -> Array:
        """Return dF/dparameters (N, n + g + k), in closed form."""
        b, _, theta = self.split(parameters)
        columns = self.basis.columns
        blend = self.dynamics.blend(columns @ b, theta, self.prepared.step)
        by_curve = (1.0 - blend.weight + blend.slope)[:, None] * columns
        if theta.size:
            by_curve = by_curve + blend.weight[:, None] * lag(columns, theta[0], self.prepared.step)
        return np.hstack([by_curve, self.gas.columns, blend.partials])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters; only a gas stiffness and theta have any."""
        low, high = self.dynamics.bounds()
        lowest = np.full(self.linear_count, -np.inf)
        if self.gas.count > 1:
            lowest[-1] = 0.0
        return np.append(lowest, low), np.append(np.full(self.linear_count, np.inf), high)

    def scale(self) -> Array:
        """Return the size of a change of the parameters that matters."""
        return np.append(np.full(self.linear_count, self.prepared.deviation), self.dynamics.scale())

    def split(self, parameters: Array) -> tuple[Array, Array, Array]:
        """Return curve (n,), gas (g,) and theta (k,)."""
        b, g, theta = np.split(parameters, (self.curve_count, self.linear_count))
        return b, g, theta
