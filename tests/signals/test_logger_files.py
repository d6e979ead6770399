"""Files of rigs and loggers are read to the values written, with names, units and rates as written, or refused."""

import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from eightpost.confined.readers import load_xrk
from eightpost.errors import FileFormatError
from eightpost.signals import TimeSeries, logger_files, read_record, read_records, read_series, write_series
from eightpost.signals.logger_files import write_rpc

COUNT, RATE = 1000, 200.0
TIME = np.arange(COUNT) / RATE
TRAVEL = 0.05 * np.sin(9.0 * TIME)
LOAD = 4000.0 + 900.0 * np.cos(9.0 * TIME)


# ---- RPC III, written here by hand ----------------------------------------------------------------------------------


def rpc(path: Path, *, frame=256, per_group=2, kind="SHORT_INTEGER", order="<", cut=0, short=False, **changes) -> Path:
    """Write travel [mm] and load [kN] in frames; the last group is filled, or ends with the last frame if `short`."""
    frames = -(-COUNT // frame)
    group = frame * per_group
    entries = {
        "FORMAT": "BINARY" if order == "<" else "BINARY_IEEE_BIG_END", "NUM_HEADER_BLOCKS": 8, "NUM_PARAMS": 16,
        "FILE_TYPE": "TIME_HISTORY", "DELTA_T": 1.0 / RATE, "CHANNELS": 2, "DATA_TYPE": kind, "PTS_PER_FRAME": frame,
        "PTS_PER_GROUP": group, "FRAMES": frames, "DESC.CHAN_1": "LF WPL Disp", "UNITS.CHAN_1": "mm",
        "SCALE.CHAN_1": 0.004, "DESC.CHAN_2": "LF Wheel Load", "UNITS.CHAN_2": "kN", "SCALE.CHAN_2": 0.0002, **changes,
    }  # fmt: skip
    header = b"".join(str(a).encode().ljust(32, b"\0") + str(b).encode().ljust(96, b"\0") for a, b in entries.items())
    rows = np.stack([1e3 * TRAVEL, 1e-3 * LOAD])
    scales = np.array([[0.004], [0.0002]]) if kind == "SHORT_INTEGER" else 1.0
    whole = np.pad(rows, ((0, 0), (0, frames * frame - COUNT)), mode="edge") / scales
    number = {"SHORT_INTEGER": "i2", "FLOATING_POINT": "f4"}.get(kind, "f4")
    parts = [whole[:, k : k + group] for k in range(0, frames * frame, group)]
    if not short:
        parts[-1] = np.pad(parts[-1], ((0, 0), (0, group - parts[-1].shape[1])), mode="edge")
    samples = b"".join((np.rint(part) if number == "i2" else part).astype(order + number).tobytes() for part in parts)
    path.write_bytes((header.ljust(8 * 512, b"\0") + samples)[: -cut or None])
    return path


@pytest.mark.parametrize(("suffix", "options"), [
    (".rsp", {}), (".drv", {"kind": "FLOATING_POINT"}), (".tim", {"order": ">"}), (".RSP", {"frame": 250}),
    (".rsp", {"frame": 250, "per_group": 3}), (".rsp", {"frame": 250, "per_group": 3, "short": True}),
    (".rsp", {"per_group": 1, "SAMPLES": COUNT}),
], ids=str)  # fmt: skip
def test_a_time_history_is_read_to_the_values_written(tmp_path, suffix, options):
    record = read_record(rpc(tmp_path / f"run{suffix}", **options))
    assert record.names == ("time", "LF WPL Disp", "LF Wheel Load")
    assert record.units == ("s", "mm", "kN")
    np.testing.assert_allclose(record.columns[0], TIME, atol=1e-12)
    np.testing.assert_allclose(record.columns[1], 1e3 * TRAVEL, atol=2.1e-3)
    np.testing.assert_allclose(record.columns[2], 1e-3 * LOAD, atol=1.1e-4)
    assert bool(record.notes) == ("SAMPLES" not in options and COUNT % options.get("frame", 256) > 0)


@pytest.mark.parametrize(("changes", "message"), [
    ({"cut": 1}, "ends early"), ({"FORMAT": "ASCII"}, "not a binary file in RPC III"), ({"CHANNELS": "two"}, "'two'"),
    ({"CHANNELS": 1.5}, "not a whole number"), ({"DELTA_T": "nan"}, "DELTA_T is 'nan'"),
    ({"FRAMES": 10**9}, "ends early"),
    ({"NUM_HEADER_BLOCKS": 999}, "ends within its header"), ({"FILE_TYPE": "FATIGUE"}, "contains FATIGUE"),
    ({"kind": "COMPLEX"}, "of COMPLEX"), ({"SCALE.CHAN_2": 0}, r"SCALE.CHAN_2 is '0'"),
], ids=str)  # fmt: skip
def test_a_damaged_or_other_file_is_refused(tmp_path, changes, message):
    with pytest.raises(FileFormatError, match=message):
        read_record(rpc(tmp_path / "run.rsp", **changes))


@pytest.mark.parametrize(("as_integers", "count"), [(False, 2), (True, 2048), (True, 5000)])
def test_a_drive_is_read_back(tmp_path, as_integers, count):
    time = np.arange(count) / 409.6
    series = TimeSeries.from_channels(time, {"lf.road": ("m", np.sin(time)), "rf.road": ("m", 0.0 * time)})
    write_rpc(series, tmp_path / "next.drv", as_integers=as_integers)
    back = read_series(tmp_path / "next.drv")
    assert (back.names, back.units, len(back)) == (series.names, series.units, count)
    np.testing.assert_allclose(back.time, time, rtol=1e-12)
    np.testing.assert_allclose(back.values, series.values, atol=1.6e-5 if as_integers else 6e-8)
    content = (tmp_path / "next.drv").read_bytes()  # the samples of the first channel follow the header
    start = 512 * int(content[160:256].strip(b"\0"))
    scale = np.abs(series["lf.road"]).max() / 32752 if as_integers else 1.0
    first = scale * np.frombuffer(content, "<i2" if as_integers else "<f4", min(count, 2048), start)
    np.testing.assert_allclose(first, back["lf.road"][:2048], rtol=1e-6, atol=1e-9)


def test_uneven_samples_are_not_written(tmp_path):
    with pytest.raises(FileFormatError, match="one time step"):
        write_series(TimeSeries.from_channels([0.0, 0.1, 0.3], {"x": ("m", [0.0, 1.0, 2.0])}), tmp_path / "x.drv")


@pytest.mark.parametrize("halves", [0, 1])
def test_half_frames_are_read_with_a_note_and_not_if_their_place_is_unknown(tmp_path, halves):
    record = read_record(rpc(tmp_path / "run.rsp", per_group=1, SAMPLES=COUNT, HALF_FRAMES=halves))
    assert record.columns[0].size == COUNT and len(record.notes) == halves
    path = rpc(tmp_path / "long.rsp", per_group=1, HALF_FRAMES=halves)
    path.write_bytes(path.read_bytes() + bytes(4 * 256))  # one more frame of two channels
    if halves:
        with pytest.raises(FileFormatError, match="half frames"):
            read_record(path)
    else:
        assert read_record(path).columns[0].size == COUNT


def aim(monkeypatch, channels):
    """Let the library of AiM's logs, as it is documented, return channels: unit, times [ms] and samples by name."""
    tables = {}
    for name, (unit, times, samples) in channels.items():
        field = pa.field(name, pa.float32(), metadata={"units": unit} if unit else None)
        tables[name] = pa.table([times, samples], schema=pa.schema([pa.field("timecodes", pa.int64()), field]))
    library = SimpleNamespace(aim_xrk=lambda path: SimpleNamespace(channels=tables, metadata={"Vehicle": path[-7:]}))
    monkeypatch.setitem(sys.modules, "libxrk", library)
    monkeypatch.setattr(logger_files, "is_installed", lambda name: name == "libxrk")
    monkeypatch.setattr(logger_files, "read_confined", lambda _, path, kind: load_xrk(path))


def test_a_log_of_aim_has_a_table_for_each_set_of_times(tmp_path, monkeypatch):
    aim(monkeypatch, {
        "Damper FL": ("mm", [0, 5, 10], [1.5, -2.0, 0.25]), "Load FL": ("", [0, 5, 10], [1.0, 2.0, 3.0]),
        "Speed": ("km/h", [0, 100], [80.0, 81.0]),
    })  # fmt: skip
    (tmp_path / "run.xrz").write_bytes(b"<hCNF")
    first, second = read_records(tmp_path / "run.xrz")
    assert (first.names, first.units) == (("time", "Damper FL", "Load FL"), ("s", "mm", None))
    np.testing.assert_allclose(first.columns[0], [0.0, 0.005, 0.01])
    np.testing.assert_array_equal(first.columns[1], [1.5, -2.0, 0.25])
    assert second.names == ("time", "Speed") and second.columns[0].tolist() == [0.0, 0.1]
    assert first.preamble == (("Vehicle: run.xrz",),)


def test_a_log_of_aim_without_the_library_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "libxrk", None)
    (tmp_path / "run.xrk").write_bytes(b"<hCNF")
    with pytest.raises(FileFormatError, match=r'run\.xrk: .*pip install "eightpost\[aim\]"'):
        read_record(tmp_path / "run.xrk")


# ---- MoTeC, written here by hand ------------------------------------------------------------------------------------

#: Type, bytes, rate, shift, multiplier, scale, decimals; the number in the file is r with (r / s / 10^d + shift) m.
CHANNELS = {
    "Damper Pos FL": ("mm", 3, 2, 200, 0, 1, 1, 2, 1e3 * TRAVEL),
    "Load FL": ("N", 7, 4, 200, 0, 1, 1, 0, LOAD),
    "G Vert": ("G", 7, 2, 200, 0, 1, 1, 0, np.cos(TIME)),
    "Ride Height": ("mm", 5, 4, 200, 50, 2, 5, 3, 100.0 + 20.0 * TRAVEL),
    "Damper Temp": ("C", 3, 2, 10, 0, 1, 1, 1, 40.0 + np.arange(50) / 10.0),
}  # fmt: skip


def motec(path: Path, channels=CHANNELS, *, loop=False, kind=None) -> Path:
    """Write the header with date and vehicle, the headers of the channels, and their samples."""
    head = bytearray(2000)
    struct.pack_into("<I4xII", head, 0, 0x40, 2000, 2000 + 124 * len(channels))
    head[94:104], head[222:231] = b"12/11/2026", b"Formula X"
    metas, data, place = b"", b"", 2000 + 124 * len(channels)
    for k, (name, (unit, code, size, rate, shift, factor, scale, decimals, values)) in enumerate(channels.items()):
        raw = (values / factor - shift) * scale * 10.0**decimals
        raw = raw.astype(f"<f{size}") if code == 7 else np.rint(raw).astype(f"<i{size}")
        after = 2000 + 124 * (k + 1) if k + 1 < len(channels) else 2000 * loop
        texts = (name.encode(), name[:8].encode(), unit.encode())
        metas += struct.pack("<IIIIHHHHhhhh32s8s12s40x", 0, after, place + len(data), raw.size, k, kind or code, size,
                             rate, shift, factor, scale, decimals, *texts)  # fmt: skip
        data += raw.tobytes()
    path.write_bytes(bytes(head) + metas + data)
    return path


def test_channels_of_a_log_are_read_in_their_types_and_rates(tmp_path):
    first, slow = read_records(motec(tmp_path / "run.ld"))
    assert first.names == ("time", "Damper Pos FL", "Load FL", "G Vert", "Ride Height", "Damper Temp")
    assert first.units == ("s", "mm", "N", "G", "mm", "C")
    np.testing.assert_allclose(first.columns[0], TIME)
    for column, (*_, decimals, values) in zip(first.columns[1:5], CHANNELS.values(), strict=False):
        np.testing.assert_allclose(column, values, rtol=1e-3, atol=10.0**-decimals if decimals else 1e-3)
    assert slow.names == ("time", "Damper Temp")
    np.testing.assert_allclose(slow.columns[1], 40.0 + np.arange(50) / 10.0)
    assert first.preamble == (("Date: 12/11/2026",), ("Vehicle: Formula X",))


def test_a_log_that_is_damaged_is_refused_and_an_unknown_type_is_left_out(tmp_path):
    path = motec(tmp_path / "run.ld", loop=True)
    with pytest.raises(FileFormatError, match="header of a channel at byte 2000 is damaged"):
        read_records(path)
    whole = motec(path).read_bytes()
    for end, message in ((1000, "header of a channel"), (-1, "end early"), (100, "not a log of MoTeC")):
        path.write_bytes(whole[:end])
        with pytest.raises(FileFormatError, match=message):
            read_records(path)
    with pytest.raises(FileFormatError, match="no channel of numbers"):
        read_records(motec(path, kind=9))


VBO = """File created on 12/11/2026 @ 10:00

[header]
satellites
time
velocity kmh
Damper_FL

[channel units]
mm

[comments]
Car X

[column names]
sats time velocity Damper_FL

[data]
007 235959.50 100.5 +12.5
007 235959.75 101.0 -3.25
007 000000.00 101.5 +1.00E+01
"""


def test_a_file_of_sections_is_read_with_its_time_past_midnight(tmp_path):
    path = tmp_path / "lap.vbo"
    path.write_text(VBO, encoding="utf-8")
    record = read_record(path)
    assert record.names == ("sats", "time", "velocity", "Damper_FL")
    assert record.units == (None, "s", "km/h", "mm")
    np.testing.assert_allclose(record.columns[1], [0.0, 0.25, 0.5])
    np.testing.assert_allclose(record.columns[3], [12.5, -3.25, 10.0])
    assert ("Car X",) in record.preamble


@pytest.mark.parametrize(("old", "new", "message"), [
    ("[data]", "[samples]", r"no section \[data\]"), ("101.0 -3.25", "101.0", "line 20"),
    ("+12.5", "x", "not a number"),
])  # fmt: skip
def test_a_file_of_sections_with_a_fault_is_refused(tmp_path, old, new, message):
    path = tmp_path / "lap.vbo"
    path.write_text(VBO.replace(old, new), encoding="utf-8")
    with pytest.raises(FileFormatError, match=message):
        read_record(path)
