"""Safe disk cache for the machine code of numba: damaged files are rebuilt, folders without write access are skipped.

Without these checks numba raises an error for a damaged index, and runs a damaged file of machine code.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
from pathlib import Path
from typing import Any, TypeVar

from numba.core.caching import IndexDataCacheFile
from numba.core.serialize import dumps

Dispatcher = TypeVar("Dispatcher")

_LOG = logging.getLogger(__name__)
_DIGEST = hashlib.sha256().digest_size


def kept(function: Dispatcher) -> Dispatcher:
    """Enable caching of a numba function's machine code on disk, in files with a checksum.

    Args:
        function: Function returned by `numba.njit` without `cache=True`.

    Returns:
        The function itself. If no cache folder is writable, it is compiled in every process.
    """
    dispatcher: Any = function
    try:
        dispatcher.enable_caching()
    except RuntimeError as error:  # neither this folder nor the user's cache folder is writable
        _LOG.warning("machine code cannot be cached and is compiled in every run: %s", error)
        return function
    cache = dispatcher._cache
    cache._cache_file = _CheckedFiles(cache._cache_path, cache._impl.filename_base, cache._cache_file._source_stamp)
    return function


class _CheckedFiles(IndexDataCacheFile):  # type: ignore[misc]
    """Index and machine code files of one function, each preceded by its SHA-256."""

    def __init__(self, cache_path: str, filename_base: str, source_stamp: Any) -> None:
        super().__init__(cache_path, f"{filename_base}.checked", source_stamp)

    def load(self, key: Any) -> Any:
        """Return the data stored under a key; None if they are missing or damaged."""
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
        body = dumps(content)
        try:
            with self._open_for_write(path) as stream:
                stream.write(hashlib.sha256(body).digest() + body)
        except OSError as error:
            _LOG.warning("machine code cannot be cached and is compiled in every run: %s: %s", path, error.strerror)


def _read(path: Path) -> Any:
    """Return the content of a file; None if it is missing, unreadable or damaged."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        _LOG.warning("cached machine code cannot be read and is compiled again: %s: %s", path, error.strerror)
        return None
    body = content[_DIGEST:]
    if hashlib.sha256(body).digest() == content[:_DIGEST]:
        try:
            return pickle.loads(body)
        except Exception:  # intact, but written by a version of numba or eightpost with other class names
            _LOG.info("cached machine code is of another version and is compiled again: %s", path)
            return None
    _LOG.warning("cached machine code is damaged and is compiled again: %s", path)
    return None
