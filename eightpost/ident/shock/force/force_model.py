"""The predicted force of a fit as a function of all parameters at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import WorkingBasis
    from eightpost.ident.shock.force.dynamics import Dynamics
    from eightpost.ident.shock.force.gas import GasColumns
    from eightpost.ident.shock.record.runs import Runs
    from eightpost.ident.shock.record.spectral import Spectrum

    Array = NDArray[np.float64]


#: Lowest rate of a thinned record [Hz].
_COARSE_RATE = 500.0


@dataclass(frozen=True, eq=False)
class ForceModel:
    """F(b, g, theta) = valve(curve @ b, theta) + gas @ g over runs of N samples and R low-passed rows.

    Attributes:
        runs: The records.
        basis: Basis of the curve, n columns.
        gas: Columns of the gas force.
        dynamics: Dynamics of the law.
    """

    runs: Runs
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
        """Curve and gas columns together (N, n + g)."""
        return np.hstack([self.basis.columns, self.gas.columns])

    @cached_property
    def gas_rows(self) -> Array:
        """The gas columns at the rows (R, g)."""
        return self.runs.rows(self.gas.columns.T).T

    @cached_property
    def _spectra(self) -> tuple[Spectrum, ...]:
        columns = self.basis.columns.T
        return tuple(f.spectrum(columns[:, part]) for f, part in zip(self.runs.filters, self.runs.parts, strict=True))

    def curve_rows(self, time_constant: float | None = None) -> Array:
        """Return the curve's columns at the rows (R, n), all behind the same lag if a time constant [s] is given."""
        pairs = zip(self.runs.filters, self._spectra, strict=True)
        return np.concatenate([f.rows_of(s, time_constant=time_constant).T for f, s in pairs])

    def lagged_rows(self, b: Array, time_constant: float) -> Array:
        """Return the static force of a curve b at the rows (R,) [N], behind a lag with a time constant [s]."""
        pairs = zip(self.runs.filters, self._spectra, strict=True)
        return np.concatenate([f.rows_of(b @ s, time_constant=time_constant) for f, s in pairs])

    def static(self, b: Array) -> Array:
        """Return F_s (N,) [N] of a curve b."""
        return np.asarray(self.basis.columns @ b)

    def force(self, parameters: Array) -> Array:
        """Return the force (N,) [N], before any low-pass."""
        b, g, theta = self.split(parameters)
        return self.dynamics.force(self, b, theta) + self.gas.columns @ g

    def rows(self, parameters: Array) -> Array:
        """Return the low-passed force at the rows (R,) [N]."""
        b, g, theta = self.split(parameters)
        return self.dynamics.rows(self, b, theta) + self.gas_rows @ g

    def rows_jacobian(self, parameters: Array) -> Array:
        """Return the derivative (R, n + g + k) of `rows`."""
        b, _, theta = self.split(parameters)
        by_curve, by_theta = self.dynamics.rows_jacobian(self, b, theta)
        return np.hstack([by_curve, self.gas_rows, by_theta])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters; only a gas stiffness and theta are bounded."""
        low, high = self.dynamics.bounds()
        lowest = np.full(self.linear_count, -np.inf)
        if self.gas.size:
            lowest[-1] = 0.0
        return np.append(lowest, low), np.append(np.full(self.linear_count, np.inf), high)

    def scale(self) -> Array:
        """Return the typical size of a change of the parameters."""
        return np.append(np.full(self.linear_count, self.runs.deviation), self.dynamics.scale())

    def split(self, parameters: Array) -> tuple[Array, Array, Array]:
        """Return curve (n,), gas (g,) and theta (k,)."""
        b, g, theta = np.split(parameters, (self.curve_count, self.linear_count))
        return b, g, theta

    def thinned(self, by: int) -> ForceModel:
        """Return the model on every `by`-th sample, at the same rows: cheaper, and accurate enough to find starts."""
        runs, kept = self.runs.thinned(by)
        basis = replace(self.basis, columns=np.asfortranarray(self.basis.columns[kept]))
        return replace(self, runs=runs, basis=basis, gas=replace(self.gas, columns=self.gas.columns[kept]))

    @cached_property
    def coarse(self) -> ForceModel:
        """The model on a record thinned to about 500 Hz, at the same rows, at a quarter of the cost."""
        every = [f.every for f in self.runs.filters]
        shared = [k for k in range(1, min(every) + 1) if all(e % k == 0 for e in every)]
        by = max((k for k in shared if self.runs.rate / k >= _COARSE_RATE), default=1)
        return self if by == 1 else self.thinned(by)

    def has_curve_of(self, other: ForceModel) -> bool:
        """Return whether the curve parameters of another model, which may be thinned, have the same meaning here."""
        return self.basis.to_curve is other.basis.to_curve

    def with_dynamics(self, dynamics: Dynamics) -> ForceModel:
        """Return the model of another law on the same curve; computed values of the curve are kept."""
        other = self._with_kept(replace(self, dynamics=dynamics))
        if "coarse" in self.__dict__ and self.coarse is not self:
            other.__dict__["coarse"] = self.coarse.with_dynamics(dynamics)
        return other

    def weighted(self, weights: Array) -> ForceModel:
        """Return the model with other weights (R,) of the rows; computed values of the curve are kept."""
        other = self._with_kept(replace(self, runs=self.runs.weighted(weights)))
        if "coarse" in self.__dict__ and self.coarse is not self:
            other.__dict__["coarse"] = self.coarse.weighted(weights)
        return other

    def _with_kept(self, other: ForceModel) -> ForceModel:
        kept = ("gas_rows", "_spectra")
        other.__dict__.update({name: self.__dict__[name] for name in kept if name in self.__dict__})
        return other
