"""The places of columns that a Parquet file states in its footer, checked before arro3 reads them: a wrong one ends it.

The footer is a struct in Thrift's compact protocol (parquet-format, FileMetaData): its fields have numbers and types.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import BinaryIO

#: A value of Thrift: a number, a text, a list, or the fields of a struct by number.
Value = int | float | bytes | list["Value"] | dict[int, "Value"]

#: Fields of FileMetaData, RowGroup and ColumnChunk that lead to the columns; size and places in ColumnMetaData.
_ROW_GROUPS, _COLUMNS, _META_DATA = 4, 1, 3
_SIZE, _DATA, _INDEX, _DICTIONARY = 7, 9, 10, 11

#: Deepest nesting of a footer; a damaged one may have any.
_DEEPEST = 20


class _Thrift:
    """A reader of values in the compact protocol, from the start of some bytes."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at, self._depth = content, 0, 0
        self._read: Mapping[int, Callable[[], Value]] = {
            1: lambda: 1, 2: lambda: 0, 3: self._byte, 4: self._integer, 5: self._integer, 6: self._integer,
            7: lambda: float(struct.unpack("<d", self._bytes(8))[0]), 8: lambda: self._bytes(self._varint()),
            9: self._list, 10: self._list, 12: self.fields,
        }  # fmt: skip

    def fields(self) -> dict[int, Value]:
        """Return the fields of a struct."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError("nested too deeply")
        found: dict[int, Value] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            found[number] = self._read[head & 15]()
        self._depth -= 1
        return found

    def _list(self) -> list[Value]:
        head = self._byte()
        count, kind = head >> 4, head & 15
        read = self._byte if kind in (1, 2) else self._read[kind]
        return [read() for _ in range(self._varint() if count == 15 else count)]

    def _byte(self) -> int:
        return self._bytes(1)[0]

    def _bytes(self, count: int) -> bytes:
        found = self._content[self._at : self._at + count]
        if len(found) < count:
            raise ValueError("it ends early")
        self._at += count
        return found

    def _varint(self) -> int:
        value, shift = 0, 0
        while (byte := self._byte()) >= 128:
            value, shift = value | (byte & 127) << shift, shift + 7
        return value | byte << shift

    def _integer(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)


def check_footer(file: BinaryIO, size: int) -> None:
    """Check that the columns of a Parquet file, which ends after `size` bytes, are inside it.

    Raises:
        ValueError: They are not, or the footer cannot be read.
    """
    file.seek(size - 8)
    length = int.from_bytes(file.read(4), "little")
    try:
        file.seek(size - 8 - length)
        for group in _listed(_Thrift(file.read(length)).fields(), _ROW_GROUPS):
            for column in _listed(group, _COLUMNS):
                stated = column.get(_META_DATA, {}) if isinstance(column, dict) else {}
                if isinstance(stated, dict) and not _is_inside(stated, size):
                    raise ValueError("a column is outside the file")
    except (KeyError, OSError, ValueError) as error:
        raise ValueError("the description of its columns is damaged") from error


def _is_inside(column: Mapping[int, Value], size: int) -> bool:
    length, *places = (column.get(number, 0) for number in (_SIZE, _DATA, _INDEX, _DICTIONARY))
    found = [at for at in (length, *places) if isinstance(at, int) and 0 <= at <= size]
    return len(found) == 1 + len(places) and min(filter(None, found[1:]), default=0) + found[0] <= size


def _listed(value: Value, number: int) -> list[Value]:
    found = value.get(number, []) if isinstance(value, dict) else []
    return found if isinstance(found, list) else []
