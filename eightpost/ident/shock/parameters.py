"""The scalar parameters of a fit: value, uncertainty, bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.solution import Solution

    Array = NDArray[np.float64]

_UNITS = {
    "time_constant": "s", "lag_full_force": "N", "lag_zero_force": "N", "gas_preload": "N", "gas_stiffness": "N/m",
}  # fmt: skip

#: A parameter within this share of a bound has hit it.
_AT_BOUND = 0.01


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fitted parameter.

    Attributes:
        name: As in the shock file.
        value: In `unit`.
        unit: SI.
        error: Standard error by the Jacobian at the solution; None where the record does not determine it. It
            counts noise, not what the law cannot say.
        bounds: Lowest and highest value that the fit allowed; None without.
    """

    name: str
    value: float
    unit: str
    error: float | None
    bounds: tuple[float, float] | None = None

    @property
    def at_bound(self) -> str:
        """`lower` or `upper` when the value is within 1 % of that bound (of its error at 0), else empty."""
        if self.bounds is None:
            return ""
        for name, bound in zip(("lower", "upper"), self.bounds, strict=True):
            if np.isfinite(bound) and abs(self.value - bound) <= _AT_BOUND * max(abs(bound), self.error or 0.0):
                return name
        return ""


def parameters_of(solution: Solution) -> tuple[Parameter, ...]:
    """Return the law's own parameters, then those of the gas force that were fitted."""
    model = solution.model
    _, g, theta = model.split(solution.parameters)
    n, m = model.curve_count, model.linear_count
    jacobian = model.dynamics.values_jacobian(theta)
    own = zip(
        model.dynamics.names,
        model.dynamics.values(theta).tolist(),
        _errors(jacobian, solution.covariance[m:, m:]),
        model.dynamics.value_bounds(),
        strict=True,
    )
    found = [Parameter(name, value, _UNITS[name], error, bounds) for name, value, error, bounds in own]
    gas_errors = _errors(np.diag(1.0 / model.gas.sizes), solution.covariance[n:m, n:m])
    gas = zip(("gas_preload", "gas_stiffness"), model.gas.values(g), gas_errors, strict=False)
    bounds = {"gas_stiffness": (0.0, float("inf"))}
    found += [Parameter(name, value, _UNITS[name], error, bounds.get(name)) for name, value, error in gas]
    return tuple(found)


def _errors(jacobian: Array, covariance: Array) -> list[float | None]:
    """Return the standard errors of values whose Jacobian by the covariance's parameters is given.

    A value that depends on what is not determined (NaN) is not determined either.
    """
    errors: list[float | None] = []
    for row in jacobian:
        used = row != 0.0
        variance = float(row[used] @ covariance[np.ix_(used, used)] @ row[used])
        errors.append(float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0.0 else None)
    return errors
