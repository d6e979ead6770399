"""Model of all files of a shock: a curve for each setting, on the same knots, and one law for all; and its fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.knots import KnotBasis
from eightpost.ident.shock.problem import CLEAR_SLOPE, Inequalities, Solution
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.uncertainty import quantile, standard_error
from eightpost.shock import Port, ShockLaw
from eightpost.shock.curve import KNOTS

#: A slope times the highest speed is at its constraint within this share of the force's standard deviation; in the
#: covariance, a violation of the constraint by 1 N then counts like a force error of this many N everywhere.
_AT_CONSTRAINT, _STIFF = 1e-3, 10.0


@dataclass(frozen=True, eq=False)
class JointModel:
    """Force models of all settings, with their shared parameters.

    Parameters x: for each setting its slopes (K,), gas offsets and own elements of theta, then the shared gas stiffness
    if it is fitted, then the rest of the law's theta, which all settings share.
    """

    models: tuple[ForceModel, ...]  #: Force model of each setting; all have the same knots and the same dynamics.
    local: int = 0  #: Number of leading elements of theta that each setting has for itself.

    @property
    def dynamics(self) -> Dynamics:
        """The dynamics of the law."""
        return self.models[0].dynamics

    @property
    def basis(self) -> KnotBasis:
        """The knots of all curves."""
        found = self.models[0].basis.curve
        assert isinstance(found, KnotBasis)
        return found

    @cached_property
    def places(self) -> tuple[Array, ...]:
        """The indices in x of each model's parameters, in the model's own order."""
        start, local, own, has_stiffness = 0, [], [], self.models[0].gas.size is not None
        for model in self.models:
            count = model.curve_count + model.gas.offsets
            local.append(np.arange(start, start + count))
            own.append(np.arange(start + count, start + count + self.local))
            start += count + self.local
        stiffness = [np.array([start])] if has_stiffness else []
        start += has_stiffness
        theta = start + np.arange(len(self.dynamics.names))
        return tuple(
            np.concatenate([curve, *stiffness, mine, theta]).astype(int) for curve, mine in zip(local, own, strict=True)
        )

    @cached_property
    def size(self) -> int:
        """Number of parameters."""
        return int(max(place.max() for place in self.places)) + 1

    @cached_property
    def runs(self) -> Runs:
        """All runs, in the order of the settings."""
        found = Runs.of([p for model in self.models for p in model.runs.prepared])
        return found.weighted(np.concatenate([model.runs.weights for model in self.models]))

    def error(self, x: Array) -> Array:
        """Return the force error (R,) [N] without weights."""
        return np.concatenate([m.rows(x[p]) - m.runs.target for m, p in zip(self.models, self.places, strict=True)])

    def residual(self, x: Array) -> Array:
        """Return the weighted force errors, followed by the penalties of the curves [N]."""
        penalties = [m.penalty @ x[p[: m.curve_count]] for m, p in zip(self.models, self.places, strict=True)]
        return np.concatenate([np.sqrt(self.runs.weights) * self.error(x), *penalties])

    def jacobian(self, x: Array) -> Array:
        """Return the derivative of `residual` by x."""
        rows, penalties = [], []
        for model, place in zip(self.models, self.places, strict=True):
            slopes = np.zeros((model.runs.target.size, self.size))
            slopes[:, place] = np.sqrt(model.runs.weights)[:, None] * model.rows_jacobian(x[place])
            penalty = np.zeros((len(model.penalty), self.size))
            penalty[:, place[: model.curve_count]] = model.penalty
            rows.append(slopes)
            penalties.append(penalty)
        return np.vstack([*rows, *penalties])

    def inequalities(self) -> Inequalities:
        """Return the constraints: no slope is negative, theta within its bounds."""
        slopes = np.concatenate([place[: self.models[0].curve_count] for place in self.places])
        return Inequalities(np.eye(self.size)[slopes], np.full(slopes.size, CLEAR_SLOPE)).and_bounds(*self.bounds())

    def active_rows(self, x: Array) -> Array:
        """Return rows that fix x in the directions of its active constraints, for its covariance."""
        inequalities = self.inequalities()
        size = np.linalg.norm(inequalities.matrix, axis=1)
        touched = inequalities.room(x) < _AT_CONSTRAINT * self.runs.deviation * size
        return np.asarray(_STIFF * np.sqrt(self.runs.target.size) * inequalities.matrix[touched])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest x."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for model, place in zip(self.models, self.places, strict=True):
            low[place], high[place] = model.bounds()
        return low, high

    def weighted(self, weights: Array) -> JointModel:
        """Return the model with other weights (R,) of the rows."""
        ends = np.cumsum([m.runs.target.size for m in self.models])[:-1]
        parts = zip(self.models, np.split(weights, ends), strict=True)
        return replace(self, models=tuple(model.weighted(part) for model, part in parts))


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """The curves of all settings and their law."""

    model: JointModel  #: Model of all settings.
    x: Array  #: Parameters.
    covariance: Array  #: Covariances (3, n, n) of x, see `covariances`.
    converged: bool  #: Whether the search ended at a minimum.
    status: str  #: Description of how the search ended.
    notes: tuple[str, ...]  #: Notes on the choices of the fit, one sentence each.

    def solution(self, number: int) -> Solution:
        """Return the part of the solution that belongs to a setting."""
        place = self.model.places[number]
        spread = self.covariance[:, place[:, None], place]
        return Solution(self.model.models[number], self.x[place], spread, self.converged, self.status)

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
        errors = standard_error(model.basis.at(velocity), self.covariance[:, here[:, None], here])
        return quantile(model.runs) * errors

    def _part(self, number: int) -> tuple[Array, Array, Array]:
        return self.model.models[number].split(self.x[self.model.places[number]])
