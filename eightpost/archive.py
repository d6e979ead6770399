"""Safe reading of zip archives, and reproducible writing: the same content gives the same bytes."""

from __future__ import annotations

import io
import lzma
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO

from eightpost.cache import digest, keep, recall
from eightpost.errors import EightpostError, FmuError, OutputError, missing_file
from eightpost.files import atomic_path, writing
from eightpost.outputs import note_read

#: The earliest date that a zip entry can have. The real date would make every build differ.
_EPOCH = (1980, 1, 1, 0, 0, 0)

#: Limits for an archive that is read: number of entries, unpacked bytes of one entry, unpacked bytes of all entries.
#: FMUs with libraries for six platforms and tables have a few hundred MB.
MOST_ENTRIES, LARGEST_ENTRY, LARGEST_TOTAL = 20_000, 2 * 2**30, 4 * 2**30
#: Maximum ratio of unpacked to stored bytes, for an archive and for each entry larger than `_SMALL` [bytes]: libraries
#: reach 5, text tables 20, and a zip bomb 1000.
LARGEST_RATIO, _SMALL = 200, 64 * 2**20

#: Folder of an FMU for data of tools.
_EXTRA = "extra/"

_PIECE = 2**20  # bytes

#: Number of archives in the cache.
_KEPT = 64

#: Exceptions that zipfile and its decompressors raise for damaged archives.
_DAMAGE = (
    zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, OSError, LookupError,
    NotImplementedError, RuntimeError, ValueError, OverflowError, MemoryError,
)  # fmt: skip


def write_archive(path: str | Path, members: Mapping[str, bytes]) -> None:
    """Write `members` (name with forward slashes -> content) to a zip; the same members give the same bytes.

    Compression takes long, so the last archives are kept in the cache.
    """
    key = digest(part for name in sorted(members) for part in (name, members[name]))
    content = recall("archives", key)
    if content is None:
        content = _packed(members)
        keep("archives", key, content, most=_KEPT)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _packed(members: Mapping[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, date_time=_EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(entry, members[name])
    return content.getvalue()


@contextmanager
def open_archive(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip for reading. The project opens every zip with this function, so that the limits apply to all.

    Yields:
        The archive, with entries within the limits of this module; names and types of entries are not checked.

    Raises:
        FmuError: The file is missing, not a zip, damaged, or beyond a limit; also raised for errors when the block
            reads from the archive.
    """
    path = Path(path)
    note_read(path)
    try:
        if path.is_char_device():  # it may have no end
            raise FmuError(f"{path}: is a device, not a file; name an .fmu file")
        with zipfile.ZipFile(path) as archive:
            _refuse_bomb(path, archive.infolist())
            yield archive
    except EightpostError:
        raise
    except FileNotFoundError:
        what = missing_file(path, "correct the path, or create it first (eightpost build)")
        raise FmuError(f"{path}: {what}") from None
    except _DAMAGE as error:
        why = str(error) or type(error).__name__
        advice = "copy or build it again"
        if not path.suffix.lower().startswith((".fmu", ".ssp", ".zip")):
            advice = "name an .fmu file, which eightpost build makes"
        raise FmuError(f"{path}: the file is not a readable zip archive ({why}); {advice}") from error


def read_archive(path: str | Path) -> dict[str, bytes]:
    """Return every file of a zip: name -> content.

    Raises:
        FmuError: See `open_archive`. Also raised for an entry that would be written outside the folder, and for two
            entries with the same path; the message names the entry.
    """
    with open_archive(path) as archive:
        return {entry.filename: archive.read(entry) for entry in _safe_files(Path(path), archive)}


def extract_archive(
    path: str | Path, folder: str | Path, is_needed: Callable[[str], bool] = lambda _name: True
) -> tuple[str, ...]:
    """Unpack a zip into `folder`. All entries are checked before anything is written.

    Args:
        path: The archive.
        folder: Folder to unpack it into.
        is_needed: Function that returns whether an entry of a name is written; by default all are.

    Returns:
        Notes about entries that were left out, in sentences.

    Raises:
        FmuError: The archive is refused; see `read_archive`.
        OutputError: The folder cannot be written.
    """
    path, folder = Path(path), Path(folder)
    with open_archive(path) as archive:
        files = _safe_files(path, archive)
        for entry in filter(lambda entry: is_needed(entry.filename), files):
            target = folder / entry.filename
            try:
                with writing(target):
                    target.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(entry) as source:
                    _copy(source, target)
            except OutputError as error:
                raise OutputError(f"{path}: cannot be unpacked: {error}") from error
        left_out = sorted(
            {e.filename for e in archive.infolist() if not e.is_dir() and all(e is not file for file in files)}
        )
    return tuple(f"the archive has several entries at {name}; the last one counts" for name in left_out)


def _copy(source: IO[bytes], target: Path) -> None:
    """Copy in pieces, so that the content need not fit into memory. Errors of the target are kept separate."""
    with writing(target):
        stream = target.open("wb")
    with stream:
        while piece := source.read(_PIECE):
            with writing(target):
                stream.write(piece)
        with writing(target):
            stream.flush()


def unsafe_reason(entry: zipfile.ZipInfo) -> str:
    """Return what is wrong with the path or the type of an entry; an empty text if nothing is wrong."""
    name = entry.orig_filename
    parts = PurePosixPath(name).parts
    if "\\" in name:
        return "has a backslash"
    if name.startswith("/") or (parts and ":" in parts[0]):
        return "is absolute"
    if ".." in parts:
        return "leaves the archive"
    if not parts or "\0" in name:
        return "has no name or a NUL character in its name"
    return "is a symbolic link" if stat.S_ISLNK(entry.external_attr >> 16) else ""


def _refuse_bomb(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    """Refuse an archive that would fill memory or disk; zipfile never unpacks more than an entry's declared size."""
    if len(entries) > MOST_ENTRIES:
        raise FmuError(
            f"{path}: has {len(entries)} entries, the limit is {MOST_ENTRIES}; ask its author for a smaller one"
        )
    for entry in entries:
        _refuse_size(f"{path}: the entry {entry.filename!r}", entry.file_size, entry.compress_size, LARGEST_ENTRY)
    unpacked, packed = sum(e.file_size for e in entries), sum(e.compress_size for e in entries)
    _refuse_size(f"{path}: the whole archive", unpacked, packed, LARGEST_TOTAL)


def _refuse_size(what: str, unpacked: int, packed: int, limit: int) -> None:
    advice = "it may be a zip bomb; ask its author for a smaller one"
    if unpacked > limit:
        raise FmuError(f"{what} has an unpacked size of {_mb(unpacked)}, the limit is {_mb(limit)}; {advice}")
    if unpacked > max(_SMALL, LARGEST_RATIO * packed):
        raise FmuError(
            f"{what} has an unpacked size of {_mb(unpacked)} and a stored size of {packed} bytes, the limit is a ratio "
            f"of {LARGEST_RATIO}; {advice}"
        )


def _mb(size: int) -> str:
    return f"{size / 2**20:.0f} MiB"


def _safe_files(path: Path, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """Return the entries that are files; refuse unsafe entries and entries that would overwrite each other.

    Of entries in `extra/`, which belongs to tools and not to the FMU, the last one with a path counts.
    """
    for entry in archive.infolist():
        if reason := unsafe_reason(entry):
            raise FmuError(
                f"{path}: the entry {entry.orig_filename!r} {reason}: it would be written outside its folder, or not "
                "as a regular file; do not open this archive, ask its author for a clean one"
            )
    every = [entry for entry in archive.infolist() if not entry.is_dir()]
    last = {entry.filename: entry for entry in every if entry.filename.startswith(_EXTRA)}
    files = [entry for entry in every if last.get(entry.filename, entry) is entry]
    places = [PurePosixPath(entry.filename) for entry in files]
    folders = {parent for place in places for parent in place.parents}
    taken: set[PurePosixPath] = set()
    for place in places:
        if place in taken or place in folders:
            raise FmuError(f"{path}: has two entries at {str(place)!r}; ask its author for a clean archive")
        taken.add(place)
    return files
