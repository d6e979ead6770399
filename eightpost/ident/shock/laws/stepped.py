"""Dynamics of a law that is known only by its file: it is fitted by stepping it, starting from LPF1's solution."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.basis import split_coefficients
from eightpost.ident.shock.force.dynamics import Dynamics
from eightpost.ident.shock.laws.compiled import stepped_force
from eightpost.ident.shock.laws.own import OwnParameters
from eightpost.shock import CurveNumbers, StaticCurve, Valve, fit_parameters

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.limits import Limits
    from eightpost.shock import Port, ShockLaw

    Array = NDArray[np.float64]

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

    theta are the law's own parameters; see `OwnParameters`.

    Attributes:
        limits: Bounds for the record; LPF1's lag is searched within them.
        kind: The law's class.
        own: The law's own parameters as declared in its file.
    """

    limits: Limits
    kind: type[ShockLaw]
    own: OwnParameters = field(init=False)
    _last: list[tuple[object, Array]] = field(init=False, default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "own", OwnParameters(fit_parameters(self.kind)))

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

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law."""
        return self.kind(curve, **dict(zip(self.names, self.values(theta).tolist(), strict=True)), port=port)

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

    def like_lpf1(self, model: ForceModel, lpf1: Array) -> Array:
        """Return the theta whose response to LPF1's curve is closest to LPF1's; each parameter is scanned in turn."""
        coarse, b = model.coarse, lpf1[: model.curve_count]
        target = model.lagged_rows(b, float(lpf1[-1]))
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
    """Return the curve of b; beyond the velocities of the record it continues with a chord of its last part."""
    inner, compression, rebound = split_coefficients(model.basis.to_curve @ b)
    force, grid = model.basis.grid_columns @ b, model.basis.grid
    last = max(grid.size // 50, 1)
    slopes = [float((force[i] - force[j]) / (grid[i] - grid[j])) for i, j in ((-1, -1 - last), (last, 0))]
    curve = model.basis.curve
    return CurveNumbers(
        inner, compression, rebound, curve.transition_speed, curve.transition_width,
        float(grid[-1]), float(-grid[0]), max(slopes[0], 1.0), max(slopes[1], 1.0),
    )  # fmt: skip
