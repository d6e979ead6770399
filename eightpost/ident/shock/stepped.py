"""Laws that are fitted by stepping their own functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.curve import WorkingBasis
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.knots import KnotBasis
from eightpost.ident.shock.limits import Limits
from eightpost.shock import CurveNumbers, FitParameter, ShockLaw, StaticCurve, Valve, fit_parameters
from eightpost.shock.compiled import compiled_loop, stepped_force

# ---- A law's own parameters as declared in its file, and their coordinates in the optimiser's box -------------------


@dataclass(frozen=True, slots=True)
class _OwnParameters:
    """Parameters (k,) and theta (k,), their coordinates in a box.

    theta is the parameter itself, or its logarithm if the scale is logarithmic. If a parameter must stay above another
    one by a gap, its coordinate is its share u of the remaining range: value = low + u (high - low) with
    low = max(declared low, other + gap), so that 0 <= u <= 1 ensures all conditions.

    Attributes:
        declared: Declarations of the law's file, in the order of its fields.

    Raises:
        ValueError: A parameter is above one that is not declared before it.
    """

    declared: tuple[FitParameter, ...]

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

#: A falling curve, to test whether a law rejects it.
_FALLING = StaticCurve(
    (-1.0, *[0.0] * 14), (-1.0, -1.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), 0.381, 0.0127, 1.0, 1.0, 0.0, 0.0
)


@dataclass(frozen=True)
class SteppedLaw(Dynamics):
    """Any law with `advance_core`, `weight_core` and `FIT_PARAMETERS` in its file.

    theta are the law's own parameters; see `_OwnParameters`.

    Attributes:
        limits: Bounds for the record; LPF1's lag is searched within them.
        kind: The law's class.
        own: The law's own parameters as declared in its file.
    """

    limits: Limits
    kind: type[ShockLaw]
    own: _OwnParameters = field(init=False)
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

    @property
    def needs_rise(self) -> bool:
        """Whether the law rejects a falling curve."""
        start = self.values(self.own.start())
        try:
            self.kind(_FALLING, **dict(zip(self.names, start.tolist(), strict=True)))
        except ValueError:
            return True
        return False

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Step every run through the law; the last result is cached, because its derivatives are needed next."""
        key = (model, b.tobytes(), theta.tobytes())
        if not self._last or self._last[0][0] != key:
            self._last[:] = [(key, self._stepped(model, b, theta))]
        return self._last[0][1]

    def _stepped(self, model: ForceModel, b: Array, theta: Array) -> Array:
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


# ---- Maxwell's law in the fit ---------------------------------------------------------------------------------------

#: Points of the velocity table. Between them the curve is treated as straight, accurate to a hundredth of a newton.
_TABLE = 4001


class _TablePoint(NamedTuple):
    """Result of a table look-up: velocities w (N,) [m/s], slopes f'(w) (N,) [N.s/m], columns at w (N, n)."""

    velocity: Array
    slope: Array
    columns: Array


@dataclass(frozen=True)
class SeriesSpring(SteppedLaw):
    """Maxwell: theta = (ln k,), k [N/m] the stiffness in series with the valves."""

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives by one pass of a varying lag over the curve's columns at w."""
        point, stiffness = _look_up(model.basis, b, self.force(model, b, theta)), float(np.exp(theta[0]))
        strain = point.slope * (model.runs.velocity - point.velocity)
        columns = np.vstack([point.columns.T, strain]).T
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        lagged = [_lagged_columns(columns[part], point.slope[part] / stiffness, p.step) for p, part in pairs]
        rows = model.runs.rows(np.concatenate(lagged).T).T
        return rows[:, :-1], rows[:, -1:]

    def like_full_lag(self, model: ForceModel, full_lag: Array) -> Array:
        """Return ln k with k = slope / tau, where slope is the mean slope of the curve over the samples."""
        b = full_lag[: model.curve_count]
        slope = _look_up(model.basis, b, model.static(b)).slope
        low, high = self.bounds()
        return np.clip(np.log([float(slope.mean()) / float(full_lag[-1])]), low, high)


@lru_cache(maxsize=4)
def _grid(basis: WorkingBasis) -> tuple[Array, Array]:
    """Return the table's velocities (M,) [m/s] and the basis's columns there (M, n)."""
    velocity = np.linspace(basis.curve.knots[0], basis.curve.knots[-1], _TABLE)
    return velocity, np.asfortranarray(basis.at(velocity))


def _rising(basis: WorkingBasis, b: Array) -> Array:
    """Return rising forces (M,) [N] of a curve b at the grid; a curve may fall during the fit, the result does not."""
    _, columns = _grid(basis)
    return np.asarray(np.maximum.accumulate(columns @ b) + 1e-9 * np.arange(_TABLE))


def _look_up(basis: WorkingBasis, b: Array, force: Array) -> _TablePoint:
    """Look forces (N,) [N] up on a curve b."""
    velocity, columns = _grid(basis)
    slope = np.maximum(np.gradient(columns @ b, velocity), 1.0)
    place = np.interp(force, _rising(basis, b), np.arange(float(_TABLE)))
    cell = np.minimum(place.astype(np.intp), _TABLE - 2)
    share = place - cell
    series = np.take(columns.T, cell, axis=1) * (1.0 - share) + np.take(columns.T, cell + 1, axis=1) * share
    between = velocity[0] + place * (velocity[1] - velocity[0])
    return _TablePoint(between, slope[cell] * (1.0 - share) + slope[cell + 1] * share, series.T)


#: Lags shorter than this share of the sampling interval are treated as zero.
_SHORTEST_SHARE = 1e-9


def _lagged_columns(columns: Array, time_constant: Array, step: float) -> Array:
    """Return columns (N, n) behind a first-order lag with varying time constant; each starts at its own first value.

    Args:
        columns: Columns (N, n), contiguous in memory, as are the returned ones.
        time_constant: Time constant (N,) [s]; between two samples their mean applies.
        step: Sampling interval [s].
    """
    lagged = np.empty(columns.shape[::-1])
    tau = np.maximum(0.5 * (time_constant[:-1] + time_constant[1:]), _SHORTEST_SHARE * step)
    rise = -np.expm1(-step / tau)
    _lag_machine()(np.ascontiguousarray(columns.T), rise, 1.0 - rise * tau / step, lagged)
    return lagged.T


@cache
def _lag_machine() -> Callable[..., None]:
    def loop(series: Any, rise: Any, weight: Any, lagged: Any) -> None:
        for j in range(series.shape[0]):
            before, start = series[j, 0], series[j, 0]
            lagged[j, 0] = before
            for n in range(rise.size):
                end = series[j, n + 1]
                before += (start - before) * rise[n] + (end - start) * weight[n]
                lagged[j, n + 1] = before
                start = end

    return compiled_loop(loop)
