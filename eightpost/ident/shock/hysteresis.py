"""The law `hysteresis` in a fit: its states, its force model, the search for its parameters, its stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky, solve_triangular
from scipy.optimize import nnls

from eightpost.array_types import Array
from eightpost.ident.shock.curve import RIDGE, KnotBasis, knot_basis
from eightpost.ident.shock.force import Dynamics, ForceModel, Limits, gas_columns, limits_for
from eightpost.ident.shock.law_fit import WORTHWHILE, Choices, CrossValidation, FittedLaw, nearly_equal, weights_for
from eightpost.ident.shock.problem import Solution, block_changes, covariances
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.simulation import Pieces
from eightpost.progress import beats
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
        from eightpost.shock.compiled import stepped_states  # noqa: PLC0415 - the compiler takes a second to load

        steps = np.full(velocity.size - 1, step)
        if not self.is_fine:
            return stepped_states(Hysteresis, valve, own, velocity, steps)
        pieces = Pieces.of(velocity, steps, 1.0)
        return pieces.at_samples(stepped_states(Hysteresis, valve, own, pieces.velocity, pieces.step))


# ==== Force model: the law's own parameters, their bounds and coordinates ============================================

#: Bounds of tau [s], and of the stop's yield travel [m] and time constant [s].
TIME_CONSTANT, STOP_YIELD, STOP_TIME = (3e-4, 0.2), (1e-5, 8e-3), (3e-4, 1.0)

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

    limits: Limits  #: Bounds for the record; only the sampling interval matters.
    kind: type[ShockLaw]  #: The law's class.
    shortest: float = TIME_CONSTANT[0]  #: Lower bound of tau [s].
    has_stop: bool = False  #: Whether the stop is fitted.

    @classmethod
    def of(cls, kind: type[ShockLaw], limits: Limits, rate: float) -> LaggedVelocity:
        """Return the dynamics without stop for records of a sampling rate [Hz]."""
        return cls(limits, kind, max(TIME_CONSTANT[0], _SHORTEST_SHARE / rate))

    def with_stop(self) -> LaggedVelocity:
        """Return the same dynamics with a stop."""
        return replace(self, has_stop=True)

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
        return (*taus, (0.0, np.inf), STOP_YIELD, STOP_TIME) if self.has_stop else taus

    def state_bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters of the states: ln tau (3,), then those of the stop (2,)."""
        pairs = [(self.shortest, TIME_CONSTANT[1])] * NODES + [STOP_YIELD, STOP_TIME] * self.has_stop
        low, high = np.log(np.array(pairs)).T
        return low, high

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
# search has three or five dimensions.

#: Lowest rate of a thinned record [Hz].
_THIN_RATE = 400.0

#: Penalty on changes of ln tau from node to node, as a share of the force's standard deviation.
_EVEN = 3e-3

#: Damping of the steps: its initial value, its factor of change, its bounds; largest change of a logarithm in a step.
_DAMPING, _CHANGE, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 10.0, 1e-6, 1e6
_LONGEST = 1.5

#: Smallest change of the logarithms that counts as a change.
_SMALL = 1e-5

#: Share of the diagonal that is added to normal equations, for directions that no row determines.
_REGULAR = 1e-12


# ---- The force error as a function of the parameters of the states alone --------------------------------------------


@dataclass(frozen=True, eq=False)
class Projection:
    """Force error at the rows, minimised over the linear parameters.

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

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters of the states."""
        return self.dynamics.state_bounds()

    def at(self, parameters: Array) -> Projected:
        """Return the projection at parameters of the states (3,) or (5,)."""
        states = self.states_at(parameters)
        columns = self.columns_of(states)
        weighted = self.model.runs.weights[:, None] * columns
        gram = weighted.T @ columns + self.penalty.T @ self.penalty
        linear = non_negative(gram, weighted.T @ self.model.runs.target, self.is_free)
        return Projected(self, states, linear, columns, gram)

    def rows(self, parameters: Array, linear: Array) -> Array:
        """Return the force at the rows (R,) [N] for given parameters of the states (s,) and linear parameters (n,)."""
        return np.asarray(self.columns_of(self.states_at(parameters)) @ linear)

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

    def states_at(self, parameters: Array) -> States:
        """Return the states for their parameters (s,)."""
        return States(self.motion, knots_of(self.model), parameters, is_fine=not self.is_thin)

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
    """The minimum over the linear parameters for given parameters of the states."""

    problem: Projection  #: Problem that was minimised.
    states: States  #: States.
    linear: Array  #: Linear parameters (n,) [N].
    columns: Array  #: Columns (R, n) at the rows.
    gram: Array  #: Matrix (n, n) of the normal equations, with penalties.

    @property
    def parameters(self) -> Array:
        """Parameters of the states (s,)."""
        return self.states.parameters

    @cached_property
    def by_states(self) -> Array:
        """Derivatives of the force at the rows (R, s) by the parameters of the states [N]."""
        slopes, stop = self.linear[KNOTS : 2 * KNOTS], self.linear[2 * KNOTS : self.problem.own_count]
        return self.problem.motion.rows(self.states.derivatives(slopes, stop).T).T

    @cached_property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return np.asarray(self.columns @ self.linear - self.problem.model.runs.target)

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the weighted force error and of the penalties [N2]."""
        penalties = np.append(self.problem.penalty @ self.linear, self.problem.unevenness @ self.parameters)
        return float(self.problem.model.runs.weights @ self.error**2 + penalties @ penalties)

    @cached_property
    def is_fixed(self) -> NDArray[np.bool_]:
        """Whether each linear parameter (n,) is at its bound, zero."""
        return (self.linear <= 0.0) & ~self.problem.is_free

    @cached_property
    def normal_equations(self) -> tuple[Array, Array]:
        """Return matrix (s, s) and right side (s,) for a step of the states' parameters.

        The free linear parameters follow the step, so their directions are projected out (Kaufman 1975).
        """
        weighted = self.problem.model.runs.weights[:, None] * self.by_states
        used = ~self.is_fixed
        across, gram = weighted.T @ self.columns[:, used], self.gram[np.ix_(used, used)]
        gram = gram + _REGULAR * float(np.diag(gram).max()) * np.eye(len(gram))
        uneven = self.problem.unevenness
        matrix = weighted.T @ self.by_states - across @ np.linalg.solve(gram, across.T) + uneven.T @ uneven
        return matrix, -weighted.T @ self.error - uneven.T @ (uneven @ self.parameters)


def _thinned(runs: Runs) -> Runs:
    """Return runs thinned to the lowest rate at which the states are accurate enough for a search, at the same rows."""
    every = [f.every for f in runs.filters]
    shared = [k for k in range(1, min(every) + 1) if all(e % k == 0 for e in every)]
    return runs.thinned(max((k for k in shared if runs.rate / k >= _THIN_RATE), default=1))[0]


def non_negative(gram: Array, towards: Array, is_free: NDArray[np.bool_]) -> Array:
    """Return x (n,) that minimises x' gram x - 2 towards' x; only free elements of x may be negative."""
    # Free elements are eliminated first: x_free = inverse (towards_free - across x).
    inverse = np.linalg.pinv(gram[np.ix_(is_free, is_free)], hermitian=True)
    across = gram[np.ix_(is_free, ~is_free)]
    rest = gram[np.ix_(~is_free, ~is_free)] - across.T @ inverse @ across
    right = towards[~is_free] - across.T @ (inverse @ towards[is_free])
    size = np.sqrt(np.maximum(np.diag(rest), np.finfo(float).tiny))
    factor = cholesky(rest / np.outer(size, size) + _REGULAR * np.eye(size.size), lower=True)
    found = np.empty(towards.size)
    found[~is_free] = nnls(factor.T, solve_triangular(factor, right / size, lower=True))[0] / size
    found[is_free] = inverse @ (towards[is_free] - across @ found[~is_free])
    return found


# ---- Search over the parameters of the states -----------------------------------------------------------------------


class SearchPoint(Protocol):
    """A minimum over the linear parameters for given other ones, from which a search can step."""

    @property
    def parameters(self) -> Array:
        """Parameters of the search (s,)."""

    @property
    def cost(self) -> float:
        """Sum of squares [N2]."""

    @property
    def normal_equations(self) -> tuple[Array, Array]:
        """Matrix (s, s) and right side (s,) for a step of the parameters."""


_Point = TypeVar("_Point", bound=SearchPoint)
_Reached_co = TypeVar("_Reached_co", bound=SearchPoint, covariant=True)


class SearchProblem(Protocol[_Reached_co]):
    """A problem whose linear parameters follow from the others."""

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters."""

    def at(self, parameters: Array) -> _Reached_co:
        """Return the minimum over the linear parameters."""


@dataclass(frozen=True, slots=True, eq=False)
class Found(Generic[_Point]):
    """The end of a search."""

    end: _Point  #: Minimum over the linear parameters at the end.
    converged: bool  #: Whether it is a minimum.
    status: str  #: Description of how the search ended.

    @property
    def cost(self) -> float:
        """Sum of squares of the weighted force error and of the penalties [N2]."""
        return self.end.cost


def minimum_from(problem: SearchProblem[_Point], start: Array, *, tolerance: float, evaluations: int) -> Found[_Point]:
    """Search for the minimum over the parameters of a problem by damped Gauss-Newton steps within their bounds.

    Args:
        problem: Problem to minimise.
        start: Starting point (s,), moved inside the bounds.
        tolerance: Relative decrease of the cost below which the search stops.
        evaluations: Maximum number of evaluations.
    """
    low, high = problem.bounds()
    here, damping, rise = problem.at(np.clip(start, low, high)), _DAMPING, _CHANGE
    for count in beats(range(2, evaluations + 1)):
        after = np.clip(here.parameters + _step(here, low, high, damping), low, high)
        if np.abs(after - here.parameters).max() < _SMALL:
            return Found(here, True, f"No further step is better. {count} evaluations.")
        there = problem.at(after)
        gain = here.cost - there.cost
        if gain > 0.0:
            here, damping, rise = there, max(damping / _CHANGE, _LEAST_DAMPING), _CHANGE
            if gain <= tolerance * here.cost:
                return Found(here, True, f"The sum of squares no longer decreases. {count} evaluations.")
        elif damping > _MOST_DAMPING:
            return Found(here, True, f"No step within the bounds is better. {count} evaluations.")
        else:
            damping, rise = damping * rise, rise * _CHANGE
    return Found(here, False, f"No minimum after {evaluations} evaluations.")


def _step(here: SearchPoint, low: Array, high: Array, damping: float) -> Array:
    """Return a damped step (s,); parameters at a bound that would leave it stay."""
    matrix, right = here.normal_equations
    stays = ((here.parameters <= low) & (right < 0.0)) | ((here.parameters >= high) & (right > 0.0))
    size = np.diag(matrix).copy()
    size = np.maximum(size, 1e-10 * size.max() + np.finfo(float).tiny)
    matrix = matrix + damping * np.diag(size)
    step = np.zeros(right.size)
    step[~stays] = np.linalg.solve(matrix[np.ix_(~stays, ~stays)], right[~stays])
    return np.clip(step, -_LONGEST, _LONGEST)


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

_ONE_SPEED = "the law has no stop: the test has a single speed, at which a stop and a lag cannot be distinguished"

#: In the covariance, a parameter at its bound is fixed: a change by 1 N counts like a force error of this many N.
_STIFF = 10.0


# ---- The fitted law -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class HysteresisFit(FittedLaw):
    """The law `hysteresis` fitted to runs."""

    found: Found[Projected]  #: Minimum on the whole record.
    stop_note: str  #: Sentence on whether the law has a stop, and why; empty if a stop would hardly lower the error.

    @property
    def model(self) -> ForceModel:
        """The model of the whole record with the weights of the fit."""
        return self.found.end.problem.model

    @property
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""
        return self.model.runs

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return self.found.end.error

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.found.converged

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum.

        The fit uses a thinned record, the simulation the whole one.
        """
        thin = Projection(self.model.weighted(weights), is_thin=True)
        end = _search(thin, self.found.end.parameters, _REFIT).end
        return self.found.end.problem.rows(end.parameters, end.linear)

    def solution(self) -> Solution:
        """Return the solution with its covariance."""
        end, model = self.found.end, self.model
        to_linear, to_states = search_coordinates(model)
        parameters = np.linalg.solve(np.vstack([to_linear, to_states]), np.append(end.linear, end.parameters))
        low, high = end.problem.dynamics.state_bounds()
        at_bound = (end.parameters <= low) | (end.parameters >= high)
        stiff = _STIFF * np.sqrt(model.runs.target.size)
        root = np.sqrt(model.runs.weights)
        jacobian = np.vstack(
            [
                root[:, None] * model.rows_jacobian(parameters),
                end.problem.penalty @ to_linear,
                end.problem.unevenness @ to_states,
                stiff * to_linear[end.is_fixed],
                stiff * model.runs.deviation * to_states[at_bound],
            ]
        )
        penalties = end.problem.penalty @ end.linear, end.problem.unevenness @ end.parameters
        error = root * end.error
        spread = covariances(jacobian, error, model.runs, penalties)
        left_out, notes = block_changes(jacobian, error, model.runs), (self.stop_note,) * bool(self.stop_note)
        return Solution(model, parameters, spread, self.found.converged, self.found.status, notes, left_out)


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


# ---- The fit --------------------------------------------------------------------------------------------------------


def fit_hysteresis(runs: Runs, law: str, choices: Choices) -> CrossValidation:
    """Return the fit of the law `hysteresis` to runs, ready for cross-validation.

    It has a stop if the runs can show one, and if left-out parts are predicted better with it.

    """
    gas, notes = gas_columns(runs, choices.gas)
    limits = limits_for(runs.measured, runs.rate)
    dynamics = LaggedVelocity.of(LAWS[law], limits, runs.rate)
    basis, weigh = knot_basis(runs.velocity, runs.inside, cells=KNOTS // 2), weights_for(choices.robust)
    model = ForceModel(runs, basis, gas, dynamics)
    found = _robust(_without_stop, model, weigh)
    if runs.has_one_motion:
        return CrossValidation(HysteresisFit(law, tuple(notes), found, _ONE_SPEED))
    model = replace(model, dynamics=dynamics.with_stop()).weighted(found.end.problem.model.runs.weights)
    taus, thin = found.end.parameters, Projection(found.end.problem.model, is_thin=True)
    rough = _rough(Projection(model, is_thin=True), [np.append(taus, np.log(stop)) for stop in _STOPS])
    if rough[0].cost > (1.0 - WORTHWHILE) * thin.at(taus).cost:
        return CrossValidation(HysteresisFit(law, tuple(notes), found, ""))
    stopped = _robust(lambda problem: _followed(problem, rough), model, weigh)
    return _better(*(CrossValidation(HysteresisFit(law, tuple(notes), one, "")) for one in (found, stopped)))


def _better(without: CrossValidation, stopped: CrossValidation) -> CrossValidation:
    """Return the fit with a stop if that is worthwhile on left-out parts, else the other."""
    counted = np.maximum(without.fit.runs.weights, stopped.fit.runs.weights)
    held, other = without.errors(counted), stopped.errors(counted)
    figures = f"held-out error {other.percent:.3g} % with a stop, {held.percent:.3g} % without"
    if stopped.fit.has_converged and held.is_beaten_by(other):
        return _with_note(stopped, f"the law has a stop: {figures}")
    return _with_note(without, f"the law has no stop: {figures}; a stop must be better by a standard error and 2 %")


def _with_note(found: CrossValidation, note: str) -> CrossValidation:
    """Return a fit with its note on the stop; computed predictions are kept."""
    assert isinstance(found.fit, HysteresisFit)
    other = CrossValidation(replace(found.fit, stop_note=note))
    other.__dict__.update({name: value for name, value in found.__dict__.items() if name != "fit"})
    return other


def _search(problem: Projection, start: Array, effort: tuple[float, int]) -> Found[Projected]:
    tolerance, evaluations = effort
    return minimum_from(problem, start, tolerance=tolerance, evaluations=evaluations)


def _rough(problem: Projection, starts: list[Array]) -> list[Found[Projected]]:
    """Return the ends of short searches from some starts, the best first."""
    return sorted((_search(problem, start, _ROUGH) for start in starts), key=lambda found: found.cost)


def _followed(problem: Projection, rough: list[Found[Projected]]) -> Found[Projected]:
    """Return the best minimum from the best ends of short searches."""
    ends = [_search(problem, found.end.parameters, _FINE) for found in rough[:_FOLLOWED]]
    return min(ends, key=lambda found: found.cost)


def _without_stop(problem: Projection) -> Found[Projected]:
    return _followed(problem, _rough(problem, [np.full(NODES, np.log(tau)) for tau in _TAUS]))


def _robust(
    first: Callable[[Projection], Found[Projected]], model: ForceModel, weigh: Callable[[Array, float], Array] | None
) -> Found[Projected]:
    """Return the minimum on the whole record with weights that follow its own residuals.

    Args:
        first: Search on a thinned record for the first minimum.
        model: Model of the whole record.
        weigh: Function of residuals (R,) and the force's standard deviation [N]; None for the weights of the model.
    """
    found = first(Projection(model, is_thin=True))
    for _ in range(_WEIGHINGS if weigh else 0):
        assert weigh is not None
        weights = weigh(found.end.error, model.runs.deviation)
        if nearly_equal(weights, model.runs.weights):
            break
        model = model.weighted(weights)
        found = _search(Projection(model, is_thin=True), found.end.parameters, _FINE)
    return _search(Projection(model, is_thin=False), found.end.parameters, _FINE)
