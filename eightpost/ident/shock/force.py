"""Force model of a fit: static curve and law of all runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.errors import ParameterError
from eightpost.ident.shock.curve import CurveBasis, CurveKind, Join, WorkingBasis, knot_basis, working_basis
from eightpost.ident.shock.gas import GasColumns
from eightpost.ident.shock.limits import Limits
from eightpost.ident.shock.runs import Runs
from eightpost.shock import Port, ShockLaw, StaticCurve
from eightpost.shock.curve import INNER_ORDER

# ---- Linear least squares by singular values ------------------------------------------------------------------------


def linear_solution(columns: Array, target: Array) -> Array:
    """Return the weights (n,) of columns (N, n) that fit a target (N,) by least squares, using singular values."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    weights, *_ = np.linalg.lstsq(columns / size, target, rcond=1e-12)
    return np.asarray(weights / size, dtype=np.float64)


# ---- Interface of a law's dynamics for the fit ----------------------------------------------------------------------


class Dynamics(ABC):
    """A law without its curve: its parameters theta (k,) inside box bounds, and their effect on the force.

    theta is what the optimiser changes; `values` are the law's own parameters, in the order of `names`.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    #: Whether starting points, shape and outliers are found on a thinned record.
    is_costly: bool = True
    limits: Limits
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
            what = f"the fitted law is not valid: {error}; or fit more of the record (--segment)"
            raise ParameterError(what) from error

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


# ---- The force models of a fit --------------------------------------------------------------------------------------

#: Minimum number of samples for fitting an outer cubic; with fewer the inner polynomial continues as a straight line.
FEWEST_OUTER = 50


@dataclass(frozen=True, eq=False)
class Models:
    """Force models over the same runs.

    Attributes:
        runs: The records.
        gas: Columns of the gas force.
        dynamics: Dynamics of the law.
        kind: Kind of the curve.
    """

    runs: Runs
    gas: GasColumns
    dynamics: Dynamics
    kind: CurveKind = "polynomial"
    _models: dict[tuple[Join, int], ForceModel] = field(default_factory=dict, repr=False)

    def __call__(self, join: Join, order: int) -> ForceModel:
        """Return the model of a join and an order, computed once; sides with too few samples are straight.

        A curve through knots has neither: all are the same model.
        """
        key: tuple[Join, int] = ("slope", INNER_ORDER) if self.kind == "knots" else (join, order)
        found = self._models.get(key)
        if found is None:
            found = ForceModel(self.runs, self._basis(*key), self.gas, self.dynamics)
        elif found.runs.weights is not self.runs.weights:
            found = found.weighted(self.runs.weights)
        self._models[key] = found
        return found

    def _basis(self, join: Join, order: int) -> WorkingBasis:
        if self.kind == "knots":
            return knot_basis(self.runs.velocity, self.runs.inside)
        return working_basis(self.curve, self.runs.velocity, self._ties(join, order))

    def weighted(self, weights: Array) -> Models:
        """Return the models with other weights (R,) of the rows; computed values of their curves are kept."""
        return replace(self, runs=self.runs.weighted(weights))

    @property
    def curve(self) -> CurveBasis:
        """The basis functions of the curve with the transition of the runs."""
        return CurveBasis(self.runs.first.transition_speed, self.runs.first.transition_width)

    def order_rows(self, time_constant: float | None) -> Array:
        """Return columns (R, n) at the rows, behind a lag [s] if given; lower orders leave out the last columns.

        Gas and outer cubics, which join in value and slope, come first, then the powers of the inner polynomial.
        """
        runs, ties = self.runs, self._ties("slope", INNER_ORDER)
        design = self.curve.design(runs.velocity).T
        rows = [
            f.rows_of(f.spectrum(design[:, part]), time_constant=time_constant).T
            for f, part in zip(runs.filters, runs.parts, strict=True)
        ]
        powers, cubics = np.split(np.concatenate(rows) @ ties, [INNER_ORDER], axis=1)
        return np.hstack([runs.rows(self.gas.columns.T).T, cubics, powers])

    def _ties(self, join: Join, order: int) -> Array:
        compression, rebound = ("straight" if side in self.straight else join for side in ("compression", "rebound"))
        return self.curve.ties(compression=compression, rebound=rebound, order=order)

    @cached_property
    def straight(self) -> dict[str, int]:
        """Each side with too few samples beyond the transition for a cubic, with the number of these samples."""
        velocity = self.runs.velocity[self.runs.inside]
        beyond = {
            "compression": int(np.sum(velocity > self.curve.transition_speed)),
            "rebound": int(np.sum(velocity < -self.curve.transition_speed)),
        }
        return {side: count for side, count in beyond.items() if count < FEWEST_OUTER}

    @property
    def changes(self) -> list[str]:
        """A sentence for each side that is straight."""
        if self.kind == "knots":
            return []
        return [
            f"straight line instead of the cubic in {side}: {count} samples beyond the transition, "
            f"{FEWEST_OUTER} are needed"
            for side, count in self.straight.items()
        ]
