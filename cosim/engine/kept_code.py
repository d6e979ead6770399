"""Store of machine code on disk, so that only the first run on a machine compiles."""

from __future__ import annotations

import hashlib
import logging
import os
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile

import platformdirs

#: Number of files to keep; those that were not used for the longest time are removed first.
KEPT = 40

_LOG = logging.getLogger(__name__)


def recall(key: str) -> bytes | None:
    """Return the machine code stored under a key; None if it is missing or damaged."""
    path = _folder() / key
    try:
        content = path.read_bytes()
        os.utime(path)
    except OSError:
        return None
    checksum, body = content[:32], content[32:]
    if hashlib.sha256(body).digest() == checksum:
        return body
    _LOG.warning("kept machine code is damaged and is compiled again: %s", path)
    return None


def keep(key: str, content: bytes) -> None:
    """Store machine code under a key; do nothing if the folder cannot be written."""
    folder = _folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=folder, delete=False) as file:
            file.write(hashlib.sha256(content).digest() + content)
        Path(file.name).replace(folder / key)
        entries = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        for path in entries[KEPT:]:
            path.unlink(missing_ok=True)


def _folder() -> Path:
    """Return `loop` in EIGHTPOST_CACHE, or in the user's cache folder."""
    return Path(os.environ.get("EIGHTPOST_CACHE") or platformdirs.user_cache_path("eightpost")) / "loop"
