"""Of a large file only the channels that are used are in memory, one after the other if they are not to be kept."""

import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eightpost.array_types import Stored
from eightpost.errors import MissingChannelError, NotANumberError
from eightpost.signals import ChannelMap, MappedChannel, TimeSeries, formats, raw_record, read_record, read_series
from eightpost.signals.csv_file import write_csv
from eightpost.signals.logger_files import write_rpc
from eightpost.signals.parquet_file import write_parquet
from eightpost.signals.raw_record import identity_map, mapped_series

COUNT, CHANNELS = 20_000, 24
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
    monkeypatch.setattr(formats, "_KEPT", 0)
    monkeypatch.setattr(raw_record, "IN_MEMORY", 0)
    path = tmp_path / f"run{request.param}"
    WRITERS[request.param](SERIES, path)
    formats._read_once.cache_clear()
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
    read_series(path, channel_map=ChannelMap({"travel": MappedChannel("x5")}))  # what is imported counts once
    formats._read_once.cache_clear()
    found: list[TimeSeries] = []
    one = ChannelMap({"travel": MappedChannel("x5", gain=2.0)})
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
