"""Disk cache of compiled code, so that nothing is compiled twice: libraries, the loop's object files, numba's code.

Every file begins with the SHA-256 of its content. A damaged file is compiled again, and a folder without write access
is skipped, both with a warning: numba by itself raises an error for a damaged index and runs damaged machine code. A
checksum is no signature: what another user may have written is not run.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import stat
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import platformdirs

from eightpost.errors import InputError
from eightpost.extras import needs
from eightpost.files import atomic_path
from eightpost.outputs import replacing

Dispatcher = TypeVar("Dispatcher")

#: Maximum number of libraries in a folder; those not used for the longest time are removed first.
KEPT = 600

_LOG = logging.getLogger(__name__)
_DIGEST = hashlib.sha256().digest_size


def _sealed(content: bytes) -> bytes:
    return hashlib.sha256(content).digest() + content


def _unsealed(content: bytes) -> bytes | None:
    """Return the content of a file without its checksum; None if it is damaged."""
    body = content[_DIGEST:]
    return body if hashlib.sha256(body).digest() == content[:_DIGEST] else None


# ---- Libraries and object files under keys computed from their sources ----------------------------------------------


def cache_folder() -> Path:
    """Return the cache folder: EIGHTPOST_CACHE, or the user's cache folder."""
    return Path(os.environ.get("EIGHTPOST_CACHE") or platformdirs.user_cache_path("eightpost"))


def _is_trusted(path: Path, others: int = stat.S_IWGRP | stat.S_IWOTH) -> bool:
    """Return whether nobody but this user and root can have written a file; always true on Windows."""
    if sys.platform == "win32":
        return True
    else:
        states = [place.stat() for place in (path, path.parent)]
        return not any(state.st_uid not in (os.geteuid(), 0) or state.st_mode & others for state in states)


def digest(parts: Iterable[bytes | str]) -> str:
    """Return a key that is equal only for equal parts in the same order."""
    key = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        key.update(len(content).to_bytes(8, "little") + content)
    return key.hexdigest()


def recall(folder: str, key: str) -> bytes | None:
    """Return the content stored in a folder of the cache under a key; None if it is missing or damaged."""
    path = cache_folder() / folder / key
    try:
        content, trusted = path.read_bytes(), _is_trusted(path)
    except OSError:
        return None
    if not trusted:
        _LOG.warning("a cached library that another user may have written is compiled again: %s", path)
        return None
    with suppress(OSError):  # the cache may be read-only
        os.utime(path)
    if (body := _unsealed(content)) is None:
        _LOG.warning("a cached library is damaged and is compiled again: %s", path)
    return body


def keep(folder: str, key: str, content: bytes, *, most: int | None = None) -> None:
    """Store a content in a folder of the cache under a key; if the folder cannot be written, log a warning only.

    Args:
        folder: Folder in the cache.
        key: Name of the file.
        content: Content.
        most: Maximum number of files in the folder; None for KEPT.
    """
    path = cache_folder() / folder / key
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.parent.chmod(0o700)
        with replacing(path), atomic_path(path) as temporary:  # a damaged file has any content
            temporary.write_bytes(_sealed(content))
            temporary.chmod(0o600)
        entries = sorted(path.parent.iterdir(), key=_last_use, reverse=True)
        for old in entries[most or KEPT :]:
            old.unlink(missing_ok=True)
    except (OSError, InputError) as error:
        _LOG.warning("compiled libraries cannot be cached and are compiled in every run: %s", error)


def _last_use(path: Path) -> float:
    """Return when a file was used last [s]; 0 if another process has just renamed or removed it."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


# ---- numba's own cache ----------------------------------------------------------------------------------------------


def kept(function: Dispatcher, number: int = 0) -> Dispatcher:
    """Enable caching of a numba function's machine code on disk, in files with a checksum.

    Args:
        function: Function returned by `numba.njit` without `cache=True`.
        number: Number that changes with the files, other than its own, that the function's code comes from.

    Returns:
        The function itself. If no cache folder is writable, it is compiled in every process.
    """
    dispatcher: Any = function
    try:
        dispatcher.enable_caching()
    except RuntimeError as error:  # neither this folder nor the user's cache folder is writable
        _LOG.warning("machine code cannot be cached and is compiled in every run: %s", error)
        return function
    numbas = dispatcher._cache
    files = _checked_files()
    stamp = (numbas._cache_file._source_stamp, number)
    numbas._cache_file = files(numbas._cache_path, numbas._impl.filename_base, stamp)
    return function


@cache
def _checked_files() -> Any:
    """Return the class of the index and machine code files of one numba function, each preceded by its SHA-256."""
    with needs("fit", "machine code"):
        from numba.core.caching import IndexDataCacheFile  # noqa: PLC0415 - takes long, and most users need no numba
        from numba.core.serialize import dumps  # noqa: PLC0415

    class CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]
        def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
            super().__init__(cache_path, f"{filename_base}.checked", source_stamp)

        def load(self, key: Any) -> Any:
            name = self._load_index().get(key)
            return None if name is None else _read(Path(self._data_path(name)))

        def _load_index(self) -> dict[Any, str]:
            found = _read(Path(self._index_path))
            if not isinstance(found, tuple) or found[:2] != (self._version, self._source_stamp):
                return {}
            overloads: dict[Any, str] = found[2]
            return overloads

        def _save_index(self, overloads: dict[Any, str]) -> None:
            self._write(self._index_path, (self._version, self._source_stamp, overloads))

        def _save_data(self, name: str, data: Any) -> None:
            self._write(self._data_path(name), data)

        def _write(self, path: str, content: Any) -> None:
            try:
                with self._open_for_write(path) as stream:
                    stream.write(_sealed(dumps(content)))
            except OSError as error:
                what = "machine code cannot be cached and is compiled in every run"
                _LOG.warning("%s: %s: %s", what, path, error.strerror)

    return CheckedFiles


def _read(path: Path) -> Any:
    """Return the content of one of numba's files; None if it is missing, unreadable or damaged."""
    try:
        if not _is_trusted(path, stat.S_IWOTH):  # the group may write: numba's files are beside the sources
            _LOG.warning("cached machine code that another user may have written is compiled again: %s", path)
            return None
        body = _unsealed(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        _LOG.warning("cached machine code cannot be read and is compiled again: %s: %s", path, error.strerror)
        return None
    if body is None:
        _LOG.warning("cached machine code is damaged and is compiled again: %s", path)
        return None
    try:
        return pickle.loads(body)
    except Exception:  # intact, but written by a version of numba or eightpost with other class names
        _LOG.info("cached machine code is of another version and is compiled again: %s", path)
        return None
