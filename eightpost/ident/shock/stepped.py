"""Laws that are fitted by stepping their own functions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.curve import KnotBasis
from eightpost.ident.shock.force import Dynamics, ForceModel, Limits
from eightpost.shock import CurveNumbers, FitParameter, ShockLaw, Valve, fit_parameters

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
