"""Search for the parameters of the law `hysteresis` by variable projection.

Given the parameters of the states (ln tau, and yield travel and time constant of the stop), the force is linear in
everything else: slopes of f0 and f1, stop force, gas force. These follow from non-negative least squares, so the search
has three or five dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cholesky, solve_triangular
from scipy.optimize import nnls

from eightpost.array_types import Array
from eightpost.ident.shock.force import ForceModel
from eightpost.ident.shock.hysteresis_model import NODES, LaggedVelocity, knots_of
from eightpost.ident.shock.knots import RIDGE
from eightpost.ident.shock.lagged_states import States
from eightpost.ident.shock.runs import Runs
from eightpost.progress import beats
from eightpost.shock.curve import KNOTS

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
