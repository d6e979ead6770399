"""Effects of inputs on outputs besides the common poles: direct terms and fast lags."""

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

    A damped tire responds to the velocity of the road, which a proper model cannot represent: the tire force grows with
    frequency, and a part of the wheel velocity follows the road directly. A lag far above the band approximates this
    velocity and leaves shock velocities without a direct term.

    Attributes:
        direct: Mask of the direct terms D_ij that exist (p, m).
        lagged: Mask of the inputs that have a lag (m,); it may act on all outputs.
        rate: Rate of the lag [1/s].
    """

    direct: NDArray[np.bool_]
    lagged: NDArray[np.bool_]
    rate: float

    @classmethod
    def of(cls, direct: NDArray[np.bool_], rate: float) -> Feedthrough:
        """Return direct terms without any lag."""
        return cls(direct, np.zeros(direct.shape[1], dtype=np.bool_), rate)

    def with_lags(self, inputs: NDArray[np.bool_]) -> Feedthrough:
        """Return the same terms with a lag on the `inputs`, a mask (m,)."""
        return replace(self, lagged=inputs)

    @property
    def states(self) -> int:
        """Number of states of the lags."""
        return int(self.lagged.sum())

    @property
    def count(self) -> int:
        """Number of unknown coefficients."""
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
