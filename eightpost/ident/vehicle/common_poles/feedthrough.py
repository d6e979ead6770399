"""What an input does to an output beside the common poles: at once, or through a fast lag."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Feedthrough:
    """The terms `D_ij + E_ij / (1 + s / rate)`.

    A damped tire answers the speed of the road, which no proper model has: its tire force grows with frequency, its
    wheel's velocity has a part that follows the road at once. A lag far above the band stands for that speed, and
    leaves shock velocities without a direct term.

    Attributes:
        direct: Which D_ij there are (p, m).
        lagged: Which inputs have a lag (m,); all outputs may answer it.
        rate: Of the lag [1/s].
    """

    direct: NDArray[np.bool_]
    lagged: NDArray[np.bool_]
    rate: float

    @classmethod
    def of(cls, direct: NDArray[np.bool_], rate: float) -> Feedthrough:
        """Return direct terms without any lag."""
        return cls(direct, np.zeros(direct.shape[1], dtype=np.bool_), rate)

    def with_lags(self, inputs: NDArray[np.bool_]) -> Feedthrough:
        """Return the same with a lag on the `inputs` (m,)."""
        return replace(self, lagged=inputs)

    @property
    def states(self) -> int:
        """How many states the lags have."""
        return int(self.lagged.sum())

    @property
    def count(self) -> int:
        """How many numbers there are to find."""
        return int(self.direct.sum()) + len(self.direct) * self.states

    def lag(self, s: Complex) -> Complex:
        """Return 1 / (1 + s / rate) (K,)."""
        return np.asarray(1.0 / (1.0 + s / self.rate))

    def of_output(self, i: int, weight: Array, s: Complex) -> Complex:
        """Return the weighted terms of output `i` as columns (m, K, r): direct ones, then lags."""
        return _columns(weight, np.flatnonzero(self.direct[i]), np.flatnonzero(self.lagged), self.lag(s))

    def of_input(self, j: int, weight: Array, s: Complex) -> Complex:
        """Return the weighted terms of input `j` as columns (p, K, r): direct ones, then lags."""
        lagged = np.arange(len(weight)) if self.lagged[j] else np.empty(0, dtype=np.intp)
        return _columns(weight, np.flatnonzero(self.direct[:, j]), lagged, self.lag(s))


def _columns(weight: Array, direct: NDArray[np.intp], lagged: NDArray[np.intp], lag: Complex) -> Complex:
    columns = np.zeros((*weight.shape, direct.size + lagged.size), dtype=np.complex128)
    for k, place in enumerate(direct):
        columns[place, :, k] = weight[place]
    for k, place in enumerate(lagged, start=direct.size):
        columns[place, :, k] = weight[place] * lag
    return columns
