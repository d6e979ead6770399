"""Dynamics of laws in a fit: closed forms where a law declares one, else the functions of its file, stepped."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.extras import needs
from eightpost.ident.shock.curve import KnotBasis
from eightpost.ident.shock.force import Dynamics, ForceModel, LawLimits
from eightpost.ident.shock.simulation import array_form, lag, lag_sensitivity
from eightpost.least_squares import Parameters, linear_solution
from eightpost.shock import FitParameter, ShockLaw, Valve, fit_form, fit_parameters, law_module

# ==== Laws that are fitted by stepping their own functions ===========================================================

# ---- A law's own parameters ----------------------------------------------------------------------------------------


class OwnParameters(Dynamics):
    """Dynamics whose theta are the coordinates of parameters that are declared with their bounds."""

    own: Parameters

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the law's own parameters."""
        return tuple(p.name for p in self.own.declared)

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the law's own parameters."""
        return tuple(p.unit for p in self.own.declared)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta."""
        return self.own.bounds()

    def values(self, theta: Array) -> Array:
        """Return the law's own parameters."""
        return self.own.values(theta)

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta."""
        return self.own.jacobian(theta)

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of the law's own parameters."""
        return self.own.value_bounds()


# ---- Dynamics of a law that is known only by its file ---------------------------------------------------------------

#: Steps for differences: of a curve parameter over the force's standard deviation, of theta over its range, or of its
#: logarithm.
_CURVE_STEP, _OWN_STEP = 1e-5, 1e-5

#: Number of values in the scan of a parameter, and half the range of the scan about the start of a logarithm.
_SCAN, _SCANNED = 9, np.log(30.0)


@dataclass(frozen=True)
class SteppedLaw(OwnParameters):
    """Any law with `advance_core`, `weight_core` and `FIT_PARAMETERS` in its file.

    theta are the law's own parameters; see `Parameters`.
    """

    limits: LawLimits  #: Bounds for the record; LPF1's lag is searched within them.
    kind: type[ShockLaw]  #: The law's class.
    own: Parameters = field(init=False)  #: The law's own parameters as declared in its file.
    _last: list[tuple[object, Array]] = field(init=False, default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "own", Parameters(fit_parameters(self.kind)))

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Step every run through the law; the last result is cached, because its derivatives are needed next."""
        key = (model, b.tobytes(), theta.tobytes())
        if not self._last or self._last[0][0] != key:
            self._last[:] = [(key, self._stepped(model, b, theta))]
        return self._last[0][1]

    def _stepped(self, model: ForceModel, b: Array, theta: Array) -> Array:
        with needs("fit", "fitting a law with dynamics"):
            from eightpost.shock.records import stepped_force  # noqa: PLC0415 - LLVM, which other laws do not need

        assert isinstance(model.basis.curve, KnotBasis)
        curve = model.basis.curve.static_curve(model.basis.to_curve @ b)
        valve, own = Valve(curve.numbers(), 1.0, 1.0), tuple(self.values(theta).tolist())
        forces = []
        for prepared, part in zip(model.runs.prepared, model.runs.parts, strict=True):
            velocity = model.runs.velocity[part]
            step = np.full(velocity.size - 1, prepared.step)
            forces.append(stepped_force(self.kind, valve, own, velocity, step))
        return np.concatenate(forces)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Step every run through the law, then apply the low-pass."""
        return model.runs.rows(self.force(model, b, theta))

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return derivatives by differences on a thinned record: the rows are the same, and accuracy is sufficient."""
        coarse = model.coarse
        here = self.force(coarse, b, theta)
        small = _CURVE_STEP * model.runs.deviation
        moved = [self.force(coarse, b + small * unit, theta) - here for unit in np.eye(b.size)]
        low, high = self.bounds()
        steps = _OWN_STEP * np.where(self.own.logarithmic, 1.0, high - low)
        steps = np.where(theta + steps > high, -steps, steps)
        own = [self.force(coarse, b, theta + step) - here for step in np.diag(steps)]
        by_curve = coarse.runs.rows(np.array(moved) / small).T
        return by_curve, coarse.runs.rows(np.array(own).reshape(theta.size, -1) / steps[:, None]).T

    def like_full_lag(self, model: ForceModel, full_lag: Array) -> Array:
        """Return the theta whose response to LPF1's curve is closest to LPF1's; each parameter is scanned in turn."""
        coarse, b = model.coarse, full_lag[: model.curve_count]
        target = model.lagged_rows(b, float(full_lag[-1]))
        theta = self.own.start()
        low, high = self.bounds()
        reach = np.where(self.own.logarithmic, _SCANNED, np.inf)
        low, high = np.maximum(low, theta - reach), np.minimum(high, theta + reach)
        for number in range(theta.size):
            trials = np.tile(theta, (_SCAN, 1))
            trials[:, number] = np.linspace(low[number], high[number], _SCAN)
            errors = [float(np.sum((self.rows(coarse, b, t) - target) ** 2)) for t in trials]
            theta = trials[int(np.nanargmin(errors))]
        return theta


# ==== Closed forms ===================================================================================================

# ---- Variable projection --------------------------------------------------------------------------------------------

#: Number of values of tau in the first scan, evenly spaced in its logarithm between the bounds.
_TAU_SCAN = 12


def projected(model: ForceModel, curve_rows: Array) -> tuple[Array, float]:
    """Return curve and gas (n + g,) for columns of the curve at the rows (R, n), and the sum of squares [N2]."""
    runs = model.runs
    root = np.sqrt(runs.weights)
    columns, target = root[:, None] * np.hstack([curve_rows, model.gas_rows]), root * runs.target
    penalty = np.hstack([model.penalty, np.zeros((len(model.penalty), model.gas.count))])
    gram = columns.T @ columns + penalty.T @ penalty
    # The basis is orthogonal and a lag changes that little, so the normal equations are accurate, and fast.
    if np.linalg.cond(gram) < 1e10:
        weights = np.linalg.solve(gram, columns.T @ target)
    else:
        weights = linear_solution(np.vstack([columns, penalty]), np.append(target, np.zeros(len(penalty))))
    return np.asarray(weights, dtype=np.float64), float(
        np.sum((columns @ weights - target) ** 2) + np.sum((penalty @ weights) ** 2)
    )


def best_lag(model: ForceModel, bounds: tuple[float, float]) -> Array:
    """Return curve, gas and tau (n + g + 1,) of the best single lag: a scan of tau, then a search."""

    def cost(logarithm: float) -> float:
        return projected(model, model.curve_rows(float(np.exp(logarithm))))[1]

    grid = np.log(np.geomspace(*bounds, _TAU_SCAN))
    best = int(np.argmin([cost(value) for value in grid]))
    bracket = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _TAU_SCAN - 1)])
    found = minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 1e-4})
    tau = float(np.exp(found.x))
    return np.append(projected(model, model.curve_rows(tau))[0], tau)


# ---- Dynamics of the laws whose force has a closed form over a whole record -----------------------------------------

#: Relative step of tau for its derivative by differences.
_TAU_STEP = 1e-4

#: Starting points of a fading lag: tau relative to the best single lag, transition forces to the peak static force.
_TAU_SHARES = (1.0, 1.7)
_FULL_SHARES, _ZERO_SHARES = (0.03, 0.15, 0.5), (0.4, 0.8, 1.6)


@dataclass(frozen=True)
class NoLag(Dynamics):
    """No lag: F = F_s."""

    limits: LawLimits
    kind: type[ShockLaw] | None = None
    is_costly = False

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_s."""
        return model.static(b)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_s at the rows."""
        return model.curve_rows() @ b

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives; the force is linear in the curve."""
        columns = model.curve_rows()
        return columns, np.empty((columns.shape[0], 0))


@dataclass(frozen=True)
class FullLag(OwnParameters):
    """Full lag: F = F_lag (Eq 3.24); theta = (tau,) [s]."""

    limits: LawLimits
    kind: type[ShockLaw] | None = None
    is_costly = False  # a lag adds almost no cost in the spectrum

    @cached_property
    def own(self) -> Parameters:  # type: ignore[override]
        """The time constant within the bounds of the record."""
        return Parameters((_time_constant(self.limits),))

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_lag."""
        static = model.static(b)
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        return np.concatenate([lag(static[part], theta[0], p.step) for p, part in pairs])

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_lag at the rows."""
        return model.lagged_rows(b, theta[0])

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives: exact for the curve, by a central difference for tau."""
        step = _TAU_STEP * theta[0]
        by_tau = model.lagged_rows(b, theta[0] + step) - model.lagged_rows(b, theta[0] - step)
        return model.curve_rows(theta[0]), by_tau[:, None] / (2.0 * step)

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau."""
        return self.limits.lag_changes


@dataclass(frozen=True)
class FadingLag(OwnParameters):
    """Fading lag: alpha, given by the law's file, falls from 1 to 0 between two static forces (Eq 3.25).

    theta = (tau [s], F_1 [N], share of the range left to F_2), so that F_2 - F_1 is at least the gap.
    """

    limits: LawLimits
    kind: type[ShockLaw]

    @cached_property
    def own(self) -> Parameters:  # type: ignore[override]
        """The parameters within the bounds of the record."""
        (low, high), gap = self.limits.force, self.limits.gap
        _, full, zero = fit_parameters(self.kind)
        ends = full._replace(low=low, high=high), zero._replace(low=low + gap, high=high, gap=gap)
        return Parameters((_time_constant(self.limits), *ends))

    def weight(self, static: Array, theta: Array) -> Array:
        """Return alpha (N,) [1] at static forces (N,) [N]."""
        return np.asarray(array_form(law_module(self.kind).weight_core)(static, tuple(self.values(theta).tolist())))

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = alpha F_lag + (1 - alpha) F_s."""
        static = model.static(b)
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        behind = np.concatenate([lag(static[part], theta[0], p.step) for p, part in pairs]) - static
        return np.asarray(static + self.weight(static, theta) * behind)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = alpha F_lag + (1 - alpha) F_s at the rows."""
        return model.runs.rows(self.force(model, b, theta))

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives in closed form, through F_s, F_lag and alpha."""
        static, columns = model.static(b), model.basis.columns.T
        slopes = array_form(law_module(self.kind).weight_slopes_core)
        own, by_values = tuple(self.values(theta).tolist()), self.values_jacobian(theta).T
        changes = np.empty((columns.shape[0] + theta.size, static.size))
        by_curve, by_theta = np.split(changes, [columns.shape[0]])
        for p, part in zip(model.runs.prepared, model.runs.parts, strict=True):
            force, here = static[part], columns[:, part]
            lagged, weight = lag(force, own[0], p.step), self.weight(force, theta)
            by_force, *by_ends = slopes(force, lagged - force, own)
            by_tau = weight * lag_sensitivity(force, lagged, own[0], p.step)
            by_theta[:, part] = by_values @ np.vstack([by_tau, *by_ends])
            np.multiply(here, 1.0 - weight + by_force, out=by_curve[:, part])
            by_curve[:, part] += weight * lag(here.T, own[0], p.step).T
        by_curve, by_theta = np.split(model.runs.rows(changes), [columns.shape[0]])
        return by_curve.T, by_theta.T

    def like_full_lag(self, model: ForceModel, full_lag: Array) -> Array:
        """Return theta with alpha = 1 up to the peak of the static force."""
        peak = float(np.abs(model.static(full_lag[: model.curve_count])).max())
        return self.theta(float(full_lag[-1]), 1.05 * peak, 1.5 * peak)

    def starts(self, model: ForceModel, full_lag: Array, count: int) -> list[Array]:
        """Return the best starting points of a grid; alpha is that of LPF1's static force, so the rows are linear."""
        static, columns = model.static(full_lag[: model.curve_count]), model.basis.columns.T
        taus = np.minimum(float(full_lag[-1]) * np.array(_TAU_SHARES), self.limits.time_constant[1])
        peak, starts = float(np.abs(static).max()), []
        ends = [(full * peak, zero * peak) for full in _FULL_SHARES for zero in _ZERO_SHARES if zero > full]
        for tau in taus.tolist():
            pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
            behind = np.hstack([lag(columns[:, part].T, tau, p.step).T for p, part in pairs]) - columns
            for theta in (self.theta(tau, *forces) for forces in ends):
                linear, cost = projected(model, model.runs.rows(columns + self.weight(static, theta) * behind).T)
                starts.append((cost, np.append(linear, theta)))
        starts.sort(key=lambda start: start[0])
        return [parameters for _, parameters in starts[:count]]

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau and of the forces."""
        return (*self.limits.lag_changes, *self.limits.force_changes)

    def theta(self, time_constant: float, full: float, zero: float) -> Array:
        """Return theta of tau [s], F_1 and F_2 [N]; forces outside the bounds are moved inside."""
        return self.own.theta(np.array([time_constant, full, zero]))


def _time_constant(limits: LawLimits) -> FitParameter:
    low, high = limits.time_constant
    return FitParameter("time_constant", "s", low, low, high, "linear")


# ---- Choice of the dynamics -----------------------------------------------------------------------------------------


def dynamics_for(law: type[ShockLaw], limits: LawLimits) -> Dynamics:
    """Return the dynamics of a law."""
    forms: dict[str, type[NoLag | FullLag | FadingLag]] = {"no lag": NoLag, "lag": FullLag, "fading lag": FadingLag}
    form = fit_form(law)
    if form in forms:
        return forms[form](limits, law)
    return SteppedLaw(limits, law)
