"""Written series read back unchanged in every format, and incomplete files do not replace existing ones."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from arro3.core import DataType, Field, Schema
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from eightpost import __version__
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, sha256_of
from eightpost.signals import (
    TimeSeries,
    parquet_file,
    parquet_header,
    read_series,
    write_mat,
    write_parquet,
    write_series,
)
from eightpost.signals.mat_file import read_mat
from eightpost.signals.parquet_file import Table, read_parquet, read_table, write_table
from eightpost.units import SI_UNITS

SUFFIXES = (".csv", ".txt", ".parquet", ".mat")
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_. ]{0,18}[A-Za-z0-9]", fullmatch=True).filter(
    lambda name: name.lower() not in ("time", "t", "timestamp", "zeit")
)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def any_series(draw) -> TimeSeries:
    steps = draw(st.lists(st.floats(1e-4, 10.0), min_size=2, max_size=8))
    time = draw(st.floats(-100.0, 100.0)) + np.cumsum(steps)
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    row = st.lists(NUMBERS, min_size=time.size, max_size=time.size)
    return TimeSeries.from_channels(time, {name: (draw(st.sampled_from(SI_UNITS)), draw(row)) for name in names})


@pytest.mark.repeated
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=25, deadline=None)
@given(series=any_series())
def test_a_series_is_read_back_bit_for_bit(suffix, series):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"series{suffix}"
        write_series(series, path)
        back = read_series(path)
    assert back.names == series.names
    assert back.units == series.units
    np.testing.assert_array_equal(back.time, series.time)
    np.testing.assert_array_equal(back.values, series.values)


@pytest.mark.parametrize("storage", ["float64", "float32"])
def test_floats_keep_their_bits_in_a_parquet_file_and_in_other_programs(
    tmp_path: Path, storage: Literal["float64", "float32"]
) -> None:
    path, time = tmp_path / "a.parquet", np.arange(6.0)
    values = np.array([0.0, -0.0, 1e-310, 1e-40, 3e38, 0.1]).astype(storage)
    write_parquet(TimeSeries.from_channels(time, {"x": ("m", values.astype(float))}), path, storage=storage)
    (record,) = read_parquet(path)
    assert record.column(1).tobytes() == values.astype(float).tobytes()
    other = pyarrow.parquet.read_table(path)
    assert b"eightpost" in pyarrow.parquet.ParquetFile(path).read().schema.metadata
    assert other["x"].type == pa.from_numpy_dtype(values.dtype) and other["x"].null_count == 0
    assert other["x"].to_numpy().tobytes() == values.tobytes()


def test_integers_become_floats_and_missing_values_nan_in_all_row_groups(tmp_path: Path) -> None:
    table = pa.table({"t [s]": pa.array([1, 2, None, 4], pa.duration("ms")), "F [N]": [1, 2, 3, None],
                      "x [m]": pa.array([1, 2, 2**64 - 1, 4], pa.uint64()), "gear": ["a", None, "b", "c"]})  # fmt: skip
    pa.parquet.write_table(table, tmp_path / "a.parquet", row_group_size=3)
    (record,) = read_parquet(tmp_path / "a.parquet")
    assert record.units == ("s", "N", "m", None)
    for column, expected in zip(record.columns[:3], ([1e-3, 2e-3, np.nan, 4e-3], [1, 2, 3, np.nan], [1, 2, 2.0**64, 4]),
                                strict=True):  # fmt: skip
        assert column.dtype == np.float64
        np.testing.assert_array_equal(column, expected)
    assert record.columns[3].tolist() == ["a", "None", "b", "c"]
    pa.parquet.write_table(table.slice(0, 0), tmp_path / "a.parquet")
    assert [column.size for column in read_parquet(tmp_path / "a.parquet")[0].columns] == [0, 0, 0, 0]


def test_tables_are_read_whoever_wrote_them(tmp_path: Path) -> None:
    fields = [Field("setup", DataType.int64()), Field("a", DataType.float64(), metadata={"unit": "N"}),
              Field("lf", DataType.string()), Field("tie", DataType.bool())]  # fmt: skip
    schema = Schema(fields, metadata={b"eightpost": b"{}"})
    rows = [{"setup": 3, "a": 1.5, "lf": "B", "tie": True}, {"setup": 5, "a": None, "lf": None, "tie": False}]
    write_table(Table.of_rows(rows, schema), tmp_path / "own.parquet")
    other = pyarrow.parquet.read_table(tmp_path / "own.parquet")
    assert other.to_pylist() == [rows[0], rows[1] | {"lf": ""}]
    assert other.schema.metadata == {b"eightpost": b"{}"} and other.schema.field("a").metadata == {b"unit": b"N"}
    other = pa.Table.from_pylist(rows, other.schema)
    pa.parquet.write_table(other, tmp_path / "other.parquet", compression="snappy", row_group_size=1)
    own, back = read_table(tmp_path / "own.parquet"), read_table(tmp_path / "other.parquet")
    assert own.schema == back.schema == schema
    np.testing.assert_equal(own.rows(), [rows[0], rows[1] | {"a": np.nan, "lf": ""}])
    np.testing.assert_equal(back.rows(), own.rows())


def test_a_parquet_file_with_too_many_cells_is_refused_before_it_fills_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parquet_file, "MOST_CELLS", 2**18)
    path = tmp_path / "a.parquet"
    pa.parquet.write_table(pa.table({"t [s]": np.zeros(2**18), "x [m]": np.zeros(2**18)}), path)
    with pytest.raises(FileFormatError, match=r"a\.parquet: it has over 262144 cells in 2 columns; export a shorter"):
        read_series(path)


def test_a_parquet_file_of_which_only_the_end_is_damaged_is_refused_without_further_messages(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.parquet"
    write_parquet(a_series(), path)
    content = bytearray(path.read_bytes())
    end = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    content[end : end + 32] = bytes(32)
    path.write_bytes(content)
    with pytest.raises(FileFormatError) as caught:
        read_series(path)
    what = "not a readable Parquet file: the description of its columns is damaged; copy or write it again"
    assert str(caught.value) == f"{path}: {what}"
    os.write(2, b"still open")
    assert capfd.readouterr().err == "still open"


@pytest.mark.parametrize("first", range(4))
def test_no_changed_byte_of_the_end_of_a_parquet_file_ends_the_process(tmp_path, first):
    """Every fourth byte turns a place or a size in the file negative, which arro3 does not survive."""
    path = tmp_path / "a.parquet"
    write_parquet(a_series(), path)
    content = path.read_bytes()
    end = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    refused = 0
    for place in range(end + first, len(content) - 8, 4):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            read_series(path)
        except InputError:
            refused += 1
    assert refused > 50


def test_a_column_outside_its_parquet_file_is_refused(tmp_path):
    path = tmp_path / "a.parquet"
    values = np.random.default_rng(1).standard_normal((1, 2000))
    write_parquet(TimeSeries(np.arange(2000.0), values, ("x",), ("m",)), path)
    content = path.read_bytes()
    end = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    path.write_bytes(content[:4] + content[end:])
    with pytest.raises(FileFormatError, match="the description of its columns is damaged") as caught:
        read_series(path)
    assert str(caught.value.__cause__.__cause__) == "a column is outside the file"


def test_a_name_with_a_nul_in_a_parquet_file_is_refused(tmp_path: Path) -> None:
    """The library that reads it ends the process."""
    pa.parquet.write_table(pa.table({"time": [0.0, 1.0], "a\0b": [1.0, 2.0]}), tmp_path / "a.parquet")
    with pytest.raises(FileFormatError, match=r"a\.parquet: not a readable Parquet file: the description"):
        read_parquet(tmp_path / "a.parquet")


def test_a_name_that_the_system_refuses_is_an_error_that_names_the_file() -> None:
    with pytest.raises(FileFormatError, match=r"xxx\.csv: cannot be read: File name too long"):
        read_series(f"{'x' * 300}.csv")


def test_a_series_is_written_and_read_without_pandas(tmp_path):
    program = (
        "import sys, numpy as np; from eightpost.signals import TimeSeries, read_series, write_series; "
        "series = TimeSeries(np.arange(5.0), np.ones((1, 5)), ('x',), ('m',)); "
        "[write_series(series, p) or read_series(p) for p in sys.argv[1:]]; assert 'pandas' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "a.parquet"), str(tmp_path / "a.csv")], check=True)


def a_series() -> TimeSeries:
    return TimeSeries.from_channels([0.0, 0.1, 0.2], {"lf.road": ("m", [0.0, 1.0, 2.0])})


def test_incomplete_output_never_replaces_an_existing_file(tmp_path):
    path = tmp_path / "good.csv"
    path.write_text("good")

    def fail() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        fail()
    assert path.read_text() == "good"
    assert list(tmp_path.iterdir()) == [path]


def test_the_digest_is_the_sha256_of_the_files_bytes(tmp_path):
    path = tmp_path / "abc"
    path.write_bytes(b"abc")
    # FIPS 180-2, appendix B.1.
    assert sha256_of(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_parquet_contains_schema_tool_units_and_sources(tmp_path):
    path = tmp_path / "a.parquet"
    write_parquet(a_series(), path, sources={"run.csv": "ba78"}, note="synthetic")
    assert parquet_header(path) == {
        "schema": "eightpost.time_series",
        "schema_version": 1,
        "tool_version": __version__,
        "units": {"time": "s", "lf.road": "m"},
        "sources": {"run.csv": "ba78"},
        "note": "synthetic",
    }


def test_a_newer_schema_is_refused(tmp_path):
    newer = json.dumps({"schema_version": 2, "tool_version": "9.9"})
    table = pa.table({"time": [0.0, 1.0]}).replace_schema_metadata({"eightpost": newer})
    pa.parquet.write_table(table, tmp_path / "a.parquet")
    savemat(tmp_path / "a.mat", {"time": [0.0, 1.0], "eightpost": newer})
    for name in ("a.parquet", "a.mat"):
        with pytest.raises(FileFormatError, match=rf"{name}: .*version 2 \(written by eightpost 9\.9\).*update"):
            read_series(tmp_path / name)


def test_parquet_of_another_tool_has_units_in_its_column_names(tmp_path):
    path = tmp_path / "a.parquet"
    pa.parquet.write_table(pa.table({"t_s": [0.0, 1.0], "Force (kN)": [1, 2]}), path)
    np.testing.assert_array_equal(read_series(path)["Force"], [1000.0, 2000.0])


def test_mat_of_another_tool_is_read_from_vectors_or_a_struct(tmp_path):
    content = {"t": np.array([[0.0], [1.0]]), "F": np.array([[1.0, 2.0]]), "rate": 1.0, "note": "x"}
    savemat(tmp_path / "flat.mat", content)
    savemat(tmp_path / "struct.mat", {"run": content})
    for name in ("flat.mat", "struct.mat"):
        series = read_series(tmp_path / name, units={"time": "s", "F": "kN"})
        assert series.names == ("F",)
        np.testing.assert_array_equal(series["F"], [1000.0, 2000.0])


def test_mat_vectors_of_another_length_than_the_time_are_not_read(tmp_path):
    content = {"t": [0.0, 1.0, 2.0], "F": [1.0, 2.0], "v": [1.0, 2.0, 3.0], "w": [1.0, 2.0, 3.0, 4.0]}
    content["units"] = {"t": "s", "v": "m/s", "w": "m"}
    savemat(tmp_path / "a.mat", content)
    assert read_series(tmp_path / "a.mat").names == ("v",)


def test_without_a_time_the_vectors_of_the_usual_length_are_read_and_an_empty_one_is_no_vector(tmp_path):
    content = {"x": [1.0, 2.0], "F": [1.0, 2.0, 3.0], "v": [4.0, 5.0, 6.0], "none": [], "rate": 2.0}
    savemat(tmp_path / "a.mat", content)
    assert read_mat(tmp_path / "a.mat")[0].names == ("F", "v")
    savemat(tmp_path / "b.mat", {"none": [], "rate": 2.0})
    with pytest.raises(FileFormatError, match=r"b\.mat: it contains no numeric vector"):
        read_mat(tmp_path / "b.mat")


@pytest.mark.parametrize(
    ("units", "message"),
    [(3.0, r"must be a struct with one text per variable, not 3\.0"),
     ({"v": 2.5}, r"units\.v.*must be a text such as 'mm/s', not 2\.5")],
)  # fmt: skip
def test_units_of_a_mat_file_that_are_no_texts_are_refused(tmp_path, units, message):
    savemat(tmp_path / "a.mat", {"t": [0.0, 1.0], "v": [1.0, 2.0], "units": units})
    with pytest.raises(FileFormatError, match=message):
        read_mat(tmp_path / "a.mat")


def test_empty_units_of_a_mat_file_are_not_stated(tmp_path):
    savemat(tmp_path / "a.mat", {"t": [0.0, 1.0], "v": [1.0, 2.0], "units": {"t": "ms", "v": []}})
    assert read_mat(tmp_path / "a.mat")[0].units == ("ms", None)
    savemat(tmp_path / "b.mat", {"t": [0.0, 1.0], "v": [1.0, 2.0], "units": []})
    assert read_mat(tmp_path / "b.mat")[0].units == (None, None)


def test_a_mat_file_keeps_the_original_channel_names(tmp_path):
    both = a_series().with_channel("lf_road", "m", [5.0, 6.0, 7.0])
    write_mat(both, tmp_path / "a.mat")
    assert read_series(tmp_path / "a.mat").names == ("lf.road", "lf_road")


def test_damaged_mat_7_3_and_files_of_another_format_are_refused(tmp_path):
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400)
    (tmp_path / "a.mat").write_bytes(header)
    with pytest.raises(FileFormatError, match=r"a\.mat: not a MATLAB file"):
        read_series(tmp_path / "a.mat")
    for name in ("b.mat", "b.parquet"):
        (tmp_path / name).write_bytes(b"hello world " * 50)
        with pytest.raises(FileFormatError, match=rf"{name}: not a"):
            read_series(tmp_path / name)
