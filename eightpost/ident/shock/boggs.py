"""The dissertation's recipe (3.3): the curve first, then tau on a grid, then LPNL2's parameters by constrained search.

The curve is fitted without lag to the low-passed record and then kept; the model's force is not low-passed again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import Bounds, minimize

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.closed import FadingLag, FullLag, NoLag, dynamics_for
from eightpost.ident.shock.curve import CurveBasis, working_basis
from eightpost.ident.shock.force import FORCE, ForceModel, GasTreatment, gas_columns, limits_for, linear_solution
from eightpost.ident.shock.problem import Solution, block_changes, covariances
from eightpost.ident.shock.runs import Runs, slower_peak
from eightpost.shock import LAWS
from eightpost.units import convert

#: Spacing of the time constants on the grid [s] (3.3.2).
INCREMENT = 1e-4

#: Starting values of the transition forces, relative to the peak static force.
_STARTS = ((0.1, 0.5), (0.3, 0.9), (0.6, 1.5))

_NEGATIVE = "gas stiffness fixed at 0: the fit to this record would make it negative"


#: Transition speed between low and high speed and its width [m/s]: 15 and 0.5 in/s (3.3.1).
TRANSITION_SPEED, TRANSITION_WIDTH = convert(15.0, "in/s", "m/s"), convert(0.5, "in/s", "m/s")

#: If the slower side of the fastest record peaks below this many transition speeds, the transition moves to this share
#: of the peak.
_SLOW, _MOVED = 1.25, 0.6

#: Minimum number of samples for fitting an outer cubic; with fewer the inner polynomial continues as a straight line.
FEWEST_OUTER = 50


def fit_boggs(runs: Runs, law: str, gas: GasTreatment) -> Solution:
    """Return the dissertation's solution, with the printed bounds and a note for each change.

    Raises:
        ParameterError: The dissertation has no recipe for the law.
    """
    columns, notes = gas_columns(runs, gas)
    dynamics = dynamics_for(LAWS[law], limits_for(runs.measured, runs.rate, ceiling=FORCE[1]))
    if not isinstance(dynamics, NoLag | FullLag | FadingLag):
        raise ParameterError("recipe 'boggs' supports the dissertation's laws only; fit this law with 'joint'")
    curve = _curve(runs)
    straight = _sides_without_data(runs, curve.transition_speed)
    basis = working_basis(curve, runs.velocity, curve.ties(straight))
    static = _static(ForceModel(runs, basis, columns, dynamics))
    if isinstance(dynamics, FullLag):
        static = _on_grid(static, dynamics)
    elif isinstance(dynamics, FadingLag):
        static = _constrained(static, dynamics)
    notes = [*_transition_notes(runs, curve), *dynamics.changes(), *map(_straight_note, straight.items()), *notes]
    return replace(static, notes=(*notes, *static.notes))


def _curve(runs: Runs) -> CurveBasis:
    """Return the basis functions of the curve; the transition moves within the speed of slow records."""
    slower = _slower_peak(runs)
    speed = _MOVED * slower if slower < _SLOW * TRANSITION_SPEED else TRANSITION_SPEED
    return CurveBasis(speed, TRANSITION_WIDTH * speed / TRANSITION_SPEED)


def _slower_peak(runs: Runs) -> float:
    return max(slower_peak(p.record["velocity"][p.inside]) for p in runs.prepared)


def _transition_notes(runs: Runs, curve: CurveBasis) -> list[str]:
    if curve.transition_speed == TRANSITION_SPEED:
        return []
    why = f"the record's slower side reaches {_inch(_slower_peak(runs))}"
    speed, width = _inch(curve.transition_speed), _inch(curve.transition_width)
    return [f"transition moved from 15 in/s to {speed}, its width from 0.5 to {width}: {why}"]


def _inch(speed: float) -> str:
    return f"{convert(speed, 'm/s', 'in/s'):.3g} in/s ({speed:.3g} m/s)"


def _sides_without_data(runs: Runs, transition: float) -> dict[str, int]:
    """Return each side with too few samples beyond the transition for a cubic, with the number of these samples."""
    velocity = runs.velocity[runs.inside]
    sides = {"compression": velocity > transition, "rebound": velocity < -transition}
    counts = {side: int(np.sum(beyond)) for side, beyond in sides.items()}
    return {side: count for side, count in counts.items() if count < FEWEST_OUTER}


def _straight_note(side: tuple[str, int]) -> str:
    name, count = side
    why = f"{count} samples beyond the transition, {FEWEST_OUTER} are needed"
    return f"straight line instead of the cubic in {name}: {why}"


def _static(model: ForceModel) -> Solution:
    columns, target = model.linear_columns[model.runs.inside], model.runs.measured
    weights = linear_solution(columns, target)
    if model.gas.size and weights[-1] < 0.0:
        return replace(_static(replace(model, gas=model.gas.without_stiffness())), notes=(_NEGATIVE,))
    at_rows = np.hstack([model.curve_rows(), model.gas_rows])
    error = at_rows @ weights - model.runs.target
    spread, left_out = covariances(at_rows, error, model.runs), block_changes(at_rows, error, model.runs)
    return Solution(model, weights, spread, True, "linear least squares", left_out=left_out)


def _on_grid(static: Solution, dynamics: FullLag) -> Solution:
    """Return the best of tau = 0.1, 0.2, .. 10 ms within the bounds."""
    lowest, highest = dynamics.limits.time_constant
    first, last = int(np.ceil(lowest / INCREMENT * (1.0 - 1e-9))), int(np.floor(highest / INCREMENT * (1.0 + 1e-9)))
    grid = [number * INCREMENT for number in range(first, last + 1)]
    errors = [_error(static, np.array([tau])) for tau in grid]
    return _with_theta(static, np.array([grid[int(np.argmin(errors))]]), True, f"best of {len(grid)} time constants")


def _constrained(static: Solution, dynamics: FadingLag) -> Solution:
    """Minimise over tau and the transition forces by SLSQP, from LPF1's tau and a few pairs of forces."""
    simple = replace(static, model=static.model.with_dynamics(FullLag(dynamics.limits)))
    tau = float(_on_grid(simple, FullLag(dynamics.limits)).parameters[-1])
    curve = static.parameters[: static.model.curve_count]
    peak = float(np.abs(static.model.basis.columns @ curve).max())
    unit = np.array([1e-3, peak, peak])
    bounds = np.array(dynamics.value_bounds()) / unit[:, None]

    def error(values: Array) -> float:
        return _error(static, dynamics.theta(*(values * unit).tolist()))

    def apart(values: Array) -> float:
        return float(values[2] - values[1]) - dynamics.limits.gap / peak

    results = [
        minimize(
            error,
            np.clip(np.array([tau, full * peak, zero * peak]) / unit, *bounds.T),
            method="SLSQP",
            bounds=Bounds(*bounds.T),
            constraints={"type": "ineq", "fun": apart},
            options={"ftol": 1e-9, "maxiter": 100},
        )
        for full, zero in _STARTS
    ]
    best = min(results, key=lambda result: float(result.fun))
    theta = dynamics.theta(*(best.x * unit).tolist())
    return _with_theta(static, theta, bool(best.success), f"SLSQP: {best.message}")


def _error(static: Solution, theta: Array) -> float:
    """Return the mean square error over the force's variance [1] with a fixed curve."""
    model = static.model
    force = model.force(np.append(static.parameters, theta))[model.runs.inside]
    return float(np.mean((force - model.runs.measured) ** 2)) / model.runs.deviation**2


def _with_theta(static: Solution, theta: Array, converged: bool, status: str) -> Solution:
    """Add theta to the static solution; its covariance is that of theta alone, because the curve was fixed."""
    model, m = static.model, static.parameters.size
    parameters = np.append(static.parameters, theta)
    spread = np.zeros((len(static.covariance), parameters.size, parameters.size))
    spread[:, :m, :m] = static.covariance
    by_theta = model.rows_jacobian(parameters)[:, model.linear_count :]
    error = model.rows(parameters) - model.runs.target
    spread[:, m:, m:] = covariances(by_theta, error, model.runs)
    left_out = np.hstack([static.left_out, block_changes(by_theta, error, model.runs)])
    return Solution(model, parameters, spread, converged, status, static.notes, left_out)
