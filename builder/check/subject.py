"""The subject of the static rules: the archive's entries and the model description."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath

from builder.check.binary import Binary, read_binary
from builder.check.description import Description, read_description
from eightpost.archive import open_archive, unsafe_reason
from eightpost.errors import FmuError

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
    root: ET.Element | None
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
            is an FMU of FMI 1 or 3.
    """
    path = Path(path)
    if path.is_dir():
        raise FmuError(f"{path}: is a folder, not an .fmu file; name the files in it (check {path}/*.fmu)")
    entries, members = _read(path)
    if not any(PurePosixPath(name.replace("\\", "/")).name == XML for name in members):
        raise FmuError(f"{path}: is not an FMU: it contains no {XML}")
    if XML not in members:
        return Subject(path, entries, members, None, "", None)
    try:
        root = ET.fromstring(members[XML])
    except (ET.ParseError, ValueError, LookupError) as error:
        return Subject(path, entries, members, None, f"{type(error).__name__}: {error}", None)
    if root.get("fmiVersion", "2").startswith(("1.", "3.")):
        raise FmuError(f"{path}: is an FMU of FMI {root.get('fmiVersion')}; check supports FMI 2.0")
    return Subject(path, entries, members, root, "", read_description(root))


def _read(path: Path) -> tuple[tuple[zipfile.ZipInfo, ...], dict[str, bytes]]:
    with open_archive(path) as archive:
        entries = tuple(archive.infolist())
        return entries, {e.orig_filename: archive.read(e) for e in entries if not e.is_dir()}
