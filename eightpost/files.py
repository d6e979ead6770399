"""Files: replaced whole or not at all, and known by their digest."""

from __future__ import annotations

import hashlib
import json
import tomllib
import uuid
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in the folder of `path` that takes its place when the block ends without error.

    A block that raises leaves what was at `path` untouched and no temporary file behind. The temporary name
    keeps the suffix, because some writers look at it.

    Args:
        path: Where the finished file shall be; its folder is made when missing.

    Yields:
        The temporary path to write to.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file in it")
    check_output_folder(target.parent)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.stem}.{uuid.uuid4().hex[:12]}{target.suffix}")
    try:
        yield temporary
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def check_output_folder(path: str | Path) -> None:
    """Refuse a folder for output that cannot be one, before any work is done for it.

    Raises:
        InputError: There is a file in its place, or in the place of one of its parents.
    """
    for place in (Path(path), *Path(path).parents):
        if place.exists() and not place.is_dir():
            raise InputError(f"{path}: {place} is a file, no folder for output; name another")


def sha256_of(path: str | Path) -> str:
    """Return the SHA-256 digest of a file's bytes as 64 hexadecimal digits."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def document_kind(path: str | Path) -> str | None:
    """Return what a JSON file of ours says it is (`kind`: shock, vehicle ...); None where it does not say."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None  # whoever reads it in full tells what is wrong with it
    return document.get("kind") if isinstance(document, dict) else None


def toml_content(path: Path) -> dict[str, Any]:
    """Return what a TOML file says.

    Raises:
        FileFormatError: There is no such file, or it is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise FileFormatError("there is no such file", path=path) from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileFormatError(f"cannot be read as TOML: {error}", path=path) from error
