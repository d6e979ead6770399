"""A law's own parameters as declared in its file, and their coordinates in the optimiser's box."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.shock import FitParameter

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OwnParameters:
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
