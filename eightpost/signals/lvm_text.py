"""Text of a LabVIEW measurement file, brought into the form that lvm_read expects."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from eightpost.errors import FileFormatError
from eightpost.signals.column_headers import is_number

_END_OF_HEADER, _NAMES = "***End_of_Header***", "X_Value"
_SPECIAL = ("***Start_Special***", "***End_Special***")

#: Note on a file whose last line has no end.
_CUT = (
    "the last sample (line {line}) was left out: LabVIEW ends every line, and this one has no line end, so the file is "
    "probably not complete; export it again"
)


def has_header(lines: Sequence[str]) -> bool:
    """Return whether a file has the header of a LabVIEW measurement; some programs name plain text files .lvm."""
    return any(line.startswith(_END_OF_HEADER) for line in lines[:200])


def separator_of(lines: Sequence[str]) -> str:
    """Return the character between columns that the header states; default a tab."""
    return next((line[9:10] for line in lines[:40] if line.startswith("Separator")), "") or "\t"


def readable_lines(lines: Sequence[str], path: Path) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines of a file in the form that lvm_read expects, and notes on what was left out.

    A last sample without a line end is left out. Special blocks and repeated empty lines are removed, empty lines
    within a table too. The tag `Channels` gets as many cells as the table has, and a missing `Decimal_Separator` is
    added if the numbers have a decimal comma.

    Args:
        lines: Lines of the file, split at line ends; the last one is empty if the file ends with a line end.
        path: Path of the file, for messages.

    Raises:
        FileFormatError: A table without X values is interrupted, so that the times behind the gap are unknown, or a
            segment has no names of channels.
    """
    separator = separator_of(lines)
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
        below = next((one for one in tags[i + 1 :] if one[0] in ("Channels", _NAMES)), tags[i])
        if below[0] == "Channels":
            what = (
                f"the segment with the line {lines[i].strip()!r} has no line `{_NAMES}` with the names of its channels"
            )
            raise FileFormatError(f"{what}; export it again", path=path)
        yield lines[i] + separator * max(0, below[1] - width)
