"""The scalar parameters of a fit: value, uncertainty, bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.solvers.uncertainty import quantile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.solvers.solution import Solution

    Array = NDArray[np.float64]

_GAS_UNITS = {"gas_preload": "N", "gas_stiffness": "N/m"}

#: A parameter within this share of a bound counts as at the bound.
_AT_BOUND = 0.01


@dataclass(frozen=True, slots=True)
class Parameter:
    """A fitted parameter.

    Attributes:
        name: Name in the shock file.
        value: Value in `unit`.
        unit: SI unit.
        error: Standard error from leaving out blocks of the record; None if the record does not determine it.
        bounds: Lower and upper bound of the fit; None if unbounded.
        reach: Half-width of the 95 % interval in standard errors.
    """

    name: str
    value: float
    unit: str
    error: float | None
    bounds: tuple[float, float] | None = None
    reach: float = 1.96

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % confidence interval; None if the record does not determine the parameter."""
        if self.error is None:
            return None
        return self.value - self.reach * self.error, self.value + self.reach * self.error

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
    model, reach = solution.model, quantile(solution.model.runs)
    dynamics, (_, g, theta) = model.dynamics, model.split(solution.parameters)
    n, m = model.curve_count, model.linear_count
    own = zip(
        dynamics.names,
        dynamics.values(theta).tolist(),
        dynamics.units,
        _errors(dynamics.values_jacobian(theta), solution.covariance[m:, m:]),
        dynamics.value_bounds(),
        strict=True,
    )
    found = [Parameter(*entry, reach) for entry in own]
    gas = zip(model.gas.names, model.gas.to_values @ g, strict=True)
    errors = _errors(model.gas.to_values, solution.covariance[n:m, n:m])
    bounds = {"gas_stiffness": (0.0, float("inf"))}
    found += [
        Parameter(name, float(value), _GAS_UNITS[name], error, bounds.get(name), reach)
        for (name, value), error in zip(gas, errors, strict=True)
    ]
    return tuple(found)


def _errors(jacobian: Array, covariance: Array) -> list[float | None]:
    """Return the standard errors of values, given their Jacobian with respect to the covariance's parameters.

    A value that depends on an undetermined parameter (NaN) is undetermined too.
    """
    errors: list[float | None] = []
    for row in jacobian:
        used = row != 0.0
        variance = float(row[used] @ covariance[np.ix_(used, used)] @ row[used])
        errors.append(float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0.0 else None)
    return errors
