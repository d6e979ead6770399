"""Declared parameters of an output-error model: units, bounds, scales and priors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import ParameterError

#: Smallest relative distance of a start value from its bounds, in the optimiser's coordinates.
_INSIDE = 1e-6


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a model.

    Raises:
        ParameterError: The start is outside the bounds, or a bound, the start or the prior does not suit the scale.
    """

    name: str  #: Name of the parameter.
    unit: str  #: Unit of the parameter, SI.
    start: float  #: Start value; with a prior, also its mean (median if the scale is logarithmic).
    low: float = -np.inf  #: Lower bound.
    high: float = np.inf  #: Upper bound.
    #: Scale of the optimiser's coordinate: the value over `size`, or the logarithm of the value.
    scale: Literal["linear", "logarithmic"] = "linear"
    size: float = 0.0  #: Typical size of a linear parameter; 0 uses |start|, or the width of the bounds if start is 0.
    #: Standard deviation of what is known before the test, in the unit of the parameter, or relative (of the logarithm)
    #: if the scale is logarithmic; None if nothing is known.
    prior: float | None = None
    fixed: bool = False  #: Whether the parameter keeps its start value.

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


@dataclass(frozen=True)
class ParameterTable:
    """P parameters in the order of a model's values, of which F are not fixed.

    Raises:
        ParameterError: Two parameters have the same name.
    """

    parameters: tuple[Parameter, ...]  #: Parameters with unique names.

    def __post_init__(self) -> None:
        """Check that the names are unique."""
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ParameterError(f"the parameter {', '.join(twice)} is declared more than once; use unique names")

    def __iter__(self) -> Iterator[Parameter]:
        """Iterate over all parameters."""
        return iter(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """The F parameters that are not fixed, in the order of the optimiser's coordinates."""
        return tuple(parameter for parameter in self if not parameter.fixed)

    def fixed(self, *names: str) -> ParameterTable:
        """Return the table in which exactly the given parameters are fixed."""
        self._check(names)
        return ParameterTable(tuple(replace(p, fixed=p.name in names) for p in self))

    def _check(self, names: Iterable[str]) -> None:
        unknown = sorted(set(names) - set(self.names))
        if unknown:
            raise ParameterError(
                f"there is no parameter {', '.join(unknown)}; the parameters are {', '.join(self.names)}"
            )

    # ---- Coordinates of the optimiser -------------------------------------------------------------------------------

    @cached_property
    def _is_free(self) -> NDArray[np.bool_]:
        return np.array([not p.fixed for p in self], dtype=bool)

    @cached_property
    def _logarithmic(self) -> NDArray[np.bool_]:
        return np.array([p.is_logarithmic for p in self.free], dtype=bool)

    @cached_property
    def _sizes(self) -> Array:
        return np.array([p.typical for p in self.free], dtype=np.float64)

    def theta(self, values: Mapping[str, float]) -> Array:
        """Return the optimiser's coordinates (F,) of values by name; missing ones have their start values.

        Raises:
            ParameterError: There is no parameter with one of the names.
        """
        self._check(values)
        given = np.array([values.get(p.name, p.start) for p in self.free], dtype=np.float64)
        safe = np.where(self._logarithmic, np.maximum(given, 1e-300), 1.0)
        return np.asarray(np.where(self._logarithmic, np.log(safe), given / self._sizes))

    def values(self, theta: Array) -> Array:
        """Return the values (..., P) of coordinates (..., F), with the start values of fixed parameters."""
        found = np.empty((*theta.shape[:-1], len(self.parameters)))
        found[...] = [p.start for p in self]
        logarithms = np.where(self._logarithmic, theta, 0.0)
        found[..., self._is_free] = np.where(self._logarithmic, np.exp(logarithms), theta * self._sizes)
        return found

    def named(self, theta: Array) -> dict[str, float]:
        """Return the values of coordinates (F,) by name."""
        return dict(zip(self.names, self.values(theta).tolist(), strict=True))

    def start(self) -> Array:
        """Return the coordinates (F,) of the start values, slightly inside the bounds."""
        return self.inside(self.theta({}))

    def inside(self, theta: Array) -> Array:
        """Return coordinates (F,) moved slightly inside the bounds."""
        low, high = self.bounds()
        gap = _INSIDE * np.where(np.isfinite(high - low), high - low, 1.0)
        return np.asarray(np.clip(theta, low + gap, high - gap))

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest coordinates (F,)."""
        low = [np.log(p.low) if p.is_logarithmic and p.low > 0.0 else -np.inf if p.is_logarithmic else p.low / p.typical
               for p in self.free]  # fmt: skip
        high = [np.log(p.high) if p.is_logarithmic else p.high / p.typical for p in self.free]
        return np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)

    def prior_weights(self) -> Array:
        """Return one over the prior's standard deviation in coordinates (F,); 0 without a prior."""
        weights = [0.0 if p.prior is None else (1.0 if p.is_logarithmic else p.typical) / p.prior for p in self.free]
        return np.array(weights, dtype=np.float64)

    def prior_means(self) -> Array:
        """Return the coordinates (F,) of the prior means."""
        return self.theta({})
