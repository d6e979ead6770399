"""Compiled libraries by what they were compiled from, so that nothing is compiled twice."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import platformdirs

from eightpost.errors import InputError
from eightpost.files import atomic_path

#: Libraries kept; the ones not used for longest go first.
KEPT = 600


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


def recall(key: str) -> bytes | None:
    """Return what was kept under a key; nothing if it is not there or damaged."""
    path = _path(key)
    try:
        content = path.read_bytes()
        os.utime(path)
    except OSError:
        return None
    checksum, body = content[:32], content[32:]
    return body if hashlib.sha256(body).digest() == checksum else None


def keep(key: str, content: bytes) -> None:
    """Keep something under a key; where the folder cannot be written, nothing is kept."""
    path = _path(key)
    with suppress(OSError, InputError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
        _forget_the_oldest(path.parent)


def _path(key: str) -> Path:
    return cache_folder() / "binaries" / key


def _forget_the_oldest(folder: Path) -> None:
    entries = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in entries[KEPT:]:
        path.unlink(missing_ok=True)
