"""Creation of a universal macOS library from several thin Mach-O files, one per processor."""

from __future__ import annotations

import struct
from collections.abc import Sequence

_FAT_MAGIC = 0xCAFEBABE
_THIN_MAGIC = 0xFEEDFACF
#: Alignment of slices (power of 2): the largest page size in use, 16 KiB on Apple's processors.
_ALIGNMENT = 14


def universal(slices: Sequence[bytes]) -> bytes:
    """Return the fat file of 64-bit slices, in the given order.

    Source: Apple, "Mach-O Programming Topics" and <mach-o/fat.h>: a big-endian header, then one entry per slice with
    processor type and subtype, offset, size and alignment.

    Raises:
        ValueError: A slice is not a 64-bit Mach-O file.
    """
    offset = 8 + 20 * len(slices)
    header = struct.pack(">II", _FAT_MAGIC, len(slices))
    body = b""
    for content in slices:
        magic, kind, subkind = struct.unpack_from("<IiI", content)
        if magic != _THIN_MAGIC:
            raise ValueError(f"a slice starts with {magic:#x} and is not a 64-bit Mach-O file")
        start = -(-(offset + len(body)) >> _ALIGNMENT) << _ALIGNMENT
        header += struct.pack(">iIIII", kind, subkind, start, len(content), _ALIGNMENT)
        body += b"\0" * (start - offset - len(body)) + content
    return header + body
