"""Of a large file only the channels that are used are in memory, one after the other if they are not to be kept."""

import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eightpost.array_types import Stored
from eightpost.errors import FileFormatError, MissingChannelError, NotANumberError
from eightpost.signals import (
    ChannelMap,
    MappedChannel,
    TimeSeries,
    csv_file,
    formats,
    parquet_file,
    raw_record,
    read_record,
    read_series,
)
from eightpost.signals.csv_file import read_delimited, write_csv
from eightpost.signals.logger_files import write_rpc
from eightpost.signals.parquet_file import write_parquet
from eightpost.signals.raw_record import identity_map, mapped_series

COUNT, CHANNELS = 10_000, 24
TIME = np.arange(COUNT) / 1000.0
ROWS = {f"x{k}": ("m", np.round(np.sin((k + 1.0) * TIME), 6)) for k in range(CHANNELS)}
SERIES = TimeSeries.from_channels(TIME, ROWS)


def write_ld(series: TimeSeries, path: Path) -> None:
    """Write a log of MoTeC with floating point numbers."""
    start = 2000 + 124 * len(series.names)
    head = bytearray(start)
    struct.pack_into("<I4xI", head, 0, 0x40, 2000)
    for k, name in enumerate(series.names):
        place, following = 2000 + 124 * k, 2000 + 124 * (k + 1) if k + 1 < len(series.names) else 0
        struct.pack_into("<4xIII2xHHHhhhh32s8x12s", head, place, following, start + 4 * COUNT * k, COUNT, 7, 4, 1000,
                         0, 1, 1, 0, name.encode(), b"m")  # fmt: skip
    path.write_bytes(bytes(head) + series.values.astype("<f4").tobytes())


def write_mf4(series: TimeSeries, path: Path) -> None:
    """Write an MDF file."""
    asammdf = pytest.importorskip("asammdf", reason="asammdf is an extra: pip install 'eightpost[mdf]'")
    with asammdf.MDF(version="4.10") as mdf:
        rows = zip(series.names, series.values, strict=True)
        mdf.append([asammdf.Signal(row.astype(np.float32), series.time, name=name, unit="m") for name, row in rows])
        mdf.save(path, overwrite=True)


WRITERS: dict[str, Callable[[TimeSeries, Path], None]] = {
    ".rsp": write_rpc, ".ld": write_ld, ".parquet": write_parquet, ".mf4": write_mf4, ".csv": write_csv,
}  # fmt: skip


@pytest.fixture(params=WRITERS)
def path(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a file that counts as large."""
    for module in (formats, csv_file, parquet_file, raw_record):
        monkeypatch.setattr(module, "IN_MEMORY", 1)
    for module in (csv_file, parquet_file):
        monkeypatch.setattr(module, "_ROWS", COUNT // 10)
    monkeypatch.setattr(csv_file, "_HEAD", 2**16)  # with 290 lines
    monkeypatch.setattr(raw_record, "IN_MEMORY", 0)
    path = tmp_path / f"run{request.param}"
    WRITERS[request.param](SERIES, path)
    return path


def peak(work: Callable[[], object]) -> int:
    """Return the largest memory that a function takes at a time [bytes]."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_one_channel_takes_the_memory_of_a_few(path: Path) -> None:
    one = ChannelMap({"travel": MappedChannel("x5", gain=2.0)})
    other = path.with_stem("other")
    WRITERS[path.suffix](SERIES, other)
    read_series(other, channel_map=one)  # what is imported counts once
    found: list[TimeSeries] = []
    assert peak(lambda: found.append(read_series(path, channel_map=one))) < 8 * COUNT * CHANNELS / 2
    np.testing.assert_allclose(found[0]["travel"], 2.0 * SERIES["x5"], atol=1e-6)
    np.testing.assert_allclose(found[0].time, TIME, atol=1e-9)


def test_channels_that_are_not_kept_are_those_that_are(path: Path) -> None:
    record = read_record(path)
    assert all(isinstance(column, Stored) for column in record.columns[1:])
    whole = read_series(path)
    series = mapped_series(record, identity_map(record, MappedChannel("time")), keep=False)
    assert peak(lambda: [series[name].sum() for name in series.names]) < 8 * COUNT * CHANNELS / 2
    assert (series.names, series.units, len(series)) == (whole.names, whole.units, COUNT)
    assert all(np.array_equal(series[name], whole[name]) for name in whole.names)
    part = series.select(["x2", "x1"]).with_channel("y", "N", TIME).window(3.0, 5.0)
    np.testing.assert_array_equal(
        part.values, whole.select(["x2", "x1"]).with_channel("y", "N", TIME).window(3.0, 5.0).values
    )
    with pytest.raises(MissingChannelError, match="no such channel"):
        series["x99"]
    np.testing.assert_array_equal(series.values, whole.values)


def test_a_fault_is_found_before_a_channel_is_used(path: Path) -> None:
    values = SERIES.values.copy()
    values[3, 7] = np.nan
    if path.suffix == ".csv":
        text = path.read_text(encoding="utf-8").splitlines()
        text[8] = ",".join("" if k == 4 else cell for k, cell in enumerate(text[8].split(",")))
        path.write_text("\n".join([*text, ""]), encoding="utf-8")
    else:
        faulty = object.__new__(TimeSeries)
        for name, value in (("time", TIME), ("values", values), ("names", SERIES.names), ("units", SERIES.units)):
            object.__setattr__(faulty, name, value)
        WRITERS[path.suffix](faulty, path)
    record = read_record(path)
    with pytest.raises(NotANumberError, match="x3"):
        mapped_series(record, identity_map(record, MappedChannel("time")), keep=False)


# ---- Text files of numbers only are read block by block, all others as a whole, with the same result ----------------

LINES = [f"{k / 1000.0:.3f},{np.sin(0.1 * k):.4f},{k % 7}.{k % 10}" for k in range(400)]
HEADER = "Bench 3\ntime [s],x [mm],F [N]\n"
TABLE = HEADER + "\n".join(LINES) + "\n"
COMMAS = TABLE.replace(",", ";").replace(".", ",")
PLAIN = {
    "plain": TABLE, "without an end": TABLE[:-1], "line ends of Windows": TABLE.replace("\n", "\r\n"),
    "decimal commas": COMMAS, "tabs": TABLE.replace(",", "\t"), "an empty cell": TABLE.replace(",0.8415,", ",,"),
    "no number": TABLE.replace(",0.8415,", ",nan,"), "empty lines at the end": TABLE + "\n\n",
    "units in a row": TABLE.replace("time [s],x [mm],F [N]", "time,x,F\ns,mm,N"), "no header": "\n".join(LINES),
    "quotes": TABLE.replace(",0.8415,", ',"0.8415",'), "a byte order mark": "\ufeff" + TABLE,
}  # fmt: skip
OTHER = {
    "an empty line": TABLE.replace("0.300,", "\n0.300,"), "a comment": TABLE.replace("0.300,", "# pause\n0.300,"),
    "a footer": TABLE + "Max,1,6.9\n", "a second table": TABLE + TABLE, "a cut number": TABLE[:-4],
    "a cut line": TABLE[:-7] + "\n", "a time of day": TABLE.replace("\n0.", "\n10:00:0."),
    "a word": TABLE.replace("0.8415", "bad"),
    "a negative in parentheses": TABLE.replace("-0.9589", "(0.9589)"), "a blank": TABLE.replace(",0.8415", ", 0.8415"),
    "thousands": COMMAS.replace(";6,9", ";1.006,9"), "a missing cell": TABLE.replace(",0.8415,", ",N/A,"),
    "a last delimiter": TABLE.replace("\n", ",\n"), "remarks": TABLE.replace("0.8415,", "0.8415,,"),
    "few lines": HEADER + "\n".join(LINES[:20]),
    "an empty last line of cells": TABLE + ",,\n", "a zero byte": TABLE.replace("0.8415", "0.8\x0015"),
}  # fmt: skip


def outcome(path: Path) -> tuple[object, ...]:
    """Return what is read from a text file, or why not."""
    try:
        records = read_delimited(path)
    except FileFormatError as error:
        return (str(error),)
    return tuple((r.names, r.units, r.preamble, r.notes, r.steps, r.origin.header_line, r.origin.lines.tolist(),
                  [list(map(repr, column.tolist())) for column in r.loaded().columns]) for r in records)  # fmt: skip


@pytest.mark.parametrize("kind", [*PLAIN, *OTHER])
def test_a_large_text_file_is_read_as_a_small_one(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes((PLAIN | OTHER)[kind].encode())
    expected = outcome(path)
    monkeypatch.setattr(csv_file, "IN_MEMORY", 1)
    monkeypatch.setattr(csv_file, "_ROWS", 50)
    assert outcome(path) == expected
    if kind in PLAIN:
        assert isinstance(read_delimited(path)[0].columns[0], Stored)
