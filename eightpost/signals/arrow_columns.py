"""Columns of numbers between numpy and Arrow.

pyarrow's own conversions load pandas where that is installed, which takes longer than most files take to read.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def to_arrow(values: NDArray[Any]) -> pa.Array:
    """Return an Arrow array of floats, on the same memory where they are contiguous."""
    values = np.ascontiguousarray(values)
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), values.size, [None, pa.py_buffer(values)])


def to_numpy(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Return a column of numbers as floats; what is missing is NaN."""
    if column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy(), dtype=np.float64)
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks], dtype=np.float64)
