"""Files of a package: an archive is unpacked, a bare description is read in its folder."""

from __future__ import annotations

import os.path
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import SplitResult, unquote, urlsplit
from urllib.request import url2pathname

from eightpost.archive import extract_archive, read_archive
from eightpost.errors import FmuError, InputError
from eightpost.files import is_file

DEFAULT = "SystemStructure.ssd"


class Unpacked:
    """Folder of an unpacked archive; it is removed with the last object that refers to it."""

    def __init__(self, archive: Path) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="ssp_"))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        extract_archive(archive, self.folder)


@dataclass(frozen=True)
class Place:
    """Description and the location of its files.

    Args:
        description: Description file (.ssd); sources are relative to its folder.
        root: Folder that relative sources must not leave; None for a bare description, whose files may be in other
            folders.
        label: Display name of the file for messages: `car.ssp: SystemStructure.ssd`.
        package: Name of the archive alone; equal to `label` for a bare description.
        unpacked: Folder that must exist as long as the files are used; None for a bare description.
    """

    description: Path
    root: Path | None
    label: str
    package: str
    unpacked: Unpacked | None = None

    def resolve(self, source: str, what: str) -> tuple[Path, str]:
        """Return the file of a source (a URI) and its fragment.

        Args:
            source: Source as written in the description: relative to it, or file:///...; both percent-encoded.
            what: Element, for messages.

        Raises:
            InputError: The source is not such a URI, is outside the package, or the file does not exist.
        """
        what = f"{self.label}: {what}: "
        parts = _split(source)
        if parts.scheme not in ("", "file") or parts.netloc not in ("", "localhost") or "\\" in source:
            raise InputError(
                f"{what}the source {source!r} is neither relative, with forward slashes, nor a file:/// address; put "
                "the file into the package and name it as for example 'resources/shock.fmu'"
            )
        if parts.scheme:
            found = {Path(url2pathname(parts.path)): unquote(parts.fragment)}
        else:
            found = self._relative(source, what)
        for path, fragment in found.items():
            if is_file(path):
                return path, fragment
        raise InputError(f"{what}there is no file {source!r}; add it, or correct the source (names are case-sensitive)")

    def _relative(self, source: str, what: str) -> dict[Path, str]:
        """Return the possible meanings of a relative source: a URI, or a plain name that is not encoded."""
        parts = _split(source)
        names = {source: "", parts.path: unquote(parts.fragment), unquote(parts.path): unquote(parts.fragment)}
        found = {Path(os.path.normpath(self.description.parent / name)): names[name] for name in reversed(names)}
        if self.root is not None and not all(path.is_relative_to(self.root) for path in found):
            raise InputError(f"{what}the source {source!r} is outside the package; put the file into it")
        return found

    def inner(self, description: Path, label: str) -> Place:
        """Return the place of another description in this package."""
        return Place(description, self.root, label, self.package, self.unpacked)


def _split(source: str) -> SplitResult:
    """Return the parts of a URI; a text that is not a URI is returned as a path, for which there is no file."""
    try:
        return urlsplit(source)
    except ValueError:
        return SplitResult("", "", source, "", "")


def open_package(path: Path, label: str, description: str = "") -> Place:
    """Unpack an .ssp, or use an .ssd in its folder.

    Args:
        path: Package or description file.
        label: Name of the file for messages.
        description: Description (.ssd) to read from an archive; SystemStructure.ssd by default.

    Raises:
        InputError: The file is missing, is not an archive, is unsafe, or has no such description.
    """
    if path.suffix.lower() == ".ssd":
        if not is_file(path):
            raise InputError(f"{label}: there is no such file")
        file = Path(os.path.normpath(path.absolute()))
        return Place(file, None, label, label)
    with named(path, label):
        unpacked = Unpacked(path)
    name = description or DEFAULT
    file = Path(os.path.normpath(unpacked.folder / name))
    if not (is_file(file) and file.is_relative_to(unpacked.folder)):
        held = sorted(str(p.relative_to(unpacked.folder)) for p in unpacked.folder.rglob("*.ssd"))
        advice = (
            f"it contains {', '.join(held)}: unpack it and run one of these" if held else "it is not an SSP package"
        )
        raise InputError(f"{label}: there is no {name} in the archive; {advice}")
    return Place(file, unpacked.folder, f"{label}: {name}", label, unpacked)


@contextmanager
def named(path: Path, label: str) -> Iterator[None]:
    """Replace the path of an unpacked file in errors by its name in the package."""
    try:
        yield
    except FmuError as error:
        raise FmuError(str(error).replace(str(path), label)) from error


def read_inside(archive: Path, member: str, what: str) -> bytes:
    """Return a file from inside a component's own archive.

    Raises:
        InputError: There is no such file.
    """
    members = read_archive(archive)
    name = os.path.normpath(unquote(_split(member).path)).replace(os.sep, "/")
    if name not in members:
        raise InputError(f"{what}: there is no file {member!r} in {archive.name}; correct the source")
    return members[name]
