"""Files: replaced whole or not at all, read into checked texts, and known by their digest."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import tomllib
import uuid
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from eightpost.errors import FileFormatError, InputError, OutputError

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Size limit of a file of settings (JSON, TOML, a list of runs) [bytes]. Records have no such limit.
LARGEST_TEXT = 256 * 2**20
#: Nesting limit of tables and lists in a file of settings.
DEEPEST = 64
#: The integers that TOML promises, and that every reader holds: 64 bits with a sign.
_LOWEST, _HIGHEST = -(2**63), 2**63 - 1
#: What Python raises where the parts of a document have other types or sizes than its reader expects.
MALFORMED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
#: Half of a character pair alone: it cannot be written to any file again.
_SURROGATE = re.compile("[\ud800-\udfff]")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path in the folder of `path` that takes its place when the block ends without error.

    A block that raises leaves what was at `path` untouched and no temporary file behind. The temporary name
    keeps the suffix, because some writers look at it.

    Args:
        path: Where the finished file shall be; its folder is made when missing.

    Yields:
        The temporary path to write to.

    Raises:
        OutputError: The file or its folder cannot be written: a full disk, no permission.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.stem}.{uuid.uuid4().hex[:12]}{target.suffix}")
    with writing(target, temporary):
        if target.is_dir():
            raise InputError(f"{target}: is a folder; name a file in it")
        check_output_folder(target.parent)
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def writing(target: Path, *aliases: Path) -> Iterator[None]:
    """Turn the operating system's errors in the block into an OutputError that names a file.

    Args:
        target: The file that the block writes; named where the system's error names none.
        aliases: Temporary paths that stand for the target.

    Raises:
        OutputError: The system refused to write.
    """
    try:
        yield
    except OSError as error:
        named = error.filename
        place = target if named is None or named in {str(alias) for alias in aliases} else named
        raise OutputError(f"{place}: cannot be written ({_reason(error)}); {_advice(error)}") from error


def _reason(error: OSError) -> str:
    return error.strerror or str(error) or type(error).__name__


def _advice(error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return "free space there, or name another file or folder"
    if isinstance(error, PermissionError):
        return "change its permissions, or name another file or folder"
    return "name another file or folder"


def is_file(path: str | Path) -> bool:
    """Return whether there is a file; a path that the system cannot look at, such as an endless name, is none."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def check_output_folder(path: str | Path) -> None:
    """Refuse a folder for output that cannot be one, before any work is done for it.

    Raises:
        InputError: There is a file in its place, or in the place of one of its parents.
    """
    for place in (Path(path), *Path(path).parents):
        if place.exists() and not place.is_dir():
            raise InputError(f"{path}: {place} is a file, no folder for output; name another")


def sha256_of(path: str | Path) -> str:
    """Return the SHA-256 digest of a file's bytes as 64 hexadecimal digits.

    Raises:
        FileFormatError: The file cannot be read.
    """
    with reading(path), Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def reading(path: str | Path, *, advice: str = "") -> Iterator[None]:
    """Turn the operating system's errors in the block into a FileFormatError that names the file.

    Args:
        path: The file that the block reads.
        advice: Advice for the case that there is no such file.

    Raises:
        FileFormatError: The file is missing, a folder, or not permitted to be read, or too large for the memory.
    """
    try:
        yield
    except FileNotFoundError:
        raise FileFormatError(f"there is no such file{advice and ': '}{advice}", path=path) from None
    except OSError as error:
        raise FileFormatError(f"cannot be read: {_reason(error)}", path=path) from error
    except MemoryError as error:
        raise FileFormatError("reading it needs more memory than there is", path=path) from error


def read_bytes(path: str | Path, *, advice: str = "", limit: int = LARGEST_TEXT) -> bytes:
    """Return a file's bytes.

    Args:
        path: The file.
        advice: Advice for the case that there is no such file.
        limit: Size limit [bytes].

    Raises:
        FileFormatError: The file cannot be read, or is larger than the limit.
    """
    with reading(path, advice=advice):
        if "\0" in str(path):
            raise FileNotFoundError
        with Path(path).open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            content = stream.read(limit + 1) if size <= limit else b""
    if max(size, len(content)) > limit:
        what = f"has {max(size, len(content))} bytes, the limit for such a file is {limit}; is it the right file?"
        raise FileFormatError(what, path=path)
    return content


def read_text(path: str | Path, *, advice: str = "") -> str:
    """Return a file's text, which must be UTF-8; a byte order mark is left out.

    Args:
        path: The file.
        advice: Advice for the case that there is no such file.

    Raises:
        FileFormatError: The file cannot be read, or is not UTF-8; the message names the line.
    """
    content = read_bytes(path, advice=advice)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = f"the byte 0x{content[error.start]:02x} is not UTF-8 text; save the file as UTF-8"
        raise FileFormatError(what, path=path, line=content.count(b"\n", 0, error.start) + 1) from error


def document_kind(path: str | Path) -> str | None:
    """Return what a JSON file of ours says it is (`kind`: shock, vehicle ...); None where it does not say."""
    try:
        document = json_content(path)
    except InputError:
        return None  # whoever reads it in full tells what is wrong with it
    kind = document.get("kind") if isinstance(document, dict) else None
    return kind if isinstance(kind, str) else None


def json_content(path: str | Path, *, advice: str = "", finite: bool = True) -> Any:
    """Return what a JSON file says.

    Args:
        path: The file.
        advice: Advice for the case that there is no such file.
        finite: Whether to refuse NaN and infinities, which JSON does not know and some writers write.

    Raises:
        FileFormatError: The file cannot be read or is not JSON, a number is outside 64 bits, or it is nested too
            deeply.
    """
    return parse_json(read_text(path, advice=advice), path, finite=finite)


def parse_json(text: str | bytes, path: str | Path, *, finite: bool = True) -> Any:
    """Return what a JSON text says, as `json_content` does; `path` is named in messages."""

    def constant(name: str) -> NoReturn:
        raise ValueError(f"{name} is no number that can be used")

    def real(digits: str) -> float:
        value = float(digits)
        return constant(digits[:20]) if finite and value in (float("inf"), float("-inf")) else value

    refused = {"parse_constant": constant} if finite else {}
    try:
        content = json.loads(text, parse_int=_integer, parse_float=real, **refused)  # type: ignore[arg-type]
        _check_tree(content)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"cannot be read as JSON: {error.msg}", path=path, line=error.lineno) from error
    except RecursionError as error:
        raise FileFormatError(f"cannot be read as JSON: {_TOO_DEEP}", path=path) from error
    except ValueError as error:
        raise FileFormatError(f"cannot be read as JSON: {error}", path=path) from error
    return content


def toml_content(path: str | Path) -> dict[str, Any]:
    """Return what a TOML file says.

    Raises:
        FileFormatError: The file cannot be read or is not TOML, a number is outside 64 bits, or it is nested too
            deeply.
    """
    return parse_toml(read_text(path), path)


def parse_toml(text: str, path: str | Path) -> dict[str, Any]:
    """Return what a TOML text says, as `toml_content` does; `path` is named in messages."""
    try:
        content = tomllib.loads(text)
        _check_tree(content)
    except RecursionError as error:
        raise FileFormatError(f"cannot be read as TOML: {_TOO_DEEP}", path=path) from error
    except ValueError as error:  # a TOMLDecodeError, or an integer of thousands of digits
        raise FileFormatError(f"cannot be read as TOML: {error}", path=path) from error
    return content


_TOO_DEEP = f"it is nested more than {DEEPEST} levels deep"


def _integer(digits: str) -> int:
    if len(digits) > 20 or not _LOWEST <= (value := int(digits)) <= _HIGHEST:
        raise ValueError(f"the integer {digits[:20]}{'...' if len(digits) > 20 else ''} is outside 64 bits")
    return value


def _check_tree(content: Any) -> None:
    """Refuse what later steps could not hold: deep nesting, integers beyond 64 bits, half characters."""
    level = [content]
    for _ in range(DEEPEST):
        level = [child for node in level for child in _children(node)]
        if not level:
            return
    raise RecursionError


def _children(node: Any) -> list[Any]:
    """Return what is in a table or a list; a number or a text has nothing in it, and is checked."""
    if isinstance(node, dict):
        return [*node, *node.values()]
    if isinstance(node, list):
        return node
    if isinstance(node, str) and _SURROGATE.search(node):
        raise ValueError(f"the text {node[:40]!r} holds half of a character pair")
    if isinstance(node, int) and not _LOWEST <= node <= _HIGHEST:
        raise ValueError("an integer is outside 64 bits")
    return []
