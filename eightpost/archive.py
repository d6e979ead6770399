"""Zip archives that are safe to open and the same bytes each time they are written."""

from __future__ import annotations

import stat
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from eightpost.errors import FmuError
from eightpost.files import atomic_path

#: The earliest date a zip entry can carry: a real one would make every build differ.
_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_archive(path: str | Path, members: Mapping[str, bytes]) -> None:
    """Write `members` (name with forward slashes -> content) as a zip; the same members give the same bytes."""
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive,
    ):
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, date_time=_EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(entry, members[name])


def read_archive(path: str | Path) -> dict[str, bytes]:
    """Return every file of a zip: name -> content.

    Raises:
        FmuError: Missing, not a zip, damaged, or with an entry that would land outside a folder; the message says
            which.
    """
    path = Path(path)
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                _refuse_unsafe(path, entry)
            return {entry.filename: archive.read(entry) for entry in archive.infolist() if not entry.is_dir()}
    except FileNotFoundError:
        raise FmuError(f"{path}: there is no such file; mend the path, or make it first (eightpost build)") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, RuntimeError) as error:
        raise FmuError(f"{path}: is not a readable zip archive ({error}); copy or build it again") from error


def extract_archive(path: str | Path, folder: str | Path) -> None:
    """Unpack a zip into `folder`, refusing what `read_archive` refuses before anything is written."""
    for name, content in read_archive(path).items():
        target = Path(folder) / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)


def _refuse_unsafe(path: Path, entry: zipfile.ZipInfo) -> None:
    name = PurePosixPath(entry.filename)
    if name.is_absolute() or ".." in name.parts or "\\" in entry.orig_filename or ":" in name.parts[0]:
        raise FmuError(
            f"{path}: the entry {entry.orig_filename!r} would be written outside its folder or has a backslash or a "
            "drive letter; do not open this file, ask its maker for a clean one"
        )
    if stat.S_ISLNK(entry.external_attr >> 16):
        raise FmuError(f"{path}: the entry {entry.filename!r} is a symbolic link; ask its maker for a clean file")
