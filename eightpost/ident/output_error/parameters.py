"""Declared parameters of an output-error model: units, bounds, scales and priors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError

#: Smallest relative distance of a start value from its bounds, in the optimiser's coordinates.
_INSIDE = 1e-6


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a model.

    Attributes:
        name: Name of the parameter.
        unit: Unit of the parameter, SI.
        start: Start value; with a prior, also its mean (median if the scale is logarithmic).
        low: Lower bound.
        high: Upper bound.
        scale: Scale of the optimiser's coordinate: the value over `size`, or the logarithm of the value.
        size: Typical size of a linear parameter; 0 uses |start|, or the width of the bounds if start is 0.
        prior: Standard deviation of what is known before the test, in the unit of the parameter, or relative (of the
            logarithm) if the scale is logarithmic; None if nothing is known.
    """

    name: str
    unit: str
    start: float
    low: float = -np.inf
    high: float = np.inf
    scale: Literal["linear", "logarithmic"] = "linear"
    size: float = 0.0
    prior: float | None = None

    def __post_init__(self) -> None:
        """Check that bounds, start and prior agree."""
        if not self.low < self.high or not self.low <= self.start <= self.high:
            raise ParameterError(
                f"{self.name}: the start {self.start:g} {self.unit} must be within the bounds {self.low:g} to "
                f"{self.high:g} {self.unit}"
            )
        if self.is_logarithmic and not (self.start > 0.0 and self.low >= 0.0):
            raise ParameterError(
                f"{self.name}: the start {self.start:g} {self.unit} and the lower bound {self.low:g} {self.unit} of a "
                "logarithmic parameter must not be negative, and the start must be above zero; use a linear scale"
            )
        if self.prior is not None and not self.prior > 0.0:
            raise ParameterError(f"{self.name}: the standard deviation of the prior is {self.prior!r}; it must be > 0")

    @property
    def is_logarithmic(self) -> bool:
        """Whether the optimiser's coordinate is the logarithm of the value."""
        return self.scale == "logarithmic"

    @property
    def typical(self) -> float:
        """Typical size of a linear parameter, in its unit."""
        width = self.high - self.low
        return self.size or abs(self.start) or (width if np.isfinite(width) else 1.0)


@dataclass(frozen=True, slots=True)
class ParameterTable:
    """P parameters in the order of a model's values.

    Attributes:
        parameters: Parameters with unique names.
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Check that the names are unique."""
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ParameterError(f"the parameter {', '.join(twice)} is declared more than once; use unique names")

    def __iter__(self) -> Iterator[Parameter]:
        """Iterate over the parameters."""
        return iter(self.parameters)

    def __len__(self) -> int:
        """Return the number of parameters."""
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    def starting_from(self, values: Mapping[str, float]) -> ParameterTable:
        """Return the table with other start values, moved inside the bounds; priors must not be present.

        Raises:
            ParameterError: A changed parameter has a prior, whose mean is the start.
        """
        for parameter in self:
            if parameter.prior is not None and parameter.name in values:
                raise ParameterError(f"{parameter.name}: the start is the mean of the prior; pass `start` to the fit")
        return ParameterTable(
            tuple(replace(p, start=float(np.clip(values.get(p.name, p.start), p.low, p.high))) for p in self)
        )

    # ---- Coordinates of the optimiser -------------------------------------------------------------------------------

    @property
    def _logarithmic(self) -> Array:
        return np.array([p.is_logarithmic for p in self], dtype=bool)

    @property
    def _sizes(self) -> Array:
        return np.array([p.typical for p in self], dtype=np.float64)

    def theta(self, values: Sequence[float] | Array) -> Array:
        """Return the optimiser's coordinates (P,) of values (P,)."""
        given = np.asarray(values, dtype=np.float64)
        safe = np.where(self._logarithmic, np.maximum(given, 1e-300), 1.0)
        return np.asarray(np.where(self._logarithmic, np.log(safe), given / self._sizes))

    def values(self, theta: Array) -> Array:
        """Return the values (..., P) of the optimiser's coordinates (..., P)."""
        logarithms = np.where(self._logarithmic, theta, 0.0)
        return np.asarray(np.where(self._logarithmic, np.exp(logarithms), theta * self._sizes))

    def start(self) -> Array:
        """Return the coordinates (P,) of the start values, slightly inside the bounds."""
        return self.inside(self.theta([p.start for p in self]))

    def inside(self, theta: Array) -> Array:
        """Return coordinates (P,) moved slightly inside the bounds."""
        low, high = self.bounds()
        gap = _INSIDE * np.where(np.isfinite(high - low), high - low, 1.0)
        return np.asarray(np.clip(theta, low + gap, high - gap))

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest coordinates (P,)."""
        low = [np.log(p.low) if p.is_logarithmic and p.low > 0.0 else -np.inf if p.is_logarithmic else p.low / p.typical
               for p in self]  # fmt: skip
        high = [np.log(p.high) if p.is_logarithmic else p.high / p.typical for p in self]
        return np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)

    def prior_weights(self) -> Array:
        """Return one over the prior's standard deviation in coordinates (P,); 0 without a prior."""
        weights = [0.0 if p.prior is None else (1.0 if p.is_logarithmic else p.typical) / p.prior for p in self]
        return np.array(weights, dtype=np.float64)

    def prior_means(self) -> Array:
        """Return the coordinates (P,) of the prior means."""
        return self.theta([p.start for p in self])
