"""Properties of a shared library: format, processor, exported symbols, required libraries."""

from __future__ import annotations

import io
import re
import struct
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import lief

lief.logging.disable()

_UNIVERSAL = 0xCAFEBABE
_GLIBC = re.compile(r"GLIBC_(\d+)\.(\d+)(?:\.\d+)?")


@dataclass(frozen=True)
class Binary:
    """One shared library in binaries/<platform>/; if it cannot be read, `fault` is the reason.

    `machines` are x86_64, x86, aarch64 or lief's names of other processors. `libraries` are the file names of the
    libraries that it needs. `glibc` is the highest version of the GLIBC symbols that it needs, or (0, 0).
    """

    name: str
    platform: str
    fault: str = ""
    format: str = ""
    machines: tuple[str, ...] = ()
    exports: frozenset[str] = frozenset()
    undefined: frozenset[str] = frozenset()
    libraries: tuple[str, ...] = ()
    glibc: tuple[int, int] = (0, 0)


_MACHINES = {
    "AMD64": "x86_64",
    "X86_64": "x86_64",
    "I386": "x86",
    "X86": "x86",
    "ARM64": "aarch64",
    "AARCH64": "aarch64",
}


#: Number of bytes that identify the format of a file.
_HEAD = 4096


def read_binary(name: str, platform: str, content: bytes) -> Binary:
    """Read a shared library; any error is stored in `fault`."""
    try:
        with warnings.catch_warnings(action="ignore"):  # lief warns about unknown values
            return _read(name, platform, content)
    except Exception as error:  # lief raises any type of exception for damaged files
        return Binary(name, platform, fault=f"{type(error).__name__}: {error}")


def _read(name: str, platform: str, content: bytes) -> Binary:
    # Parse from a stream: a list of the bytes would need eight times the memory.
    if lief.is_macho(list(content[:_HEAD])):
        fat = lief.MachO.parse(io.BytesIO(content))
        if fat is None or fat.size == 0:
            return Binary(name, platform, fault="it starts like a Mach-O file but cannot be read")
        return _mach_o(name, platform, list(fat), content)
    parsed: Any = lief.parse(io.BytesIO(content))
    if isinstance(parsed, lief.ELF.Binary):
        return _elf(name, platform, parsed, len(content))
    if isinstance(parsed, lief.PE.Binary):
        return _pe(name, platform, parsed, len(content))
    return Binary(name, platform, fault="it is not an ELF, PE or Mach-O file")


def _machine(value: Any) -> str:
    text = str(value).rpartition(".")[2]
    return _MACHINES.get(text.upper(), text.lower())


def _truncated(end: int, size: int) -> str:
    return f"it is truncated: {size} bytes of {end}" if end > size else ""


def _elf(name: str, platform: str, elf: Any, size: int) -> Binary:
    ends = [s.file_offset + s.physical_size for s in elf.segments]
    table = elf.header.section_header_offset + elf.header.numberof_sections * elf.header.section_header_size
    dynamic = list(elf.dynamic_symbols)
    versions = [_version(str(s.symbol_version)) for s in dynamic if s.symbol_version is not None]
    return Binary(
        name,
        platform,
        fault=_truncated(max([*ends, table], default=0), size),
        format="ELF",
        machines=(_machine(elf.header.machine_type),),
        exports=frozenset(str(s.name) for s in dynamic if s.exported),
        undefined=frozenset(str(s.name) for s in dynamic if s.shndx == 0 and s.name),
        libraries=tuple(str(library) for library in elf.libraries),
        glibc=max(versions, default=(0, 0)),
    )


def _version(text: str) -> tuple[int, int]:
    match = _GLIBC.search(text)
    return (int(match[1]), int(match[2])) if match else (0, 0)


def _pe(name: str, platform: str, pe: Any, size: int) -> Binary:
    ends = [s.pointerto_raw_data + s.sizeof_raw_data for s in pe.sections]
    exported = pe.get_export() if pe.has_exports else None
    return Binary(
        name,
        platform,
        fault=_truncated(max(ends, default=0), size),
        format="PE",
        machines=(_machine(pe.header.machine),),
        exports=frozenset(str(e.name) for e in exported.entries) if exported is not None else frozenset(),
        undefined=frozenset(str(e.name) for library in pe.imports for e in library.entries),
        libraries=tuple(str(library.name) for library in pe.imports),
    )


def _mach_o(name: str, platform: str, slices: Iterable[Any], content: bytes) -> Binary:
    parts = list(slices)
    ends = [int(part.fat_offset) + int(s.file_offset + s.file_size) for part in parts for s in part.segments]
    ends += _ends_of_slices(content)
    return Binary(
        name,
        platform,
        fault=_truncated(max(ends, default=0), len(content)),
        format="Mach-O",
        machines=tuple(_machine(part.header.cpu_type) for part in parts),
        exports=frozenset.intersection(*(_mach_o_exports(part) for part in parts)),
        undefined=frozenset(_plain(s.name) for part in parts for s in part.imported_symbols),
        libraries=tuple(dict.fromkeys(str(library.name) for part in parts for library in part.libraries)),
    )


def _ends_of_slices(content: bytes) -> list[int]:
    """Return the ends of the slices of a universal file from its header: lief omits slices that it cannot read."""
    magic, count = struct.unpack_from(">II", content)
    if magic != _UNIVERSAL:
        return []
    parts = (struct.unpack_from(">5I", content, 8 + 20 * k) for k in range(min(count, 16)))
    return [offset + size for _, _, offset, size, _ in parts]


def _mach_o_exports(part: Any) -> frozenset[str]:
    return frozenset(_plain(symbol.name) for symbol in part.exported_symbols)


def _plain(symbol: Any) -> str:
    """Return the C name of a Mach-O symbol, without the additional underscore."""
    return str(symbol).removeprefix("_")
