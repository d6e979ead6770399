"""What an output must never replace: a file that the command reads, a file of another kind, or a folder.

`eightpost.files.atomic_path`, with which everything is written, applies the rule to every file. `check_file` and
`check_folder` apply it to the outputs that a command line names, before anything is computed.

Every reader passes through `eightpost.files.reading` or `eightpost.archive.open_archive`, which record the file while a
command runs. Therefore files count as inputs that only a table, a system or a study names, and a new reader or a new
option cannot be forgotten. A command that rewrites what it has read says so with `replacing`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from eightpost.errors import InputError, OutputError

# ---- Kinds of files -------------------------------------------------------------------------------------------------

_TEXT, _BINARY, _HTML, _SVG = "a text file", "a binary file", "an HTML page", "an SVG picture"
_PNG, _PDF, _ZIP, _PARQUET, _MATLAB = "a PNG picture", "a PDF file", "a zip archive", "a Parquet file", "a MATLAB file"

#: Content by the first bytes.
_MAGIC = {b"\x89PNG\r\n\x1a\n": _PNG, b"%PDF-": _PDF, b"PK\x03\x04": _ZIP, b"PAR1": _PARQUET, b"MATLAB ": _MATLAB}
#: Content by the suffix, where it is not text.
_CONTENT = {
    ".png": _PNG, ".pdf": _PDF, ".svg": _SVG, ".html": _HTML, ".htm": _HTML, ".parquet": _PARQUET, ".mat": _MATLAB,
    ".fmu": _ZIP, ".ssp": _ZIP,
}  # fmt: skip
#: Number of bytes by which a content is recognised.
_HEAD = 4096


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file that commands write."""

    name: str  #: Name with its article.
    example: str  #: Name of a file, which messages propose.
    #: Suffixes that the file may have; empty if an option chooses the format, so that it is known only when the file is
    #: written.
    suffixes: tuple[str, ...]
    document: str = ""  #: Entry `kind` of a JSON document; empty for other files.

    def content(self, suffix: str) -> str:
        """Return the content of a file of this kind in words, as `_content_of` does."""
        return _json(self.document) if self.document else _CONTENT.get(suffix.lower(), _TEXT)


AIM = Kind("the curves to aim at", "shapes.json", (".json",), "shapes")
FMU = Kind("an FMU", "car.fmu", (".fmu",))
PACKAGE = Kind("an SSP package", "car.ssp", (".ssp",))
PAGE = Kind("a page", "report.html", (".html", ".htm"))
PICTURE = Kind("a picture", "picture.png", (".png", ".pdf", ".svg"))
RECORD = Kind("a record", "record.parquet", (".parquet", ".csv"))
RESULT = Kind("the result of a run", "result.json", (".json",), "result")
SHOCK = Kind("a shock file", "shock.json", (".json",), "shock")
TABLE = Kind("a table", "table.parquet", (".parquet",))
VEHICLE = Kind("a vehicle file", "vehicle.json", (".json",), "vehicle")
EXPORT = Kind("an exported file", "export.mat", ())


def _content_of(path: Path) -> str:
    """Return in words what a file contains; an empty text for an empty file."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if known := next((content for magic, content in _MAGIC.items() if head.startswith(magic)), ""):
        return known
    if b"\0" in head:
        return _BINARY
    text = head.decode("utf-8-sig", "replace").lstrip().lower()
    if text.startswith("<"):
        return _HTML if "<html" in text else _SVG if "<svg" in text else "an XML file"
    if text.startswith(("{", "[")):
        with suppress(ValueError, RecursionError):  # a table of TOML also begins with a bracket
            document = json.loads(path.read_bytes())
            return _json(str(document.get("kind", "")) if isinstance(document, dict) else "")
    return _TEXT if head else ""


def _json(kind: str) -> str:
    return f"a JSON file of the kind {kind!r}" if kind else "a JSON file"


# ---- Files that the running command read and wrote ------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Command:
    """Files of the running command, each by its device and number, which all of its names share."""

    read: set[tuple[int, int]] = field(default_factory=set)
    written: set[tuple[int, int]] = field(default_factory=set)


_running: list[_Command] = []
_replaced: list[set[Path]] = []


@contextmanager
def recorded(inputs: Iterable[Path]) -> Iterator[None]:
    """Record what is read and written in the block, so that no output replaces an input.

    Args:
        inputs: Files that the command line names, which are not read yet.
    """
    _running.append(_Command())
    try:
        for path in inputs:
            note_read(path)
        yield
    finally:
        _running.pop()


def note_read(path: str | Path) -> None:
    """Record that the running command reads a file; its own output is no input."""
    if _running and (identity := _identity(path)) and identity not in _running[-1].written:
        _running[-1].read.add(identity)


def note_written(path: str | Path) -> None:
    """Record that the running command wrote a file."""
    if _running and (identity := _identity(path)):
        _running[-1].written.add(identity)


def is_input(path: Path) -> bool:
    """Return whether the running command has read a file, or its command line names it as an input."""
    identity = _identity(path)
    # a number is given again to a new file when its old file was replaced
    return bool(_running) and identity in _running[-1].read and identity not in _running[-1].written


def _identity(path: str | Path) -> tuple[int, int] | None:
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        return status.st_dev, status.st_ino
    return None


@contextmanager
def replacing(*paths: str | Path) -> Iterator[None]:
    """Let the block replace files that the command has read, whatever is in them: an update, or of what was kept."""
    _replaced.append({Path(path) for path in paths})
    try:
        yield
    finally:
        _replaced.pop()


def _may_replace(path: Path) -> bool:
    return any(path in paths for paths in _replaced)


# ---- The rule -------------------------------------------------------------------------------------------------------


def check_file(path: Path, kind: Kind, option: str = "") -> None:
    """Check that a file of some kind can be written without loss, before any computation.

    Args:
        path: File to write.
        kind: Kind of the file.
        option: Option that names the file, for the message; empty for an argument of a function.

    Raises:
        InputError: The path is a folder, an input of the running command or a file of another kind, its suffix is not
            that of the kind, or one of its parents is a file.
        OutputError: Its nearest existing folder is read-only.
    """
    check_target(path, example=kind.example)
    if kind.suffixes and path.suffix.lower() not in kind.suffixes:
        *others, last = kind.suffixes
        ends = f"{', '.join(others)} or {last}" if others else last
        proposed = path.with_suffix(Path(kind.example).suffix)
        raise InputError(f"{path}: {kind.name} ends in {ends}; write {f'{option} {proposed}'.strip()}")
    check_folder(path.parent)
    if kind.suffixes:
        _check_content(path, kind.content(path.suffix))


def check_folder(path: str | Path, files: Mapping[str, Kind] | None = None) -> None:
    """Check that a path can be used as an output folder, before any computation.

    Args:
        path: Folder to write into; it need not exist.
        files: Kinds of the files that will be written there, by name.

    Raises:
        InputError: The path or one of its parents is a file, or a file there cannot be replaced; see `check_file`.
        OutputError: Its nearest existing folder is read-only.
    """
    places = (Path(path), *Path(path).parents)
    if (nearest := next((place for place in places if place.is_dir()), None)) and not os.access(nearest, os.W_OK):
        raise OutputError(f"{nearest} is read-only; change its permissions, or choose another output folder")
    for place in places:
        if place.exists() and not place.is_dir():
            where = "" if place == Path(path) else f"{path}: "
            raise InputError(f"{where}{place} is a file, not a folder; choose another output folder")
    for name, kind in (files or {}).items():
        check_target(Path(path, name))
        _check_content(Path(path, name), kind.content(Path(name).suffix))


def check_target(path: Path, *, example: str = "") -> None:
    """Check that a path is neither a folder nor an input of the running command.

    Raises:
        InputError: It is one of them, or a device.
    """
    if path.is_dir():
        such = f", such as {path / example}" if example else ""
        raise InputError(f"{path} is a folder; name a file in it{such}")
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is a device or a pipe; choose another output")
    if is_input(path) and not _may_replace(path):
        raise InputError(f"{path} is an input of this command and would be replaced; choose another output")


def check_same_content(path: Path, new: Path) -> None:
    """Check that a file has the same kind of content as a new file that is about to replace it.

    Raises:
        InputError: The file has another content.
    """
    if path.is_file():
        _check_content(path, _content_of(new))


def _check_content(path: Path, content: str) -> None:
    if not path.is_file() or _may_replace(path):
        return
    found = _content_of(path)
    if found and found != content:
        raise InputError(
            f"{path} is {found}, and {content or 'an empty file'} would replace it; choose another output, or delete "
            "that file first"
        )
