"""Functions that read files of other programs, and the child process that calls them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Stored
from eightpost.errors import EightpostError, FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.workers.process import ParentChannel


def load_matlab(path: Path, simplify: bool) -> dict[str, Any]:
    """Return the variables of a file by name.

    Args:
        path: Path of the file.
        simplify: Whether to convert structs to dicts and to drop dimensions of length one.

    Raises:
        FileFormatError: The file is of version 7.3 (HDF5), and h5py is not installed.
    """
    import scipy.io  # noqa: PLC0415 -- not needed for MDF files

    try:
        content = scipy.io.loadmat(path, simplify_cells=simplify)
    except NotImplementedError as error:
        if not is_installed("h5py"):
            what = requirement("reading MATLAB 7.3 (HDF5) files", "h5py", "mat73")
            raise FileFormatError(f"{what}; or save the file again with `save(..., '-v7')`", path=path) from error
        return _load_hdf5(path)
    return {name: value for name, value in content.items() if not name.startswith("__")}


class Signal(NamedTuple):
    """A numeric channel: name and unit as in the file, samples (N,) and times (N,) [s]."""

    name: str
    unit: str
    samples: NDArray[np.float64] | Stored
    times: NDArray[np.float64]


class Written(NamedTuple):
    """A numeric channel whose samples were written into a file: their type, number and place, and their times [s]."""

    name: str
    unit: str
    kind: np.dtype[Any]
    size: int
    place: int
    times: NDArray[np.float64]


def load_mdf(path: Path, target: Path) -> tuple[list[Written], str]:
    """Write the samples of the numeric channels of a file into another one.

    Return the channels, and the comment in the file's header.
    """
    mdf = importlib.import_module("asammdf").MDF(path)  # an optional dependency without type hints
    try:
        with target.open("wb") as stream:
            return list(_numeric(mdf, stream)), str(mdf.header.comment or "")
    finally:
        mdf.close()


_AT_ONCE = 8  #: Channels of an MDF file that are in memory; for each further set, the file is read once more.


def _numeric(mdf: Any, stream: BinaryIO) -> Iterator[Written]:
    """Write and yield the channels with one number per sample; skip texts, arrays and time axes.

    Channels with the same times share them.
    """
    times = np.zeros(0)
    for number in mdf.virtual_groups:
        places = [(None, k, i) for k, own in mdf.included_channels(number)[number].items() for i in own]
        for start in range(0, len(places), _AT_ONCE):
            for signal in mdf.select(places[start : start + _AT_ONCE], copy_master=False):
                if signal.samples.dtype.kind not in "iuf" or signal.samples.ndim != 1:
                    continue
                if not np.array_equal(times, signal.timestamps):
                    times = np.asarray(signal.timestamps, dtype=np.float64)
                size, kind, place = signal.samples.size, signal.samples.dtype, stream.tell()
                stream.write(np.ascontiguousarray(signal.samples).data)
                yield Written(str(signal.name), str(signal.unit).strip(), kind, size, place, times)


def load_xrk(path: Path) -> tuple[list[Signal], list[str]]:
    """Return the channels of a log of AiM, whose times are in milliseconds, and the facts about the session."""
    log = importlib.import_module("libxrk").aim_xrk(str(path))  # an optional dependency
    signals = []
    for name, table in log.channels.items():
        unit = (table.schema.field(name).metadata or {}).get(b"units", b"").decode()
        samples, times = (np.asarray(table.column(c), dtype=np.float64) for c in (name, "timecodes"))
        signals.append(Signal(name, unit, samples, 1e-3 * times))
    return signals, [f"{key}: {value}" for key, value in log.metadata.items()]


# ---- MATLAB 7.3 -----------------------------------------------------------------------------------------------------


def _load_hdf5(path: Path) -> dict[str, Any]:
    """Return the variables of a MATLAB 7.3 file by name: numbers, texts and structs of them."""
    h5py = importlib.import_module("h5py")  # an optional dependency
    with h5py.File(path, "r") as file:
        return {name: value for name, item in file.items() if name[0] != "#" and (value := _hdf5(item)) is not None}


def _hdf5(item: Any) -> Any:
    """Return an object of an HDF5 file as scipy would; None for other types. MATLAB stores matrices transposed."""
    if hasattr(item, "items"):
        fields = {name: value for name, child in item.items() if (value := _hdf5(child)) is not None}
        return _struct_array(fields) if all(isinstance(value, list) for value in fields.values()) else fields
    kind = item.attrs.get("MATLAB_class", b"")
    if item.dtype.kind == "O" and kind != b"cell":  # references to the values of a field of an array of structs
        return [_hdf5(item.file[reference]) for reference in np.asarray(item[()]).T.ravel() if reference]
    if item.attrs.get("MATLAB_empty", 0) or item.dtype.kind not in "iufb":
        return None
    values = np.asarray(item[()]).T
    if kind == b"char":
        return "".join(map(chr, values.ravel().tolist()))
    squeezed = values.squeeze()
    return squeezed if squeezed.ndim else squeezed.item()


def _struct_array(fields: dict[str, list[Any]]) -> list[dict[str, Any]]:
    """Return an array of structs, as scipy would, from the values of each field."""
    return [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)]


# ---- Spreadsheets and LabVIEW ---------------------------------------------------------------------------------------


class Sheet(NamedTuple):
    """A sheet of a spreadsheet: its name, whether it is hidden, and its rows of cells."""

    name: str
    is_hidden: bool
    rows: list[list[Any]]


def load_spreadsheet(path: Path) -> list[Sheet]:
    """Return the sheets of a spreadsheet."""
    calamine = importlib.import_module("python_calamine")
    book = calamine.CalamineWorkbook.from_path(str(path))
    return [
        Sheet(
            one.name,
            one.visible != calamine.SheetVisibleEnum.Visible,
            book.get_sheet_by_name(one.name).to_python(skip_empty_area=False),
        )
        for one in book.sheets_metadata
        if one.typ == calamine.SheetTypeEnum.WorkSheet
    ]


class Table(NamedTuple):
    """A group of channels: (name, unit, samples) each, the step [s] and start [s] of the time, lines of facts.

    `others` has the channels that were sampled at other times, with the difference in words.
    """

    columns: list[tuple[str, str, NDArray[np.float64]]]
    step: float
    start: float
    preamble: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()


def load_tdms(path: Path) -> list[Table]:
    """Return a table for each group of a TDMS file."""
    tables = []
    content = importlib.import_module("nptdms").TdmsFile.read(path)
    facts = tuple(f"{key}: {value}" for key, value in content.properties.items())
    for group in content.groups():
        numeric = [channel for channel in group.channels() if channel.dtype.kind in "iufM" and len(channel)]
        columns = [(c.name, _unit_of(c), _numbers(c[:])) for c in numeric]
        own = tuple(f"{key}: {value}" for key, value in group.properties.items())
        if columns:
            axes = {c.name: _time_axis(c) for c in numeric}
            tables.append(Table(columns, *_common_axis(axes), (*facts, *own), tuple(_with_other_times(axes))))
    return tables


def _unit_of(channel: Any) -> str:
    if channel.dtype.kind == "M":
        return "s"
    found = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription") or ""
    return str(found).strip()


#: Units of the increment of a waveform, in seconds; the increment of a spectrum is in hertz.
_X_UNITS = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "min": 60.0}


def _time_axis(channel: Any) -> tuple[float, float]:
    """Return the increment [s] and the start [s] of a waveform; zeros without a time.

    The start is the offset of the first sample; with the time of day of a trigger it is counted from 1970.
    """
    facts = channel.properties
    scale = _X_UNITS.get(str(facts.get("wf_xunit_string", "")).strip().lower(), 0.0)
    step, offset = (scale * float(facts.get(key, 0.0)) for key in ("wf_increment", "wf_start_offset"))
    trigger = facts.get("wf_start_time")
    if step and isinstance(trigger, np.datetime64) and not np.isnat(trigger):
        offset += 1e-9 * float(trigger.astype("datetime64[ns]").astype(np.int64))
    return step, offset


def _common_axis(axes: dict[str, tuple[float, float]]) -> tuple[float, float]:
    """Return the increment and the start of the first waveform; a start with a time of day becomes 0."""
    step, start = next((axis for axis in axes.values() if axis[0]), (0.0, 0.0))
    return step, start if abs(start) < _ABSOLUTE else 0.0


#: Starts above this are times of day, counted from 1970 [s].
_ABSOLUTE = 1e8
#: Largest difference of the starts of channels that were sampled at the same times, in steps.
_SAME_START = 0.01


def _with_other_times(axes: dict[str, tuple[float, float]]) -> Iterator[tuple[str, str]]:
    """Yield the channels that were sampled at other times than the first waveform, with the difference in words."""
    step, start = next((axis for axis in axes.values() if axis[0]), (0.0, 0.0))
    zero = start if abs(start) > _ABSOLUTE else 0.0
    for name, (own_step, own_start) in axes.items():
        is_same = abs(own_step / step - 1.0) <= 1e-6 and abs(own_start - start) <= _SAME_START * step if step else True
        if own_step and not is_same:
            yield (
                name,
                f"it has steps of {1e3 * own_step:.6g} ms from {own_start - zero:.4g} s on, others {1e3 * step:.6g} ms "
                f"from {start - zero:.4g} s on; export all channels with one rate and one start",
            )


def _numbers(values: NDArray[Any]) -> NDArray[np.float64]:
    if values.dtype.kind == "M":
        values = (values - values[0]) / np.timedelta64(1, "ns") * 1e-9
    return np.asarray(values, dtype=np.float64)


class LvmSegment(NamedTuple):
    """A segment of a LabVIEW measurement file.

    `names` are the headers of the columns, `data` (N, C) their numbers with NaN for empty cells, `tags` the rows of
    facts by channel with all cells behind the tag, and `comments` the texts of the last column.
    """

    names: tuple[str, ...]
    data: NDArray[np.float64]
    tags: dict[str, list[str]]
    comments: tuple[str, ...]


def load_lvm(_: Path, lines: list[str], separator: str) -> tuple[dict[str, str], list[LvmSegment]]:
    """Return the tags of the file's header and the segments of a LabVIEW measurement file.

    Args:
        lines: Lines of the file, which is not read again.
        separator: Character between columns.
    """
    content = importlib.import_module("lvm_read").read_lines([f"{line}\n" for line in lines], separator=separator)
    segments = []
    for number in range(int(content["Segments"])):
        segment = content[number]
        tags = {
            key: [str(value) for value in values]
            for key, values in segment.items()
            if isinstance(values, list) and key not in ("Channel names", "comments")
        }
        data = np.asarray(segment["data"], dtype=np.float64)
        names = tuple(segment["Channel names"])
        segments.append(LvmSegment(names, np.atleast_2d(data), tags, tuple(segment.get("comments", ()))))
    return {key: value for key, value in content.items() if isinstance(key, str) and isinstance(value, str)}, segments


# ==== The child process, which reads one file after the other within a limit of memory ===============================


def _answer(request: tuple[str, str, tuple[Any, ...], int]) -> tuple[str, Any]:
    """Call the function of a request; return ("done", result), ("refused", error) or ("failed", message)."""
    function, path, options, memory = request
    module, _, name = function.partition(":")
    try:
        read = getattr(importlib.import_module(module), name)
        _limit_memory(memory)
        return "done", read(Path(path), *options)
    except EightpostError as error:
        return "refused", error
    except MemoryError:
        limit = f"{memory / 2**30:.1f} GiB"
        return "failed", f"reading it needs more than {limit} of memory; it is damaged, or export a shorter record"
    except Exception as error:  # libraries raise many types for files that they cannot read
        return "failed", f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _unsendable(error: Exception) -> tuple[str, Any]:
    return "failed", f"it contains objects that are not data ({error})"


def _limit_memory(memory: int) -> None:
    """Limit the address space to the current use plus `memory` [bytes], on systems that support it."""
    if sys.platform != "win32":
        import resource  # noqa: PLC0415 -- Windows does not have it

        try:
            taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        except OSError:
            taken = 4 * 2**30
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        wanted = taken + memory
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


if __name__ == "__main__":
    ParentChannel(sys.argv[1]).serve(_answer, _unsendable)
