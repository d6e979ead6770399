"""The law `hysteresis` in a fit: its states, its force model, the search for its parameters, its stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from eightpost.array_types import Array
from eightpost.extras import needs
from eightpost.ident.shock.curve import RIDGE, KnotBasis
from eightpost.ident.shock.force import Dynamics, ForceModel, GasColumns, LawLimits, gas_columns, limits_for
from eightpost.ident.shock.law_fit import (
    WORTHWHILE,
    Choices,
    CrossValidation,
    FittedLaw,
    all_runs,
    hardest,
    joint_model,
)
from eightpost.ident.shock.problem import FitModel, JointFit
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.simulation import Pieces
from eightpost.least_squares import (
    REGULAR,
    Minimum,
    Weigh,
    minimum_from,
    non_negative,
    reweighted,
    weights_for,
    with_fixed,
)
from eightpost.shock import LAWS, Hysteresis, Port, ShockLaw, StaticCurve, Valve
from eightpost.shock.curve import KNOTS

# ==== States over whole records: the lagged velocity and the travel of the stop ======================================

#: Number of nodes of ln tau over the lagged velocity.
NODES = 3

#: Change of a logarithm for derivatives by differences.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class States:
    """States over all N samples of runs, as a function of their parameters."""

    runs: Runs  #: Records.
    basis: KnotBasis  #: Basis of the curve, whose range determines the nodes of ln tau.
    parameters: Array  #: ln tau at the nodes (3,), then ln of yield travel and time constant if there is a stop.
    is_fine: bool = True  #: Whether intervals with a large change of velocity are divided, as in the law.

    @cached_property
    def velocity(self) -> Array:
        """Lagged velocity u (N,) [m/s]."""
        return self._followed[0]

    def columns(self) -> Array:
        """Return the columns (N, K) of f1, and that of the stop if there is one: their weights are forces [N]."""
        found = self.basis.design(self.velocity) / self.basis.speed
        return np.column_stack([found, self._followed[1]]) if self.parameters.size > NODES else found

    def derivatives(self, slopes: Array, stop: Array) -> Array:
        """Return the derivatives of the force (N, s) [N] by the parameters.

        Args:
            slopes: Slopes (K,) of f1 times the highest speed of the basis [N].
            stop: Force of the stop at its yield travel (1,) [N]; (0,) without a stop.
        """
        slope = np.interp(self.velocity, self.basis.knots, slopes / self.basis.speed)
        found = []
        for number, step in enumerate(_STEP * np.eye(self.parameters.size)):
            velocity, travel = self._states_of(self.parameters + step)
            found.append(slope * (velocity - self.velocity) if number < NODES else stop * (travel - self._followed[1]))
        return np.array(found).T / _STEP

    @cached_property
    def _followed(self) -> tuple[Array, Array]:
        return self._states_of(self.parameters)

    def _states_of(self, parameters: Array) -> tuple[Array, Array]:
        """Return u (N,) [m/s] and the travel of the stop over its yield travel (N,) [1]."""
        stop = np.exp(parameters[NODES:]).tolist() or (1.0, 1.0)
        own = (*np.zeros(KNOTS).tolist(), *np.exp(parameters[:NODES]).tolist(), 1.0, *stop)
        zero = (0.0,) * KNOTS
        valve = Valve(StaticCurve.through_knots(self.basis.knots, zero, zero).numbers(), 1.0, 1.0)
        pairs = zip(self.runs.prepared, self.runs.parts, strict=True)
        found = [self._run(valve, own, self.runs.velocity[part], p.step) for p, part in pairs]
        velocity, travel = np.concatenate(found).T
        return velocity, travel / stop[0]

    def _run(self, valve: Valve, own: tuple[float, ...], velocity: Array, step: float) -> Array:
        """Return the states (M, 2) over one run."""
        with needs("fit", "fitting a law with dynamics"):
            from eightpost.shock.records import stepped_states  # noqa: PLC0415 - LLVM, which other laws do not need

        steps = np.full(velocity.size - 1, step)
        if not self.is_fine:
            return stepped_states(Hysteresis, valve, own, velocity, steps)
        pieces = Pieces.of(velocity, steps, 1.0)
        return pieces.at_samples(stepped_states(Hysteresis, valve, own, pieces.velocity, pieces.step))


# ==== Force model: the law's own parameters, their bounds and coordinates ============================================

#: Bounds of tau [s], and of the stop's yield travel [m] and time constant [s].
TIME_CONSTANT, STOP_YIELD, STOP_TIME = (3e-4, 0.2), (1e-5, 8e-3), (3e-4, 1.0)

#: Upper bound of the stop's time constant for a single speed [s]: a slower one acts like an offset there.
_FAST_STOP = 0.1

#: Lower bound of tau as a share of the sampling interval.
_SHORTEST_SHARE = 0.1

#: Least slope beyond the fitted speeds, as a share of the mean slope of the side: a slow run that ends flat does not
#: show that the force stays there at higher speeds (docs/explanation/shock_law.md).
LEAST_END = 0.2


@dataclass(frozen=True, slots=True)
class LaggedVelocity(Dynamics):
    """F = f0(v) + f1(u) + ks e beside the static curve f = f0 + f1; theta = (slopes of f1, ln tau[, stop]).

    The slopes (25,) of f1 at the knots of the curve are multiplied by the highest speed of the knots [N]. The stop is
    given by its force at its yield travel [N] and the logarithms of yield travel and time constant.
    """

    limits: LawLimits  #: Bounds for the record; only the sampling interval matters.
    kind: type[ShockLaw]  #: The law's class.
    shortest: float = TIME_CONSTANT[0]  #: Lower bound of tau [s].
    has_stop: bool = False  #: Whether the stop is fitted.
    slowest_stop: float = STOP_TIME[1]  #: Upper bound of the stop's time constant [s].

    @classmethod
    def of(cls, kind: type[ShockLaw], limits: LawLimits, rate: float) -> LaggedVelocity:
        """Return the dynamics without stop for records of a sampling rate [Hz]."""
        return cls(limits, kind, max(TIME_CONSTANT[0], _SHORTEST_SHARE / rate))

    def with_stop(self, slowest: float = STOP_TIME[1]) -> LaggedVelocity:
        """Return the same dynamics with a stop whose time constant has an upper bound [s]."""
        return replace(self, has_stop=True, slowest_stop=slowest)

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the scalar parameters; the slopes of f1 belong to the curve."""
        taus = tuple(f"time_constant[{node}]" for node in range(1, NODES + 1))
        return (*taus, "stop_stiffness", "stop_yield", "stop_time") if self.has_stop else taus

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the scalar parameters."""
        return ("s", "s", "s", "N/m", "m", "s") if self.has_stop else ("s", "s", "s")

    def values(self, theta: Array) -> Array:
        """Return the scalar parameters: tau (3,) [s], stop stiffness [N/m], yield travel [m] and time constant [s]."""
        tau = np.exp(theta[KNOTS : KNOTS + NODES])
        if not self.has_stop:
            return np.asarray(tau)
        force, travel, time = theta[-3], np.exp(theta[-2]), np.exp(theta[-1])
        return np.array([*tau, force / travel, travel, time])

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta."""
        values = self.values(theta)
        found = np.zeros((values.size, theta.size))
        found[:NODES, KNOTS : KNOTS + NODES] = np.diag(values[:NODES])
        if self.has_stop:
            found[-3, -3:-1] = 1.0 / values[-2], -values[-3]
            found[-2, -2], found[-1, -1] = values[-2], values[-1]
        return found

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of the scalar parameters."""
        taus = ((self.shortest, TIME_CONSTANT[1]),) * NODES
        return (*taus, (0.0, np.inf), *self._stop_bounds) if self.has_stop else taus

    def state_bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters of the states: ln tau (3,), then those of the stop (2,)."""
        pairs = [(self.shortest, TIME_CONSTANT[1])] * NODES + [*self._stop_bounds] * self.has_stop
        low, high = np.log(np.array(pairs)).T
        return low, high

    @property
    def _stop_bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        return STOP_YIELD, (STOP_TIME[0], self.slowest_stop)

    def states(self, theta: Array) -> Array:
        """Return the parameters of the states in theta: ln tau (3,), then ln of yield travel and time constant."""
        return np.concatenate([theta[KNOTS : KNOTS + NODES], theta[-2:] if self.has_stop else []])

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = f0(v) + f1(u) + ks e."""
        slopes, stop = self.forces(theta)
        states = States(model.runs, knots_of(model), self.states(theta))
        return model.static(b - slopes) + states.columns() @ np.append(slopes, stop)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F at the rows."""
        return model.runs.rows(self.force(model, b, theta))

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives of F at the rows by the curve (R, 25) and by theta (R, k)."""
        states, static = States(model.runs, knots_of(model), self.states(theta)), model.curve_rows()
        columns = model.runs.rows(states.columns().T).T
        by_states = model.runs.rows(states.derivatives(*self.forces(theta)).T).T
        own = (columns[:, :KNOTS] - static, by_states[:, :NODES], columns[:, KNOTS:], by_states[:, NODES:])
        return static, np.hstack(own)

    def forces(self, theta: Array) -> tuple[Array, Array]:
        """Return the parameters in theta that the force is linear in: slopes of f1 (25,) and stop (0,) or (1,) [N]."""
        return theta[:KNOTS], theta[-3:-2] if self.has_stop else np.empty(0)

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law with its curve and port."""
        speed = max(-curve.knot_velocity[0], curve.knot_velocity[-1])
        values = self.values(theta).tolist()
        # Where f0 has no slope, rounding must not make that of f1 the larger one.
        slopes = np.minimum(np.maximum(theta[:KNOTS], 0.0) / speed, curve.knot_slope)
        stop = values[NODES:] if self.has_stop else []
        low, middle, high = values[:NODES]
        return Hysteresis(_rising_beyond(curve), tuple(slopes.tolist()), (low, middle, high), *stop, port=port)


def _rising_beyond(curve: StaticCurve) -> StaticCurve:
    """Return a curve that rises beyond each end by a share of the mean slope of the side or more."""
    compression, rebound = (
        max(slope, LEAST_END * force / velocity)
        for slope, force, velocity in (
            (curve.compression_slope, curve.knot_force[-1], curve.knot_velocity[-1]),
            (curve.rebound_slope, curve.knot_force[0], curve.knot_velocity[0]),
        )
    )
    return replace(curve, compression_slope=compression, rebound_slope=rebound)


def knots_of(model: ForceModel) -> KnotBasis:
    """Return the basis of a model's curve through knots."""
    assert isinstance(model.basis.curve, KnotBasis), "the law hysteresis needs a curve through knots"
    return model.basis.curve


# ==== Search for the parameters by variable projection ===============================================================
# Given the parameters of the states (ln tau, and yield travel and time constant of the stop), the force is linear in
# everything else: slopes of f0 and f1, stop force, gas force. These follow from non-negative least squares, so the
# search has three or five dimensions. Over several settings each has curves and offsets of its own; what is linear but
# shared, the force of the stop and the gas stiffness, is searched too.

#: Lowest rate of a thinned record [Hz].
_THIN_RATE = 400.0

#: Penalty on changes of ln tau from node to node, as a share of the force's standard deviation.
_EVEN = 3e-3

#: Largest change of a logarithm in a step.
_LONGEST = 1.5


# ---- The force error of one setting as a function of the parameters of the states alone -----------------------------


@dataclass(frozen=True, eq=False)
class Projection:
    """Force error of a setting at the rows, minimised over the linear parameters.

    The linear parameters are the slopes of f0 (25,) and of f1 (25,) at the knots, times the highest speed, the stop's
    force at its yield travel if there is a stop, and the weights of the gas columns; all in N.
    """

    model: ForceModel  #: Model on the whole record, with its weights.
    is_thin: bool  #: Whether the states are computed on a thinned record.

    @cached_property
    def dynamics(self) -> LaggedVelocity:
        """The law's dynamics."""
        assert isinstance(self.model.dynamics, LaggedVelocity), "the projection is that of the law hysteresis"
        return self.model.dynamics

    def at(self, parameters: Array, shared: NDArray[np.intp], forces: Array) -> Projected:
        """Return the minimum over the linear parameters.

        Args:
            parameters: Parameters of the states (3,) or (5,).
            shared: Places of the linear parameters that are given.
            forces: Values [N] of these linear parameters.
        """
        states = States(self.motion, knots_of(self.model), parameters, is_fine=not self.is_thin)
        columns, own = self.columns_of(states), np.ones(self.is_free.size, dtype=bool)
        own[shared] = False
        weights, target = self.model.runs.weights, self.model.runs.target
        gram = (weights[:, None] * columns).T @ columns + self.penalty.T @ self.penalty
        towards = columns[:, own].T @ (weights * (target - columns[:, shared] @ forces))
        linear = np.zeros(own.size)
        linear[own] = non_negative(gram[np.ix_(own, own)], towards, self.is_free[own])
        linear[shared] = forces
        return Projected(self, states, linear, columns, gram, own)

    @cached_property
    def penalty(self) -> Array:
        """The rows (P, n) that penalise the linear parameters beside the weighted rows."""
        slopes, stop = self.model.basis.penalty, RIDGE * np.eye(self.own_count - 2 * KNOTS)
        rows = block_diag(slopes, slopes, stop, np.zeros((0, self.model.gas.count)))
        return np.asarray(np.sqrt(self.model.runs.weights.sum()) * rows)

    @cached_property
    def unevenness(self) -> Array:
        """The rows (2, s) that penalise the parameters of the states."""
        changes = np.diff(np.eye(NODES, 2 * self.dynamics.has_stop + NODES), axis=0)
        return np.asarray(np.sqrt(self.model.runs.weights.sum()) * _EVEN * self.model.runs.deviation * changes)

    @cached_property
    def motion(self) -> Runs:
        """The runs over which the states are computed."""
        return _thinned(self.model.runs) if self.is_thin else self.model.runs

    def columns_of(self, states: States) -> Array:
        """Return the columns (R, n) of the linear parameters at the rows."""
        return np.hstack([self._static_rows, self.motion.rows(states.columns().T).T, self.model.gas_rows])

    @cached_property
    def _static_rows(self) -> Array:
        return self.model.curve_rows()

    @cached_property
    def own_count(self) -> int:
        """Number of linear parameters without those of the gas force."""
        return 2 * KNOTS + self.dynamics.has_stop

    @cached_property
    def is_free(self) -> NDArray[np.bool_]:
        """Whether each linear parameter (n,) may be negative: the offsets of the runs."""
        is_free = np.zeros(self.own_count + self.model.gas.count, dtype=bool)
        is_free[self.own_count : self.own_count + self.model.gas.offsets] = True
        return is_free


@dataclass(frozen=True, eq=False)
class Projected:
    """The minimum over the linear parameters of a setting for given parameters of the states."""

    problem: Projection  #: Problem that was minimised.
    states: States  #: States.
    linear: Array  #: Linear parameters (n,) [N].
    columns: Array  #: Columns (R, n) at the rows.
    gram: Array  #: Matrix (n, n) of the normal equations, with penalties.
    own: NDArray[np.bool_]  #: Whether each linear parameter (n,) was optimised, not given.

    @cached_property
    def by_states(self) -> Array:
        """Derivatives of the force at the rows (R, s) by the parameters of the states [N]."""
        slopes, stop = self.linear[KNOTS : 2 * KNOTS], self.linear[2 * KNOTS : self.problem.own_count]
        return self.problem.motion.rows(self.states.derivatives(slopes, stop).T).T

    @cached_property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return np.asarray(self.columns @ self.linear - self.problem.model.runs.target)

    @property
    def penalties(self) -> tuple[Array, Array]:
        """Values of the penalties of the linear parameters, and of those of the states [N]."""
        return self.problem.penalty @ self.linear, self.problem.unevenness @ self.states.parameters

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the weighted force error and of the penalties [N2]."""
        penalties = np.concatenate(self.penalties)
        return float(self.problem.model.runs.weights @ self.error**2 + penalties @ penalties)

    @cached_property
    def is_fixed(self) -> NDArray[np.bool_]:
        """Whether each linear parameter (n,) is at its bound, zero."""
        return (self.linear <= 0.0) & ~self.problem.is_free

    def equations(self, size: float) -> tuple[Array, Array]:
        """Return matrix and right side for a step of the states' parameters and of the given forces over their size.

        The free linear parameters follow the step, so their directions are projected out (Kaufman 1975).
        """
        problem, given, used = self.problem, ~self.own, ~self.is_fixed & self.own
        changes = np.hstack([self.by_states, size * self.columns[:, given]])
        weighted = problem.model.runs.weights[:, None] * changes
        across, gram = weighted.T @ self.columns[:, used], self.gram[np.ix_(used, used)]
        gram = gram + REGULAR * float(np.diag(gram).max()) * np.eye(len(gram))
        penalty = block_diag(problem.unevenness, size * problem.penalty[:, given])
        values = np.concatenate(
            [problem.unevenness @ self.states.parameters, problem.penalty[:, given] @ self.linear[given]]
        )
        matrix = weighted.T @ changes - across @ np.linalg.solve(gram, across.T) + penalty.T @ penalty
        return matrix, -weighted.T @ self.error - penalty.T @ values


def _thinned(runs: Runs) -> Runs:
    """Return runs thinned to the lowest rate at which the states are accurate enough for a search, at the same rows."""
    every = [f.every for f in runs.filters]
    shared = [k for k in range(1, min(every) + 1) if all(e % k == 0 for e in every)]
    return runs.thinned(max((k for k in shared if runs.rate / k >= _THIN_RATE), default=1))[0]


# ---- All settings together ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class HysteresisProblem:
    """Force error of all settings, minimised over the curves and offsets of each.

    The parameters of the search are those of the states (3,) or (5,). Of several settings they are followed by the
    force of the stop at its yield travel if there is one, and the weight of the gas stiffness if it is fitted, both as
    shares of the force's standard deviation.
    """

    model: FitModel  #: Model of the whole records, with their weights.
    is_thin: bool  #: Whether the states are computed on thinned records.

    @cached_property
    def parts(self) -> tuple[Projection, ...]:
        """Force error of each setting."""
        return tuple(Projection(model, is_thin=self.is_thin) for model in self.model.models)

    @cached_property
    def shared(self) -> NDArray[np.intp]:
        """The places of the linear parameters that several settings share."""
        stop, stiffness = [2 * KNOTS] * self.parts[0].dynamics.has_stop, [-1] * bool(self.model.first.gas.size)
        return np.array([*stop, *stiffness] if len(self.parts) > 1 else [], dtype=np.intp)

    @cached_property
    def deviation(self) -> float:
        """Standard deviation of the force [N]."""
        return self.model.runs.deviation

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters."""
        low, high = self.parts[0].dynamics.state_bounds()
        return np.append(low, np.zeros(self.shared.size)), np.append(high, np.full(self.shared.size, np.inf))

    def at(self, parameters: Array) -> HysteresisPoint:
        """Return the minimum over the curves and offsets of all settings."""
        states, forces = np.split(parameters, [parameters.size - self.shared.size])
        parts = tuple(part.at(states, self.shared, self.deviation * forces) for part in self.parts)
        return HysteresisPoint(self, parameters, parts)

    def rows(self, point: HysteresisPoint) -> Array:
        """Return the force at the rows (R,) [N] for the parameters of a point, such as that of thinned records."""
        pairs = zip(self.parts, point.parts, strict=True)
        states = ((part, replace(p.states, runs=part.motion, is_fine=not self.is_thin), p.linear) for part, p in pairs)
        return np.concatenate([part.columns_of(state) @ linear for part, state, linear in states])

    def search(self, start: Array, effort: tuple[float, int]) -> Minimum[HysteresisPoint]:
        """Return the minimum from a start, with a tolerance and a maximum number of evaluations."""
        tolerance, evaluations = effort
        return minimum_from(self, start, tolerance=tolerance, evaluations=evaluations, longest=_LONGEST)


@dataclass(frozen=True, eq=False)
class HysteresisPoint:
    """The minimum over the curves of all settings for given parameters of the search."""

    problem: HysteresisProblem  #: Problem that was minimised.
    parameters: Array  #: Parameters of the search.
    parts: tuple[Projected, ...]  #: Minimum of each setting.

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the weighted force errors and of the penalties [N2]."""
        return sum(part.cost for part in self.parts)

    @cached_property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return np.concatenate([part.error for part in self.parts])

    @cached_property
    def normal_equations(self) -> tuple[Array, Array]:
        """Matrix (s, s) and right side (s,) for a step of the parameters, which the free curves follow."""
        pairs = [part.equations(self.problem.deviation) for part in self.parts]
        return np.sum([matrix for matrix, _ in pairs], axis=0), np.sum([right for _, right in pairs], axis=0)


# ==== The fitted law =================================================================================================

#: Starting values of tau [s], the same at all nodes.
_TAUS = (2e-3, 6e-3, 2e-2, 6e-2)

#: Starting values of the stop: yield travel [m] and time constant [s].
_STOPS = ((3e-4, 1e-2), (1e-3, 3e-2), (1e-4, 1e-1))

#: Number of starts that are followed to their minimum.
_FOLLOWED = 2

#: Tolerance and maximum number of evaluations: of a first search from each start, of a search to the minimum, and of a
#: fit to a part of the record, which must not end near its start, the fit to everything.
_ROUGH, _FINE, _REFIT = (1e-2, 6), (1e-5, 40), (1e-6, 30)

#: Maximum number of reweightings.
_WEIGHINGS = 4


@dataclass(frozen=True, slots=True, eq=False)
class HysteresisFit(FittedLaw):
    """The law `hysteresis` fitted to the runs of one or more settings."""

    found: Minimum[HysteresisPoint]  #: Minimum, on the whole record at the end.
    stop_note: str = ""  #: Sentence on whether the law has a stop, and why; empty if one would hardly lower the error.

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return self.found.end.error

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.found.converged

    def again(self, weights: Array) -> HysteresisFit:
        """Return the fit on thinned records with weights (R,) of the rows, searched from this minimum."""
        model = self.model.weighted(weights)
        return replace(self, model=model, found=self._searched(model, is_thin=True))

    def robust(self, weigh: Weigh | None) -> HysteresisFit:
        """Return the fit on thinned records with weights that follow its own residuals."""
        if weigh is None:
            return self
        return reweighted(self, lambda fit: fit.robust_weights(weigh), HysteresisFit.again, _WEIGHINGS)

    def whole(self) -> HysteresisFit:
        """Return the fit on the whole records, searched from this minimum."""
        return replace(self, found=self._searched(self.model, is_thin=False))

    def _searched(self, model: FitModel, *, is_thin: bool) -> Minimum[HysteresisPoint]:
        return HysteresisProblem(model, is_thin).search(self.found.end.parameters, _FINE)

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum.

        The fit uses a thinned record, the simulation the whole one.
        """
        thin = HysteresisProblem(self.model.weighted(weights), is_thin=True)
        whole = HysteresisProblem(self.model, is_thin=False)
        return whole.rows(thin.search(self.found.end.parameters, _REFIT).end)

    def solution(self) -> JointFit:
        """Return the solution with its covariance; what is at a bound is fixed."""
        model, end = self.model, self.found.end
        x = np.zeros(model.size)
        rows: list[Array] = []
        fixed: list[Array] = []
        penalties: tuple[list[Array], list[Array]] = ([], [])
        low, high = end.problem.parts[0].dynamics.state_bounds()
        for number, (part, place) in enumerate(zip(end.parts, model.places, strict=True)):
            single, states = part.problem.model, part.states.parameters
            to_linear, to_states = search_coordinates(single)
            x[place] = np.linalg.solve(np.vstack([to_linear, to_states]), np.append(part.linear, states))
            at_bound = (states <= low) | (states >= high)
            root = np.sqrt(single.runs.weights)[:, None]
            rows.append(model.scattered(root * single.rows_jacobian(x[place]), number))
            penalties[0].append(model.scattered(part.problem.penalty @ to_linear, number))
            penalties[1].append(model.scattered(part.problem.unevenness @ to_states, number))
            fixed += [model.scattered(to_linear[part.is_fixed], number), model.scattered(to_states[at_bound], number)]
        jacobian = with_fixed(np.vstack([*rows, *penalties[0], *penalties[1]]), np.vstack(fixed))
        values = tuple(np.concatenate(part) for part in zip(*(part.penalties for part in end.parts), strict=True))
        notes = (self.stop_note,) * bool(self.stop_note)
        ended = {"converged": self.found.converged, "status": self.found.status, "notes": notes}
        return JointFit.of(model, x, jacobian, np.sqrt(self.weights) * end.error, values, **ended)


def search_coordinates(model: ForceModel) -> tuple[Array, Array]:
    """Return matrices from the parameters of a model (n + g + k,) to the linear ones of the search and to the states'.

    The model's parameters are the slopes of the whole curve, gas, and theta; those of the search are the slopes of f0,
    those of f1, the stop, and gas.
    """
    gas, has_stop = model.gas.count, model.dynamics.has_stop  # type: ignore[attr-defined]
    curve, g, slopes, taus, stop, rest = np.split(
        np.eye(2 * KNOTS + gas + NODES + 3 * has_stop),
        np.cumsum([KNOTS, gas, KNOTS, NODES, int(has_stop)]),
    )
    return np.vstack([curve - slopes, slopes, stop, g]), np.vstack([taus, rest])


def fit_hysteresis(groups: Sequence[Runs], law: str, choices: Choices) -> CrossValidation:
    """Return the fit of the law `hysteresis` to the runs of each setting, ready for cross-validation.

    It has a stop if left-out parts are predicted better with it. The curves of several
    settings have a lag and a stop in common, which the setting with the largest force determines first.
    """
    runs, weigh = all_runs(groups), weights_for(choices.robust)
    gas, notes = gas_columns(runs, choices.gas)
    if len(groups) > 1:
        first = fit_hysteresis([hardest(groups)], law, choices).fit
        assert isinstance(first, HysteresisFit)
        model = _model_of(groups, gas, first.model.dynamics)
        problem = HysteresisProblem(model, is_thin=True)
        start = np.append(first.found.end.parameters, _start_forces(problem, first))
        every = "both curves depend on the setting"
        fit = HysteresisFit(law, (*first.notes, *notes, every), model, problem.search(start, _FINE), first.stop_note)
        return CrossValidation(fit.robust(weigh).whole())
    dynamics = LaggedVelocity.of(LAWS[law], limits_for(runs.measured, runs.rate), runs.rate)
    model = _model_of(groups, gas, dynamics)
    problem, starts = HysteresisProblem(model, is_thin=True), [np.full(NODES, np.log(tau)) for tau in _TAUS]
    fit = HysteresisFit(law, tuple(notes), model, _followed(problem, _rough(problem, starts))).robust(weigh)
    stopping = dynamics.with_stop(_FAST_STOP if runs.has_one_motion else STOP_TIME[1])
    model = replace(model, models=(replace(model.first, dynamics=stopping),)).weighted(fit.weights)
    taus, problem = fit.found.end.parameters, HysteresisProblem(model, is_thin=True)
    rough = _rough(problem, [np.append(taus, np.log(stop)) for stop in _STOPS])
    if rough[0].cost > (1.0 - WORTHWHILE) * fit.found.cost:
        return CrossValidation(fit.whole())
    stopped = replace(fit, model=model, found=_followed(problem, rough)).robust(weigh)
    return _better(CrossValidation(fit), CrossValidation(stopped))


def _model_of(groups: Sequence[Runs], gas: GasColumns, dynamics: Dynamics) -> FitModel:
    return replace(joint_model(groups, gas, dynamics, cells=KNOTS // 2), local=KNOTS)


def _start_forces(problem: HysteresisProblem, first: HysteresisFit) -> Array:
    """Return the shared forces of the first fit, as shares of the force's standard deviation of all settings."""
    gas, linear = first.model.first.gas, first.found.end.parts[0].linear
    stiffness = float(linear[-1]) / gas.size if gas.size else 0.0  # [N/m]
    common = problem.model.first.gas.size
    forces = [float(linear[2 * KNOTS])] if problem.parts[0].dynamics.has_stop else []
    return np.array([*forces, *([stiffness * common] if common else [])]) / problem.deviation


def _better(without: CrossValidation, stopped: CrossValidation) -> CrossValidation:
    """Return the fit with a stop if that is worthwhile on left-out parts, else the other."""
    counted = np.maximum(without.fit.weights, stopped.fit.weights)
    held, other = without.errors(counted), stopped.errors(counted)
    figures = f"held-out error {other.percent:.3g} % with a stop, {held.percent:.3g} % without"
    if stopped.fit.has_converged and held.is_beaten_by(other):
        return _with_note(stopped, f"the law has a stop: {figures}")
    return _with_note(without, f"the law has no stop: {figures}; a stop must be better by a standard error and 2 %")


def _with_note(found: CrossValidation, note: str) -> CrossValidation:
    """Return the fit on the whole records with its note on the stop; computed predictions are kept."""
    assert isinstance(found.fit, HysteresisFit)
    other = CrossValidation(replace(found.fit, stop_note=note).whole())
    other.__dict__.update({name: value for name, value in found.__dict__.items() if name != "fit"})
    return other


def _rough(problem: HysteresisProblem, starts: Sequence[Array]) -> list[Minimum[HysteresisPoint]]:
    """Return the ends of short searches from some starts, the best first."""
    return sorted((problem.search(start, _ROUGH) for start in starts), key=lambda found: found.cost)


def _followed(problem: HysteresisProblem, rough: Sequence[Minimum[HysteresisPoint]]) -> Minimum[HysteresisPoint]:
    """Return the best minimum from the best ends of short searches."""
    ends = [problem.search(found.end.parameters, _FINE) for found in rough[:_FOLLOWED]]
    return min(ends, key=lambda found: found.cost)
