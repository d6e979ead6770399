"""Types of arrays in annotations, and vectors that are read when they are used."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """Numbers of a column in a large file: they are read each time they are used, and not kept."""

    size: int  #: Number of samples.
    read: Callable[[], Array]  #: Function that returns the samples (N,).
    dtype: ClassVar[np.dtype[np.float64]] = np.dtype(np.float64)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Return the samples (N,)."""
        return np.asarray(self.read(), dtype, copy=copy)
