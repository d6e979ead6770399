"""Disk cache of compiled libraries, with keys computed from their sources, so that nothing is compiled twice."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import platformdirs

from eightpost.errors import InputError
from eightpost.files import atomic_path

#: Maximum number of libraries in a folder; those not used for the longest time are removed first.
KEPT = 600

_LOG = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Return the cache folder: EIGHTPOST_CACHE, or the user's cache folder."""
    return Path(os.environ.get("EIGHTPOST_CACHE") or platformdirs.user_cache_path("eightpost"))


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
        content = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):  # the cache may be read-only
        os.utime(path)
    checksum, body = content[:32], content[32:]
    if hashlib.sha256(body).digest() == checksum:
        return body
    _LOG.warning("a cached library is damaged and is compiled again: %s", path)
    return None


def keep(folder: str, key: str, content: bytes) -> None:
    """Store a content in a folder of the cache under a key; if the folder cannot be written, log a warning only."""
    path = cache_folder() / folder / key
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
        _forget_the_oldest(path.parent)
    except (OSError, InputError) as error:
        _LOG.warning("compiled libraries cannot be cached and are compiled in every run: %s", error)


def _forget_the_oldest(folder: Path) -> None:
    entries = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in entries[KEPT:]:
        path.unlink(missing_ok=True)
