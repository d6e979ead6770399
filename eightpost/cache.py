"""Compiled libraries on disk by what they were compiled from, so that nothing is compiled twice."""

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

#: Libraries kept in a folder; the ones not used for longest go first.
KEPT = 600

_LOG = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Return the folder of all that is cached: EIGHTPOST_CACHE, or the user's cache folder."""
    return Path(os.environ.get("EIGHTPOST_CACHE") or platformdirs.user_cache_path("eightpost"))


def digest(parts: Iterable[bytes | str]) -> str:
    """Return a key: equal for equal parts in equal order, and for nothing else."""
    key = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        key.update(len(content).to_bytes(8, "little") + content)
    return key.hexdigest()


def recall(folder: str, key: str) -> bytes | None:
    """Return what was kept in a folder of the cache under a key; None if it is not there or damaged."""
    path = cache_folder() / folder / key
    try:
        content = path.read_bytes()
    except OSError:
        return None
    with suppress(OSError):  # a cache that may be read only
        os.utime(path)
    checksum, body = content[:32], content[32:]
    if hashlib.sha256(body).digest() == checksum:
        return body
    _LOG.warning("kept library is damaged and is compiled again: %s", path)
    return None


def keep(folder: str, key: str, content: bytes) -> None:
    """Keep something in a folder of the cache under a key; where it cannot be written, nothing is kept."""
    path = cache_folder() / folder / key
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
        _forget_the_oldest(path.parent)
    except (OSError, InputError) as error:
        _LOG.warning("compiled libraries are not kept and are compiled in every run: %s", error)


def _forget_the_oldest(folder: Path) -> None:
    entries = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in entries[KEPT:]:
        path.unlink(missing_ok=True)
