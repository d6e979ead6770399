"""Force model of a fit: static curve and law of all runs, gas force, bounds of the law's own parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.shock.curve import WorkingBasis
from eightpost.ident.shock.runs import Runs
from eightpost.shock import Port, ShockLaw, StaticCurve
from eightpost.units import convert

# ==== Gas force F_0 + K (x - x_ref) of records (Eq 3.14) as columns of the fit =======================================

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


# ==== Bounds of a law's own parameters, from the record ==============================================================

_POUND = convert(1.0, "lbf", "N")

#: tau [s], transition forces [N] and their minimum distance [N] of 3.3.3: 0.1 to 10 ms, 10 to 1000 lbf, 1 lbf.
TIME_CONSTANT, FORCE, GAP = (1e-4, 1e-2), (10.0 * _POUND, 1000.0 * _POUND), _POUND

#: A record below this rate [Hz] may show longer lags, so the bound is raised to this [s]. Measured ones reach 30 ms.
_SLOW_RATE, _LONG_LAG = 1000.0, 5e-2

#: Lower bound of tau as a share of the sampling interval.
_SHORTEST_SHARE = 0.1

#: Upper bound of the transition forces over the record's peak force, so that alpha = 1 can be reached everywhere.
_HEADROOM = 2.0


@dataclass(frozen=True, slots=True)
class LawLimits:
    """Bounds of the dynamic parameters."""

    time_constant: tuple[float, float]  #: Lowest and highest tau [s].
    force: tuple[float, float]  #: Lowest and highest transition force [N].
    gap: float  #: Minimum distance of the two transition forces [N].
    lag_changes: tuple[str, ...] = ()  #: A sentence for each bound of tau that is not the dissertation's.
    #: A sentence for each bound of the transition forces that is not the dissertation's.
    force_changes: tuple[str, ...] = ()


def limits_for(force: Array, rate: float, *, ceiling: float = float("inf")) -> LawLimits:
    """Return the bounds that suit a record.

    Args:
        force: Measured force (N,) [N].
        rate: Sampling rate [Hz].
        ceiling: Upper bound of the transition forces for any record [N].
    """
    peak = float(np.abs(force - force.mean()).max())
    time_constant, lag_changes = _time_constant(rate)
    forces, gap = (min(FORCE[0], 0.1 * peak), min(_HEADROOM * peak, ceiling)), min(GAP, 0.05 * peak)
    return LawLimits(time_constant, forces, gap, lag_changes, _force_changes(forces, gap, peak))


def _time_constant(rate: float) -> tuple[tuple[float, float], tuple[str, ...]]:
    lowest, highest = max(TIME_CONSTANT[0], _SHORTEST_SHARE / rate), TIME_CONSTANT[1]
    changes = []
    if lowest > TIME_CONSTANT[0] * (1.0 + 1e-9):
        why = "a tenth of the record's sampling interval"
        changes.append(f"shortest tau {1e3 * lowest:.3g} ms instead of 0.1 ms: {why}")
    if rate < _SLOW_RATE:
        highest = _LONG_LAG
        changes.append(f"longest tau {1e3 * highest:.3g} ms instead of 10 ms: the record is sampled at {rate:.4g} Hz")
    if lowest >= highest:
        raise ParameterError(
            f"the record is sampled at {rate:.4g} Hz; a lag of at most {1e3 * highest:.3g} ms cannot be found below "
            f"{_SHORTEST_SHARE / highest:.3g} Hz. If time is in ms but labelled s, set its unit in a channel map; "
            "otherwise record at a higher rate"
        )
    return (lowest, highest), tuple(changes)


def _force_changes(forces: tuple[float, float], gap: float, peak: float) -> tuple[str, ...]:
    changes, why = [], f"the record's force peaks at {_force(peak)} about its mean"
    if forces[0] < FORCE[0]:
        changes.append(f"lowest transition force {_force(forces[0])} instead of 10 lbf: {why}")
    if forces[1] != FORCE[1]:
        changes.append(f"highest transition force {_force(forces[1])} instead of 1000 lbf: {why}")
    if gap < GAP:
        changes.append(f"transition forces at least {_force(gap)} apart instead of 1 lbf: {why}")
    return tuple(changes)


def _force(force: float) -> str:
    return f"{convert(force, 'N', 'lbf'):.4g} lbf ({force:.4g} N)"


# ==== The model ======================================================================================================

# ---- Interface of a law's dynamics for the fit ----------------------------------------------------------------------


class Dynamics(ABC):
    """A law without its curve: its parameters theta (k,) inside box bounds, and their effect on the force.

    theta is what the optimiser changes; `values` are the law's own parameters, in the order of `names`.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    #: Whether starting points, shape and outliers are found on a thinned record.
    is_costly: bool = True
    limits: LawLimits
    kind: type[ShockLaw] | None

    @abstractmethod
    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return the valve force (N,) [N] of a curve b, before any low-pass."""

    @abstractmethod
    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return the valve force at the rows (R,) [N]."""

    @abstractmethod
    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives of `rows` by b (R, n) and by theta (R, k)."""

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law with its curve and port."""
        assert self.kind is not None, "these dynamics are a step of the fit of another law"
        try:
            return self.kind(curve, *self.values(theta).tolist(), port=port)
        except ValueError as error:
            what = f"the fitted law is not valid: {error}; or fit more of the record (--set segment)"
            raise ParameterError(what) from error

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta (k,)."""
        return np.empty(0), np.empty(0)

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

    def like_full_lag(self, model: ForceModel, full_lag: Array) -> Array:
        """Return the theta whose force is closest to that of LPF1's parameters (n + g + 1,)."""
        return full_lag[-1:]

    def starts(self, model: ForceModel, full_lag: Array, count: int) -> list[Array]:
        """Return further starting points (n + g + k,) from LPF1's parameters, the best first."""
        return []


# ---- The predicted force of a fit as a function of all parameters at once -------------------------------------------

#: Lowest rate of a thinned record [Hz].
_COARSE_RATE = 500.0


@dataclass(frozen=True, eq=False)
class ForceModel:
    """F(b, g, theta) = valve(curve @ b, theta) + gas @ g over runs of N samples and R low-passed rows."""

    runs: Runs  #: The records.
    basis: WorkingBasis  #: Basis of the curve, n columns.
    gas: GasColumns  #: Columns of the gas force.
    dynamics: Dynamics  #: Dynamics of the law.

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

    @property
    def penalty(self) -> Array:
        """The rows (P, n) that penalise the curve's coefficients beside the weighted rows; none for polynomials."""
        return np.asarray(np.sqrt(self.runs.weights.sum()) * self.basis.penalty)

    @cached_property
    def gas_rows(self) -> Array:
        """The gas columns at the rows (R, g)."""
        return self.runs.rows(self.gas.columns.T).T

    @cached_property
    def _spectra(self) -> tuple[Complex, ...]:
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
