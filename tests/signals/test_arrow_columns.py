"""Numbers are converted between numpy and Arrow without change and without loading pandas."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest

from eightpost.signals.parquet_file import to_arrow, to_numpy


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_floats_keep_their_bits(dtype):
    values = np.array([0.0, -0.0, 1e-310, np.nan, np.inf, 0.1], dtype=dtype)[::-1]
    array = to_arrow(values)
    assert array.type == pa.from_numpy_dtype(values.dtype)
    assert array.null_count == 0
    assert to_numpy(pa.chunked_array([array])).tobytes() == values.astype(float).tobytes()


def test_chunks_are_joined_and_integers_become_floats():
    column = pa.chunked_array([[1, 2], [3]])
    assert to_numpy(column).tolist() == [1.0, 2.0, 3.0]
    assert to_numpy(column).dtype == np.float64


def test_missing_values_become_nan():
    assert np.isnan(to_numpy(pa.chunked_array([[1.0, None]]))[1])
    assert to_numpy(pa.chunked_array([], type=pa.float64())).size == 0


def test_a_series_is_written_and_read_without_pandas(tmp_path):
    program = (
        "import sys, numpy as np; from eightpost.signals import TimeSeries, read_series, write_series; "
        "series = TimeSeries(np.arange(5.0), np.ones((1, 5)), ('x',), ('m',)); "
        "[write_series(series, p) or read_series(p) for p in sys.argv[1:]]; assert 'pandas' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "a.parquet"), str(tmp_path / "a.csv")], check=True)
