"""The subject of the static rules: the archive's entries, its shared libraries and the model description."""

from __future__ import annotations

import io
import re
import struct
import warnings
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from eightpost.archive import open_archive, unsafe_reason
from eightpost.errors import FmuError
from eightpost.extras import needs
from eightpost.fmi.description import BUILD, Description, read_description

with needs("check", "checking FMUs"):
    import lief

# ---- A shared library: format, processor, exported symbols, required libraries --------------------------------------

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

    def exports_without(self, identifier: str) -> frozenset[str]:
        """Return the exports without the prefix for static linking."""
        return frozenset(name.removeprefix(f"{identifier}_") for name in self.exports)


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
            return _read_checked(name, platform, content)
    except Exception as error:  # lief raises any type of exception for damaged files
        return Binary(name, platform, fault=f"{type(error).__name__}: {error}")


def _read_checked(name: str, platform: str, content: bytes) -> Binary:
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


# ---- The archive ----------------------------------------------------------------------------------------------------

XML = "modelDescription.xml"
_BINARY = re.compile(r"binaries/([^/]+)/([^/]+)\.(so|dll|dylib)")


@dataclass(frozen=True)
class Subject:
    """An FMU file: entries as stored, contents by name (the last of duplicate entries), and the parsed description.

    `description` is None if the XML is missing or not well-formed; in the latter case `xml_error` is the reason.
    """

    path: Path
    entries: tuple[zipfile.ZipInfo, ...]
    members: Mapping[str, bytes]
    xml_error: str
    description: Description | None

    @cached_property
    def binaries(self) -> tuple[Binary, ...]:
        """Shared libraries in binaries/<platform>/."""
        found = ((name, _BINARY.fullmatch(name)) for name in sorted(self.members))
        return tuple(read_binary(name, match[1], self.members[name]) for name, match in found if match)

    @property
    def own_binaries(self) -> tuple[Binary, ...]:
        """Binaries named after the modelIdentifier."""
        identifier = self.description.identifier if self.description else ""
        return tuple(binary for binary in self.binaries if PurePosixPath(binary.name).stem == identifier)

    @property
    def is_safe(self) -> bool:
        """Whether unpacking writes nothing outside the target folder."""
        return not any(unsafe_reason(entry) for entry in self.entries)


def read_subject(path: str | Path) -> Subject:
    """Read an FMU.

    Raises:
        FmuError: The file is missing, is a folder, is not a readable zip archive, contains no modelDescription.xml, or
            is an FMU of FMI 1.
    """
    path = Path(path)
    if path.is_dir():
        raise FmuError(f"{path}: is a folder, not an .fmu file; name the files in it (check {path}/*.fmu)")
    entries, members = _read(path)
    if not any(PurePosixPath(name.replace("\\", "/")).name == XML for name in members):
        raise FmuError(f"{path}: is not an FMU: it contains no {XML}")
    if XML not in members:
        return Subject(path, entries, members, "", None)
    try:
        root = ET.fromstring(members[XML])
    except (ET.ParseError, ValueError, LookupError) as error:
        return Subject(path, entries, members, f"{type(error).__name__}: {error}", None)
    if root.get("fmiVersion", "2").startswith("1."):
        raise FmuError(f"{path}: is an FMU of FMI {root.get('fmiVersion')}; check supports FMI 2.0 and 3.0")
    return Subject(path, entries, members, "", read_description(root, _build_description(members)))


def _build_description(members: Mapping[str, bytes]) -> ET.Element | None:
    try:
        return ET.fromstring(members[BUILD])
    except (KeyError, ET.ParseError, ValueError, LookupError):
        return None


def _read(path: Path) -> tuple[tuple[zipfile.ZipInfo, ...], dict[str, bytes]]:
    with open_archive(path) as archive:
        entries = tuple(archive.infolist())
        return entries, {e.orig_filename: archive.read(e) for e in entries if not e.is_dir()}
