"""Dynamics of laws in a fit: closed forms where a law declares one, else the functions of its file, stepped."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.ident.shock.curve import KnotBasis
from eightpost.ident.shock.force import Dynamics, ForceModel, Limits, linear_solution
from eightpost.ident.shock.simulation import array_form, lag, lag_sensitivity
from eightpost.shock import CurveNumbers, FitParameter, ShockLaw, Valve, fit_form, fit_parameters, law_module

# ==== Laws that are fitted by stepping their own functions ===========================================================

# ---- A law's own parameters as declared in its file, and their coordinates in the optimiser's box -------------------


@dataclass(frozen=True, slots=True)
class _OwnParameters:
    """Parameters (k,) and theta (k,), their coordinates in a box.

    theta is the parameter itself, or its logarithm if the scale is logarithmic. If a parameter must stay above another
    one by a gap, its coordinate is its share u of the remaining range: value = low + u (high - low) with
    low = max(declared low, other + gap), so that 0 <= u <= 1 ensures all conditions.

    Raises:
        ValueError: A parameter is above one that is not declared before it.
    """

    declared: tuple[FitParameter, ...]  #: Declarations of the law's file, in the order of its fields.

    def __post_init__(self) -> None:
        for i, parameter in enumerate(self.declared):
            before = [p.name for p in self.declared[:i]]
            if parameter.above and parameter.above not in before:
                what = f"{parameter.name} is above {parameter.above!r}, which must be declared before it"
                raise ValueError(f"FIT_PARAMETERS: {what}; declared before it: {', '.join(before) or 'none'}")

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Whether each theta (k,) is a logarithm."""
        return np.array([p.scale == "logarithmic" and not p.above for p in self.declared], dtype=bool)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta (k,)."""
        pairs = [(0.0, 1.0) if p.above else (p.low, self._highest(i)) for i, p in enumerate(self.declared)]
        low, high = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
        return self._logarithms(low), self._logarithms(high)

    def start(self) -> Array:
        """Return theta (k,) of the declared starts, moved inside the box."""
        return self.theta(np.array([p.start for p in self.declared], dtype=np.float64))

    def theta(self, values: Array) -> Array:
        """Return theta (k,) of values (k,), moved inside the box."""
        theta = self._logarithms(np.where(self.logarithmic, np.maximum(values, 1e-300), values))
        for i, parameter in enumerate(self.declared):
            if parameter.above:
                low, high, _ = self._room(i, values)
                theta[i] = (values[i] - low) / max(high - low, 1e-300)
        return np.clip(theta, *self.bounds())

    def values(self, theta: Array) -> Array:
        """Return the parameters (k,), SI."""
        found = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, theta, 0.0)), theta)
        for i in self._dependent:
            low, high, _ = self._room(i, found)
            found[i] = low + theta[i] * (high - low)
        return np.asarray(found)

    def jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta (k, k)."""
        values = self.values(theta)
        found = np.diag(np.where(self.logarithmic, values, 1.0))
        for i in self._dependent:
            low, high, moves = self._room(i, values)
            found[i] = (1.0 - theta[i]) * found[self._below(i)] if moves else 0.0
            found[i, i] = high - low
        return found

    @property
    def _dependent(self) -> list[int]:
        return [i for i, p in enumerate(self.declared) if p.above]

    def _below(self, i: int) -> int:
        return [p.name for p in self.declared].index(self.declared[i].above)

    def _room(self, i: int, values: Array) -> tuple[float, float, bool]:
        """Return the range left to a parameter that is above another one, and whether its lower end depends on that."""
        parameter, below = self.declared[i], float(values[self._below(i)]) + self.declared[i].gap
        return max(parameter.low, below), max(self._highest(i), below), below > parameter.low

    def _highest(self, i: int) -> float:
        """Return the highest value that leaves enough range for the parameters above."""
        name = self.declared[i].name
        rooms = [self._highest(j) - p.gap for j, p in enumerate(self.declared) if p.above == name]
        return min([self.declared[i].high, *rooms])

    def _logarithms(self, values: Array) -> Array:
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values)


# ---- Dynamics of a law that is known only by its file ---------------------------------------------------------------

#: Steps for differences: of a curve parameter over the force's standard deviation, of theta over its scale.
_CURVE_STEP, _OWN_STEP = 1e-5, 1e-4

#: Number of values in the scan of a parameter, and half the range of the scan about the start of a logarithm.
_SCAN, _SCANNED = 9, np.log(30.0)


@dataclass(frozen=True)
class SteppedLaw(Dynamics):
    """Any law with `advance_core`, `weight_core` and `FIT_PARAMETERS` in its file.

    theta are the law's own parameters; see `_OwnParameters`.
    """

    limits: Limits  #: Bounds for the record; LPF1's lag is searched within them.
    kind: type[ShockLaw]  #: The law's class.
    own: _OwnParameters = field(init=False)  #: The law's own parameters as declared in its file.
    _last: list[tuple[object, Array]] = field(init=False, default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "own", _OwnParameters(fit_parameters(self.kind)))

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the law's own parameters."""
        return tuple(p.name for p in self.own.declared)

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the law's own parameters."""
        return tuple(p.unit for p in self.own.declared)

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Step every run through the law; the last result is cached, because its derivatives are needed next."""
        key = (model, b.tobytes(), theta.tobytes())
        if not self._last or self._last[0][0] != key:
            self._last[:] = [(key, self._stepped(model, b, theta))]
        return self._last[0][1]

    def _stepped(self, model: ForceModel, b: Array, theta: Array) -> Array:
        from eightpost.shock.compiled import stepped_force  # noqa: PLC0415 - the compiler takes a second to load

        valve, own = Valve(_numbers(model, b), 1.0, 1.0), tuple(self.values(theta).tolist())
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
        steps = self._steps(theta)
        own = [self.force(coarse, b, theta + step) - here for step in np.diag(steps)]
        by_curve = coarse.runs.rows(np.array(moved) / small).T
        return by_curve, coarse.runs.rows(np.array(own).reshape(theta.size, -1) / steps[:, None]).T

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta."""
        return self.own.bounds()

    def scale(self) -> Array:
        """Return a tenth: of the logarithm, or of the range."""
        low, high = self.bounds()
        return np.where(self.own.logarithmic, 0.1, 0.1 * (high - low))

    def values(self, theta: Array) -> Array:
        """Return the law's own parameters."""
        return self.own.values(theta)

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta."""
        return self.own.jacobian(theta)

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the declared bounds."""
        return tuple((p.low, p.high) for p in self.own.declared)

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

    def _steps(self, theta: Array) -> Array:
        _, high = self.bounds()
        steps = _OWN_STEP * self.scale()
        return np.where(theta + steps > high, -steps, steps)


def _numbers(model: ForceModel, b: Array) -> CurveNumbers:
    """Return the curve of b."""
    assert isinstance(model.basis.curve, KnotBasis)
    return model.basis.curve.static_curve(model.basis.to_curve @ b).numbers()


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
    return weights, float(np.sum((columns @ weights - target) ** 2) + np.sum((penalty @ weights) ** 2))


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


@dataclass(frozen=True, slots=True)
class NoLag(Dynamics):
    """No lag: F = F_s."""

    limits: Limits
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


@dataclass(frozen=True, slots=True)
class FullLag(Dynamics):
    """Full lag: F = F_lag (Eq 3.24); theta = (tau,) [s]."""

    limits: Limits
    kind: type[ShockLaw] | None = None
    names = ("time_constant",)
    units = ("s",)
    is_costly = False  # a lag adds almost no cost in the spectrum

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

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau."""
        lowest, highest = self.limits.time_constant
        return np.array([lowest]), np.array([highest])

    def scale(self) -> Array:
        """Return a change of 1 ms."""
        return np.array([1e-3])

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of tau [s]."""
        return (self.limits.time_constant,)

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau."""
        return self.limits.lag_changes


@dataclass(frozen=True, slots=True)
class FadingLag(Dynamics):
    """Fading lag: alpha, given by the law's file, falls from 1 to 0 between two static forces (Eq 3.25).

    theta = (tau [s], F_1 [N], u [1]) with F_2 = F_1 + g + u (F_max - g - F_1), 0 <= u <= 1, so that
    F_2 - F_1 >= g and F_2 <= F_max are plain bounds.
    """

    limits: Limits
    kind: type[ShockLaw]

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the law's own parameters."""
        return tuple(p.name for p in fit_parameters(self.kind))

    units = ("s", "N", "N")

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
        starts = []
        for tau in taus.tolist():
            pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
            behind = np.hstack([lag(columns[:, part].T, tau, p.step).T for p, part in pairs]) - columns
            for theta in self._start_thetas(tau, float(np.abs(static).max())):
                linear, cost = projected(model, model.runs.rows(columns + self.weight(static, theta) * behind).T)
                starts.append((cost, np.append(linear, theta)))
        starts.sort(key=lambda start: start[0])
        return [parameters for _, parameters in starts[:count]]

    def _start_thetas(self, tau: float, peak: float) -> list[Array]:
        pairs = [(full, zero) for full in _FULL_SHARES for zero in _ZERO_SHARES if zero > full]
        return [self.theta(tau, full * peak, zero * peak) for full, zero in pairs]

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau, F_1 and u."""
        (shortest, longest), (lowest, highest) = self.limits.time_constant, self.limits.force
        return np.array([shortest, lowest, 0.0]), np.array([longest, highest - self.limits.gap, 1.0])

    def scale(self) -> Array:
        """Return a change of 1 ms and of a tenth of the forces."""
        return np.array([1e-3, 0.1 * self.limits.force[1], 0.1])

    def values(self, theta: Array) -> Array:
        """Return tau [s], F_1 and F_2 [N]."""
        return np.array([theta[0], theta[1], theta[1] + self.limits.gap + theta[2] * self._room(theta)])

    def values_jacobian(self, theta: Array) -> Array:
        """Return d(tau, F_1, F_2)/dtheta (3, 3)."""
        jacobian = np.eye(3)
        jacobian[2] = (0.0, 1.0 - theta[2], self._room(theta))
        return jacobian

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of tau [s], F_1 and F_2 [N]."""
        lowest, highest = self.limits.force
        return self.limits.time_constant, (lowest, highest - self.limits.gap), (lowest + self.limits.gap, highest)

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau and of the forces."""
        return (*self.limits.lag_changes, *self.limits.force_changes)

    def theta(self, time_constant: float, full: float, zero: float) -> Array:
        """Return theta of tau [s], F_1 and F_2 [N]; forces outside the bounds are moved inside."""
        low, high = self.bounds()
        full = float(np.clip(full, low[1], high[1]))
        room = max(self.limits.force[1] - self.limits.gap - full, 1e-9 * self.limits.force[1])
        return np.clip([time_constant, full, (zero - full - self.limits.gap) / room], low, high)

    def _room(self, theta: Array) -> float:
        return float(self.limits.force[1] - self.limits.gap - theta[1])


# ---- Choice of the dynamics -----------------------------------------------------------------------------------------


def dynamics_for(law: type[ShockLaw], limits: Limits) -> Dynamics:
    """Return the dynamics of a law."""
    forms: dict[str, type[NoLag | FullLag | FadingLag]] = {"no lag": NoLag, "lag": FullLag, "fading lag": FadingLag}
    form = fit_form(law)
    if form in forms:
        return forms[form](limits, law)
    return SteppedLaw(limits, law)
