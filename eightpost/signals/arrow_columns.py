"""Conversion of numeric columns between numpy and Arrow.

The conversions of pyarrow load pandas if it is installed, which takes longer than reading most files.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def to_arrow(values: NDArray[Any]) -> pa.Array:
    """Return numbers as an Arrow array that shares their memory if they are contiguous."""
    values = np.ascontiguousarray(values)
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), values.size, [None, pa.py_buffer(values)])


def to_numpy(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Return a column of numbers as floats, with NaN for missing values."""
    if column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy(), dtype=np.float64)
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks], dtype=np.float64)
