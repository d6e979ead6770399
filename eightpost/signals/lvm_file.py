"""LabVIEW measurement files (.lvm), read with lvm_read: segments, and one, several or no columns of time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.files import reading
from eightpost.signals.csv_file import read_delimited
from eightpost.signals.raw_record import RawRecord, by_time, table_of, temperatures_at
from eightpost.signals.table_text import decoded, is_number, seconds_of, split_header
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.confined.readers import LvmSegment, Signal


# ==== Reading ========================================================================================================

_SAME = 0.01  #: Largest difference between two axes of time that are the same, in median steps.
_FOLLOWS = 0.25  #: Largest deviation of the time between two segments that follow each other from one step, in steps.
_ABSOLUTE = 1e9  #: Times above this are not relative to the start of the segment but to 1904 [s].

_COMMENT, _X = "Comment", "X_Value"
#: Tags of the header that describe the file, not the test.
_TECHNICAL = (
    "Writer_Version", "Reader_Version", "Separator", "Decimal_Separator", "Multi_Headings", "X_Columns", "Time_Pref",
    "Time", "",
)  # fmt: skip
#: Names of the tested unit in the header, as a preamble names them.
_TAGS = {"UUT_Name": "Shock", "UUT_S/N": "Serial Number"}


def read_lvm(path: Path) -> tuple[RawRecord, ...]:
    """Read a .lvm file: one table per segment and axis of time, with the time [s] as its column `time`.

    The time is that of the X columns; without X columns, it follows from the start and the increment of each channel.
    Channels of a segment whose times differ by more than 1 % of a step make tables of their own, and a note names
    them; temperatures are interpolated. Segments of the same channels that follow each other within a quarter of a step
    are joined. A file without the header of a LabVIEW measurement is read as a text file.

    Raises:
        FileFormatError: lvm_read is not installed, or the file cannot be read or has no channel of numbers.
    """
    with reading(path):
        text = decoded(path.read_bytes())
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not has_header(lines):
        return read_delimited(path)
    if not is_installed("lvm_read"):
        raise FileFormatError(requirement("reading LabVIEW measurements (.lvm)", "lvm_read", "files"), path=path)
    clean, notes = _readable_lines(lines, path)
    kind = "a LabVIEW measurement (.lvm)"
    tags, found = read_confined("eightpost.confined.readers:load_lvm", path, clean, _separator_of(lines), kind=kind)
    segments = [_segment(one, tags.get("X_Columns", "One").strip(), path) for one in found]
    segments = [one for one in segments if one.signals]
    if not segments:
        raise FileFormatError("it contains no channel of numbers", path=path)
    comments = [comment.strip() for one in found for comment in one.comments if comment.strip()]
    if comments:
        notes = (*notes, f"{len(comments)} comments beside the samples were not read, the first is {comments[0]!r}")
    preamble = tuple((f"{_TAGS.get(k, k.replace('_', ' '))}: {v}",) for k, v in tags.items() if k not in _TECHNICAL)
    return tuple(record for one in _joined(segments) for record in _records(one, path, preamble, notes))


# ---- Channels of a segment ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Segment:
    """Channels with their times [s] from the start of the first one, and that start: number of the day, seconds."""

    signals: tuple[Signal, ...]
    start: tuple[int, float]

    @property
    def kind(self) -> tuple[tuple[str, str], ...]:
        """Names and units of the channels."""
        return tuple((signal.name, signal.unit) for signal in self.signals)


def _segment(found: LvmSegment, x_columns: str, path: Path) -> _Segment:
    from eightpost.confined.readers import Signal  # noqa: PLC0415 -- for .lvm files only

    names = found.names[:-1] if found.names[-1:] == (_COMMENT,) else found.names
    columns = _columns(names, x_columns, path)
    if max((y for _, y in columns), default=0) >= found.data.shape[1]:
        header = f"its header names {len(names)} columns; export it again"
        raise FileFormatError(f"its rows have {found.data.shape[1]} numbers, and {header}", path=path)
    spread = 2 if x_columns == "Multi" else 1
    facts = [_facts(found.tags, k, len(columns), spread, path) for k in range(len(columns))]
    signals = []
    for (x, y), fact in zip(columns, facts, strict=True):
        samples = found.data[:, y]
        size = int(np.flatnonzero(np.isfinite(samples))[-1]) + 1 if np.isfinite(samples).any() else 0
        if not size:
            continue
        if x is None and not fact.step > 0.0:
            what = "it has neither X values nor an increment (Delta_X), so its times are unknown; export with X values"
            raise FileFormatError(what, path=path, channel=names[y])
        is_own = x_columns != "Multi" and not fact.is_like(facts[0])
        times = fact.times(size) if x is None or is_own else fact.x_scale * found.data[:size, x]
        offset = 0.0 if times[0] > _ABSOLUTE else _between(facts[0].start, fact.start)
        plain, stated = (names[y], fact.unit) if fact.unit else split_header(names[y])
        signals.append(Signal(plain, stated or "", samples[:size], times + offset))
    return _Segment(tuple(_with_shared_times(signals)), facts[0].start if facts else (0, 0.0))


def _columns(names: Sequence[str], x_columns: str, path: Path) -> list[tuple[int | None, int]]:
    """Return the columns of the time and of the samples of each channel; None for a time without a column."""
    if x_columns == "No":
        return [(None, y) for y in range(len(names))]
    pairs = [(x, x + 1) for x in range(0, len(names), 2)]
    if x_columns == "Multi" and not len(names) % 2 and all(names[x] == _X for x, _ in pairs):
        return list(pairs)
    if x_columns == "Multi" or _X in names[1:]:
        what = f"its header states the X columns {x_columns!r}, but its columns are {', '.join(names)}; export it again"
        raise FileFormatError(what, path=path)
    return [(0, y) for y in range(1, len(names))]


@dataclass(frozen=True, slots=True)
class _Facts:
    """Unit of a channel, first X value and increment [s], start (number of the day, seconds), unit of X in seconds."""

    unit: str
    first: float
    step: float
    start: tuple[int, float]
    x_scale: float

    def times(self, size: int) -> NDArray[np.float64]:
        """Return the times (size,) [s] that follow from the first one and the increment."""
        return np.asarray(self.first + self.step * np.arange(size), dtype=np.float64)

    def is_like(self, other: _Facts) -> bool:
        """Return whether a channel has the times of another one, as far as the file states them."""
        if not self.step:
            return True
        limit = _SAME * other.step
        return (
            abs(self.step - other.step) <= 1e-6 * other.step
            and abs(self.first - other.first) <= limit
            and abs(_between(other.start, self.start)) <= limit
        )


def _facts(tags: dict[str, list[str]], k: int, count: int, spread: int, path: Path) -> _Facts:
    """Return the facts of a channel; with an X column for each one, they stand two cells apart, if they are spread."""

    def cell(tag: str) -> str:
        cells = ["" if one == "nan" else one.strip() for one in tags.get(tag, [])]
        is_dense = any(cells[1 : 2 * count : 2])
        place = k if is_dense else spread * k
        return cells[place] if place < len(cells) else ""

    dimension, label = cell("X_Dimension"), cell("X_Unit_Label")
    if dimension.lower().startswith(("freq", "fréq")):
        what = f"its X axis is {dimension!r}, not the time; export the record over time"
        raise FileFormatError(what, path=path)
    scale = convert(1.0, label, "s") if label and is_unit(label) and compatible(label, "s") else 1.0
    try:
        first, step = (float(cell(tag) or 0.0) * scale for tag in ("X0", "Delta_X"))
    except ValueError as error:
        raise FileFormatError(f"its start X0 or increment Delta_X is not a number: {error}", path=path) from error
    return _Facts(cell("Y_Unit_Label"), first, step, _moment(cell("Date"), cell("Time")), scale)


def _moment(day: str, clock: str) -> tuple[int, float]:
    """Return the number of a day and the seconds of a time of day; 0 if they cannot be read."""
    try:
        number = date(*(int(part) for part in day.split("/"))).toordinal()
    except (TypeError, ValueError):
        number = 0
    return number, seconds_of(clock) or 0.0


def _between(start: tuple[int, float], stop: tuple[int, float]) -> float:
    """Return the time between two moments [s]."""
    return 86400.0 * (stop[0] - start[0]) + stop[1] - start[1]


def _with_shared_times(signals: Sequence[Signal]) -> Iterator[Signal]:
    """Yield channels whose times differ by less than 1 % of a step with the times of the first one."""
    known: list[Signal] = []
    for signal in signals:
        same = next((one for one in known if _is_same(one.times, signal.times)), signal)
        known.append(same)
        yield signal._replace(times=same.times)


def _is_same(times: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    if times.size != others.size:
        return False
    with np.errstate(invalid="ignore"):  # infinite times; they are refused with their line
        step = float(np.median(np.diff(times))) if times.size > 1 else 1.0
        return bool(np.abs(times - others).max(initial=0.0) <= _SAME * step)  # False if there is a NaN


# ---- Segments and tables --------------------------------------------------------------------------------------------


def _joined(segments: Sequence[_Segment]) -> Iterator[_Segment]:
    """Yield segments; those that follow each other without a gap are one."""

    def follows(times: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
        step = float(np.median(np.diff(times))) if times.size > 1 else -1.0
        return bool(abs(others[0] - times[-1] - step) <= _FOLLOWS * step)

    last = segments[0]
    for segment in segments[1:]:
        shift = _between(last.start, segment.start)
        if last.kind == segment.kind and all(
            follows(a.times, b.times + shift) for a, b in zip(last.signals, segment.signals, strict=True)
        ):
            signals = (
                a._replace(
                    samples=np.concatenate([a.samples, b.samples]), times=np.concatenate([a.times, b.times + shift])
                )
                for a, b in zip(last.signals, segment.signals, strict=True)
            )
            last = replace(last, signals=tuple(_with_shared_times(list(signals))))
        else:
            yield last
            last = segment
    yield last


def _records(
    segment: _Segment, path: Path, preamble: tuple[tuple[str, ...], ...], notes: tuple[str, ...]
) -> Iterator[RawRecord]:
    """Yield a table for each axis of time; the first one has the temperatures of the others too."""
    first, *others = by_time(segment.signals)
    warm = temperatures_at(first[0].times, others)
    read = {signal.name for signal in warm}
    apart = [[signal for signal in table if signal.name not in read] for table in others]
    notes = (*notes, *(_apart(table, first) for table in apart if table))
    for table in ([*first, *warm], *(table for table in apart if table)):
        yield table_of(table, path, preamble, notes)


def _apart(table: Sequence[Signal], first: Sequence[Signal]) -> str:
    names = ", ".join(repr(signal.name) for signal in table)
    these, those = (_words(one[0].times) for one in (table, first))
    return (
        f"the channels {names} were sampled at other times than {first[0].name!r} ({these}, not {those}) and are read "
        "as a table of their own; to use them together, export all channels with one rate and one start"
    )


def _words(times: NDArray[np.float64]) -> str:
    step = f"steps of {1e3 * float(np.median(np.diff(times))):.6g} ms, " if times.size > 1 else ""
    return f"{times.size} samples, {step}first at {float(times[0]):.6g} s"


# ==== Text in the form that lvm_read expects =========================================================================

_END_OF_HEADER = "***End_of_Header***"
_SPECIAL = ("***Start_Special***", "***End_Special***")
#: Note on a file whose last line has no end.
_CUT = (
    "the last sample (line {line}) was left out: LabVIEW ends every line, and this one has no line end, so the file is "
    "probably not complete; export it again"
)


def has_header(lines: Sequence[str]) -> bool:
    """Return whether a file has the header of a LabVIEW measurement; some programs name plain text files .lvm."""
    return any(line.startswith(_END_OF_HEADER) for line in lines[:200])


def _separator_of(lines: Sequence[str]) -> str:
    """Return the character between columns that the header states; default a tab."""
    return next((line[9:10] for line in lines[:40] if line.startswith("Separator")), "") or "\t"


def _readable_lines(lines: Sequence[str], path: Path) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines of a file in the form that lvm_read expects, and notes on what was left out.

    A last sample without a line end is left out. Special blocks and repeated empty lines are removed, empty lines
    within a table too. The tag `Channels` gets as many cells as the table has, and a missing `Decimal_Separator` is
    added if the numbers have a decimal comma.
    """
    separator = _separator_of(lines)
    kept, notes = list(lines), []
    if kept and kept.pop().strip():
        notes.append(_CUT.format(line=len(lines)))
    kept = list(_without_breaks(_without_special(kept), separator, path))
    if _needs_comma(kept, separator):
        kept.insert(1, f"Decimal_Separator{separator},")
    return list(_with_width(kept, separator, path)), tuple(notes)


def _is_row(line: str, separator: str) -> bool:
    """Return whether a line is a row of numbers; its first cell is empty if the file has no X values."""
    cells = [cell.strip() for cell in line.split(separator) if cell.strip()]
    return bool(cells) and is_number(cells[0])


def _without_special(lines: Sequence[str]) -> Iterator[str]:
    """Yield the lines outside special blocks, which readers may skip."""
    is_special = False
    for line in lines:
        is_special = is_special or line.startswith(_SPECIAL[0])
        if not is_special:
            yield line
        is_special = is_special and not line.startswith(_SPECIAL[1])


def _without_breaks(lines: Iterator[str], separator: str, path: Path) -> Iterator[str]:
    """Yield lines with one empty line before each segment's header and no other."""
    was_empty, was_row = False, False
    x_columns = ""
    for number, line in enumerate(lines, 1):
        if line.startswith("X_Columns"):
            x_columns = line.partition(separator)[2].strip()
        if line in ("", separator):
            was_empty = True
            continue
        is_row = _is_row(line, separator)
        if was_empty and not (is_row and was_row):
            yield ""
        elif was_empty and x_columns == "No":
            what = (
                "a block of samples has no header and no X values, so its times are unknown; export with X values "
                "(X_Columns One) or with a header for each segment"
            )
            raise FileFormatError(what, path=path, line=number)
        yield line
        was_empty, was_row = False, is_row


def _needs_comma(lines: Sequence[str], separator: str) -> bool:
    """Return whether the numbers have a decimal comma that the header does not state, as in files of version 1."""
    if separator == "," or any(line.startswith("Decimal_Separator") for line in lines[:40]):
        return False
    rows = [line for line in lines if _is_row(line, separator)][:50]
    return any(re.search(r"\d,\d", row) for row in rows) and not any("." in row for row in rows)


def _with_width(lines: Sequence[str], separator: str, path: Path) -> Iterator[str]:
    """Yield lines in which the tag `Channels` has as many cells as the names of the columns below it."""
    tags = [(line.split(separator)[0], line.count(separator)) for line in lines]
    for i, (tag, width) in enumerate(tags):
        if tag != "Channels":
            yield lines[i]
            continue
        below = next((one for one in tags[i + 1 :] if one[0] in ("Channels", _X)), tags[i])
        if below[0] == "Channels":
            what = f"has no line `{_X}` with the names of its channels; export it again"
            raise FileFormatError(f"the segment with the line {lines[i].strip()!r} {what}", path=path)
        yield lines[i] + separator * max(0, below[1] - width)
