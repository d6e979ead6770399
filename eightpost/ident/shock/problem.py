"""The problem of a fit of one or more settings, and the uncertainty of its solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import stdtrit

from eightpost.array_types import Array
from eightpost.ident.shock.curve import KnotBasis
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.runs import Runs
from eightpost.least_squares import (
    Directions,
    Minimum,
    Residual,
    linear_solution,
    minimum_from,
    standard_error,
    with_fixed,
)
from eightpost.shock import Port, ShockLaw
from eightpost.shock.curve import KNOTS

# ==== Uncertainty of parameters and curve, valid for correlated residuals ============================================
# The uncertainty follows from the change of the solution when a block of rows is left out (eightpost.least_squares).
#
# A shock that warms or drifts during the test changes its parameters slowly, which blocks of 0.3 s do not show. So the
# same is done with quarters and eighths of the records, and the widest of the three intervals counts.
#
# The parameters are those at the mean temperature of the test, but the shock had other ones. So the residual is also
# regressed on forces that grow with the temperature (with the time, where no temperature was measured), and the change
# of the parameters from the middle of the temperatures to their ends is added to the interval.
#
# Penalties move the solution in the same way in every part of the record. A law with many penalised parameters counts
# as a bias of its intervals what leaving out each penalty would change.

#: Length of a block [s]: ten periods of 20 Hz, and some 30 blocks in the dissertation's nine seconds.
BLOCK = 0.3

#: Minimum number of blocks; shorter records have shorter blocks.
_FEWEST_BLOCKS = 20

#: Numbers of long blocks, which show slow changes: warming, drift, differences between runs.
_LONG = (8, 4)

#: Level of the confidence intervals.
LEVEL = 0.95

#: Level of the intervals of the long blocks. As the widest of three intervals counts, 0.95 for each would cover 99 % of
#: records that do not change; this value covers 97 % of these (docs/explanation/shock_law.md).
_LONG_LEVEL = 0.925

#: Share of the range of the covariate that an interval contains on either side.
_STATES = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class CurveBand:
    """The 95 % band of a static curve, point by point, and that of a factor on each side."""

    velocity: Array  #: Velocities (M,) [m/s].
    force: Array  #: Static forces F_s (M,) [N].
    half_width: Array  #: Half-widths of the band (M,) [N].
    #: Half-widths of the factor on the force in compression and in rebound (2,) [1]; NaN for a side without samples.
    #: See `factor_rows`.
    factors: Array


def blocks_of(runs: Runs) -> list[slice]:
    """Return the blocks of rows that are treated as independent."""
    total = sum(f.rows.size / f.row_rate for f in runs.filters)
    return runs.blocks(min(BLOCK, total / _FEWEST_BLOCKS))


def quantile(runs: Runs) -> float:
    """Return the half-width of a 95 % interval in standard errors: Student's t for the number of blocks."""
    return _student(len(blocks_of(runs)), LEVEL)


def _student(blocks: int, level: float) -> float:
    return float(stdtrit(max(blocks - 1, 1), 0.5 + 0.5 * level))


def covariances(directions: Directions, residual: Array, runs: Runs, penalties: Sequence[Array] = ()) -> Array:
    """Return the covariances (3, n, n) of parameters for short blocks, eighths and quarters of the records.

    Each is scaled so that `quantile(runs)` standard errors are the half-width of its 95 % interval; `standard_error`
    takes the largest.

    Args:
        directions: Directions of the Jacobian (R + T, n) of the residual, followed by rows that are not data.
        residual: Residual (R,) of the fit.
        runs: Records of the fit.
        penalties: Values (P,) of penalties that bias the parameters, in the order of the rows of the Jacobian behind
            those of the data. The bias is added to the half-widths as the root of the sum of squares.
    """
    short = blocks_of(runs)
    found = [directions.covariance(residual, short)]
    for count in _LONG:
        ends = np.linspace(0, residual.size, count + 1).astype(int).tolist()
        widened = (_student(count, _LONG_LEVEL) / _student(len(short), LEVEL)) ** 2
        found.append(widened * directions.covariance(residual, [slice(*pair) for pair in pairwise(ends)]))
    moves = [_drift(directions, residual, runs)[None]]
    if penalties:
        moves.append(_without_penalties(directions, residual, penalties))
    bias = np.vstack(moves) / quantile(runs)
    return np.array(found) + bias.T @ bias


def _drift(directions: Directions, residual: Array, runs: Runs) -> Array:
    """Return the changes of the parameters (n,) from the middle of the covariate, temperature or time, to its ends.

    The residual is regressed on three forces that grow with the covariate: shares of the force in compression and of
    that in rebound, without their mean, and a constant one, which grows within each run only: between runs, their
    offsets follow it. The parameters change as the fit would if the measured force changed so.
    """
    root = np.sqrt(runs.weights)
    within = [c - c.mean() for c in np.split(runs.covariate, np.cumsum([f.rows.size for f in runs.filters])[:-1])]
    covariates = np.column_stack([runs.covariate, runs.covariate, np.concatenate(within)])
    force, compression = runs.target - np.average(runs.target, weights=runs.weights), runs.row_velocity > 0.0
    patterns = np.column_stack([force * compression, force * ~compression, np.ones(force.size)]) * root[:, None]
    rows = directions.left[: residual.size]
    growing = covariates * patterns
    seen = growing - rows @ (rows.T @ growing)  # the fit follows what the parameters can
    gains = linear_solution(seen, -residual, weakest=1e-7)
    change = patterns @ (_STATES * np.ptp(covariates, axis=0) * gains)
    return directions.parameters(rows.T @ change)


def _without_penalties(directions: Directions, residual: Array, penalties: Sequence[Array]) -> Array:
    """Return the changes of the solution (G, n) when each of G penalties is left out, to first order."""
    ends = np.cumsum([residual.size, *(values.size for values in penalties)]).tolist()
    values = np.concatenate([residual, *penalties, np.zeros(len(directions.left) - ends[-1])])
    return directions.moves(values, [slice(*pair) for pair in pairwise(ends)])


def curve_band(columns: Array, samples: Array, b: Array, covariance: Array, velocity: Array, reach: float) -> CurveBand:
    """Return the band of a curve.

    Args:
        columns: Columns (M, n) of the curve at velocities (M,) [m/s].
        samples: Columns (R, n) of the curve at the samples of the records.
        b: Coefficients (n,) of the curve.
        covariance: Covariance (n, n) of b, or several (..., n, n), of which the largest counts at each velocity.
        velocity: Velocities (M,) [m/s].
        reach: Half-width of the band in standard errors.
    """
    factors = standard_error(factor_rows(samples, b), covariance)
    return CurveBand(velocity, columns @ b, reach * standard_error(columns, covariance), reach * factors)


def factor_rows(samples: Array, b: Array) -> Array:
    """Return the factor on the force in compression and in rebound as linear functions (2, n) of the coefficients.

    A change of the curve changes the force at each sample. The factor is the one that comes closest to this change
    (least squares over the samples of a side), so that errors of opposite sign at different velocities cancel as far
    as the covariance of the coefficients says. NaN for a side without samples.
    """
    force = samples @ b
    sides = (np.maximum(force, 0.0), np.minimum(force, 0.0))
    with np.errstate(invalid="ignore"):
        return np.array([side @ samples / (side @ side) for side in sides])


# ==== Models of one or more settings =================================================================================

#: Lowest slope of a curve times the highest speed [N]; it covers rounding. Closer to a bound, a parameter is at it.
CLEAR_SLOPE = 1e-6


@dataclass(frozen=True, eq=False)
class FitModel:
    """Force models of all settings of a shock, with their shared parameters; one record is a fit of one setting.

    Parameters x: for each setting its slopes (K,), gas offsets and own elements of theta, then the shared gas stiffness
    if it is fitted, then the rest of the law's theta, which all settings share.
    """

    models: tuple[ForceModel, ...]  #: Force model of each setting; all have the same knots and the same dynamics.
    local: int = 0  #: Number of leading elements of theta that each setting has for itself.

    @property
    def first(self) -> ForceModel:
        """The model of the first setting, the only one of a single fit."""
        return self.models[0]

    @property
    def dynamics(self) -> Dynamics:
        """The dynamics of the law."""
        return self.first.dynamics

    @property
    def basis(self) -> KnotBasis:
        """The knots of all curves."""
        basis = self.first.basis.curve
        assert isinstance(basis, KnotBasis)
        return basis

    @cached_property
    def places(self) -> tuple[Array, ...]:
        """The indices in x of each model's parameters, in the model's own order."""
        start, curves, thetas, has_stiffness = 0, [], [], self.first.gas.size is not None
        for model in self.models:
            count = model.curve_count + model.gas.offsets
            curves.append(np.arange(start, start + count))
            thetas.append(np.arange(start + count, start + count + self.local))
            start += count + self.local
        stiffness = [np.array([start])] if has_stiffness else []
        shared = start + has_stiffness + np.arange(len(self.dynamics.names))
        return tuple(
            np.concatenate([curve, *stiffness, theta, shared]).astype(int)
            for curve, theta in zip(curves, thetas, strict=True)
        )

    @cached_property
    def size(self) -> int:
        """Number of parameters."""
        return int(max(place.max() for place in self.places)) + 1

    @cached_property
    def runs(self) -> Runs:
        """All runs, in the order of the settings, which differ in temperature: several have none in common."""
        if len(self.models) == 1:
            return self.first.runs
        runs = Runs.of([replace(p, temperature=None) for model in self.models for p in model.runs.prepared])
        return runs.weighted(np.concatenate([model.runs.weights for model in self.models]))

    def rows(self, x: Array) -> Array:
        """Return the low-passed force at the rows (R,) [N]."""
        return np.concatenate([m.rows(x[p]) for m, p in zip(self.models, self.places, strict=True)])

    def error(self, x: Array) -> Array:
        """Return the force error (R,) [N] without weights."""
        return self.rows(x) - self.runs.target

    def scattered(self, rows: Array, number: int) -> Array:
        """Return rows (M, n) of the parameters of a setting as rows of x."""
        scattered = np.zeros((len(rows), self.size))
        scattered[:, self.places[number][: rows.shape[1]]] = rows
        return scattered

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest x; no curve falls."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for model, place in zip(self.models, self.places, strict=True):
            low[place], high[place] = model.bounds()
            low[place[: model.curve_count]] = CLEAR_SLOPE
        return low, high

    def weighted(self, weights: Array) -> FitModel:
        """Return the model with other weights (R,) of the rows."""
        ends = np.cumsum([m.runs.target.size for m in self.models])[:-1]
        parts = zip(self.models, np.split(weights, ends), strict=True)
        return replace(self, models=tuple(model.weighted(part) for model, part in parts))

    def with_dynamics(self, dynamics: Dynamics) -> FitModel:
        """Return the model of another law on the same curves."""
        return replace(self, models=tuple(model.with_dynamics(dynamics) for model in self.models))

    @cached_property
    def coarse(self) -> FitModel:
        """The model on thinned records, at the same rows."""
        return replace(self, models=tuple(model.coarse for model in self.models))


# ==== The solution ===================================================================================================


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Parameters of a force model found by a recipe."""

    model: ForceModel  #: Force model, with the gas columns that were kept.
    parameters: Array  #: Parameters (n + g + k,) of curve, gas, theta.
    #: Covariances (3, n + g + k, n + g + k), see `covariances`; NaN rows for parameters that are undetermined or were
    #: fixed.
    covariance: Array
    converged: bool  #: Whether the optimiser ended at a minimum.
    status: str  #: Description of how the optimiser ended.
    notes: tuple[str, ...] = ()  #: Changes that the recipe made, one sentence each.
    #: Changes of the parameters (B, n + g + k) when each block is left out, see `JointFit`; (0, 0) if they are not
    #: known.
    left_out: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def preload(self) -> float:
        """The gas preload [N], the mean of the runs; 0 if it was subtracted."""
        return self.model.gas.values(self.model.split(self.parameters)[1])[0]


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """The curves of all settings and their law."""

    model: FitModel  #: Model of all settings.
    x: Array  #: Parameters.
    covariance: Array  #: Covariances (3, n, n) of x, see `covariances`.
    converged: bool  #: Whether the search ended at a minimum.
    status: str  #: Description of how the search ended.
    notes: tuple[str, ...] = ()  #: Notes on the choices of the fit, one sentence each.
    #: Changes of x (B, n) of a single setting when each block is left out; (0, n) of several.
    left_out: Array = field(default_factory=lambda: np.empty((0, 0)))

    @classmethod
    def of(
        cls, model: FitModel, x: Array, jacobian: Array, error: Array, penalties: Sequence[Array] = (), **ended: Any
    ) -> JointFit:
        """Return the fit of parameters x with its covariance; for jacobian, error and penalties see `covariances`."""
        directions, runs = Directions.of(jacobian), model.runs
        spread = covariances(directions, error, runs, penalties)
        is_single = len(model.models) == 1
        left_out = directions.moves(error, blocks_of(runs)) if is_single else np.empty((0, x.size))
        return cls(model, x, spread, left_out=left_out, **ended)

    def solution(self, number: int = 0) -> Solution:
        """Return the part of the solution that belongs to a setting."""
        place = self.model.places[number]
        spread, left_out = self.covariance[:, place[:, None], place], self.left_out[:, place]
        x = self.x[place]
        return Solution(self.model.models[number], x, spread, self.converged, self.status, self.notes, left_out)

    def slopes(self, number: int) -> Array:
        """Return the slopes (25,) [N.s/m] of a setting's curve at the knots of `StaticCurve`."""
        model, b = self.model.models[number], self._part(number)[0]
        return self.model.basis.subdivided(model.basis.to_curve @ b)[2]

    def lagged_slopes(self, number: int) -> Array | None:
        """Return the slopes (25,) [N.s/m] of the lagged part of a setting's curve; None for a law without one."""
        theta = self._part(number)[2]
        return np.maximum(theta[:KNOTS], 0.0) / self.model.basis.speed if self.model.local else None

    def law(self, number: int) -> ShockLaw:
        """Return the law of a setting, with the gas force of its records."""
        model = self.model.models[number]
        b, g, theta = self._part(number)
        preload, stiffness = model.gas.values(g)
        curve = self.model.basis.static_curve(model.basis.to_curve @ b)
        return self.model.dynamics.law(curve, Port(gas_preload=preload, gas_stiffness=stiffness), theta)

    def half_width(self, number: int) -> Array:
        """Return the half-width (25,) [N] of the 95 % band of a setting's curve at the knots of `StaticCurve`."""
        model, place = self.model.models[number], self.model.places[number]
        here = place[: model.curve_count]
        velocity = self.model.basis.subdivided(np.zeros(self.model.basis.count))[0]
        errors = standard_error(model.basis.at(velocity), np.nan_to_num(self.covariance[:, here[:, None], here]))
        return quantile(model.runs) * errors

    def _part(self, number: int) -> tuple[Array, Array, Array]:
        return self.model.models[number].split(self.x[self.model.places[number]])


# ==== The nonlinear least-squares problem of laws without a recipe of their own ======================================

#: Maximum number of evaluations of the residual.
_EVALUATIONS = 200

#: Relative decrease of the sum of squares below which the search stops.
TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """Weighted force error of a model at the rows, followed by the penalties of its curves."""

    model: FitModel  #: Model of the force.
    tolerance: float = TOLERANCE  #: Relative decrease of the sum of squares below which the search stops.

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest x."""
        return self.model.bounds()

    def at(self, x: Array) -> Residual:
        """Return the residual (R + P,) [N] at parameters x (n,), with its Jacobian."""
        return Residual(x, self.residual(x), lambda: self.jacobian(x))

    def residual(self, x: Array) -> Array:
        """Return the weighted force error and the penalties (R + P,) [N]."""
        pairs = zip(self.model.models, self.model.places, strict=True)
        penalties = [m.penalty @ x[p[: m.curve_count]] for m, p in pairs]
        return np.concatenate([np.sqrt(self.model.runs.weights) * self.model.error(x), *penalties])

    def jacobian(self, x: Array) -> Array:
        """Return the derivative (R + P, n) of `residual`."""
        rows, penalties, scattered = [], [], self.model.scattered
        for number, (model, place) in enumerate(zip(self.model.models, self.model.places, strict=True)):
            rows.append(scattered(np.sqrt(model.runs.weights)[:, None] * model.rows_jacobian(x[place]), number))
            penalties.append(scattered(model.penalty, number))
        return np.vstack([*rows, *penalties])

    def minimum_from(self, start: Array) -> Minimum[Residual]:
        """Optimise all parameters from a start (n,)."""
        return minimum_from(self, start, tolerance=self.tolerance, evaluations=_EVALUATIONS)

    def fit_at(self, minimum: Minimum[Residual]) -> JointFit:
        """Return the fit of a minimum with its covariance; what is at a bound is fixed."""
        x, (low, high) = minimum.end.parameters, self.bounds()
        fixed = np.eye(x.size)[(x - low < CLEAR_SLOPE) | (high - x < CLEAR_SLOPE)]
        error = minimum.end.residual[: self.model.runs.target.size]
        jacobian = with_fixed(minimum.end.jacobian, fixed)
        return JointFit.of(self.model, x, jacobian, error, converged=minimum.converged, status=minimum.status)
