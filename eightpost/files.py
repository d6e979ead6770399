"""Files: atomic writing, checked reading, schema numbers, digests, and cells that are safe in spreadsheets."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn

from eightpost.errors import FileFormatError, InputError, OutputError, missing_file
from eightpost.marks import mark, remove_left
from eightpost.outputs import check_folder, check_same_content, check_target, note_read, note_written

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


# ---- Files ----------------------------------------------------------------------------------------------------------

#: Size limit of a file with settings (JSON, TOML, a list of runs) [bytes]. Records have no such limit.
LARGEST_TEXT = 256 * 2**20
#: Nesting limit of tables and lists in a file with settings.
DEEPEST = 64
#: Range of integers that TOML guarantees and that every reader supports: signed 64-bit.
_LOWEST, _HIGHEST = -(2**63), 2**63 - 1
#: Exceptions that Python raises if parts of a document have other types or sizes than the code expects.
MALFORMED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
#: A lone surrogate (half of a character pair), which cannot be written to a file.
_SURROGATE = re.compile("[\ud800-\udfff]")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, and rename it to `path` if the block ends without error.

    Everything is written with this function, so that the rule of `eightpost.outputs` applies to all files: none
    replaces a folder, an input of the running command, or a file of another kind. If the block raises, the old file at
    `path` is unchanged and the temporary file is removed; that of a killed process is removed by the next one that
    writes the same file. The temporary name has the same suffix as `path`, because
    some writers choose the format by it.

    Args:
        path: Path of the finished file; its folder is created if it is missing.

    Yields:
        The temporary path to write to.

    Raises:
        InputError: The path is a folder, an input or a file of another kind.
        OutputError: The file or its folder cannot be written, for example a full disk or no permission.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.stem}.{mark()}{target.suffix}")
    with writing(target, temporary):
        check_target(target)
        check_folder(target.parent)
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_left(target.parent, f".{target.stem}.", target.suffix)
        try:
            yield temporary
            check_same_content(target, temporary)
            temporary.replace(target)
            note_written(target)
        finally:
            temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file with `atomic_path`; return its path."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


@contextmanager
def writing(target: Path, *aliases: Path) -> Iterator[None]:
    """Turn the operating system's errors in the block into an OutputError that names a file.

    Args:
        target: File that the block writes; named in the message if the system's error names no file.
        aliases: Temporary paths of the target; messages name the target instead.

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
        return "free space there, or choose another file or folder"
    if isinstance(error, PermissionError):
        return "change its permissions, or choose another file or folder"
    return "choose another file or folder"


def is_file(path: str | Path) -> bool:
    """Return whether a file exists; false for a path that the system cannot check, such as one that is too long."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


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

    The file counts as an input of the running command.

    Args:
        path: File that the block reads.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file is missing, a folder, a device, without read permission, or too large for the memory.
    """
    note_read(path)
    try:
        if Path(path).is_char_device():  # it may have no end
            raise FileFormatError("is a device, not a file; name a file", path=path)
        yield
    except FileNotFoundError:
        raise FileFormatError(missing_file(path, advice), path=path) from None
    except IsADirectoryError:
        raise FileFormatError("is a folder, not a file; name a file in it", path=path) from None
    except OSError as error:
        raise FileFormatError(f"cannot be read: {_reason(error)}", path=path) from error
    except MemoryError as error:
        raise FileFormatError("reading it needs more memory than is available", path=path) from error


def read_bytes(path: str | Path, *, advice: str = "", limit: int = LARGEST_TEXT) -> bytes:
    """Return a file's bytes.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.
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
        what = f"has {max(size, len(content))} bytes, the limit is {limit}; check that it is the right file"
        raise FileFormatError(what, path=path)
    return content


def read_text(path: str | Path, *, advice: str = "") -> str:
    """Return the text of a UTF-8 file without its byte order mark.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file cannot be read, or is not UTF-8; the message names the line, unless it is no text.
    """
    content = read_bytes(path, advice=advice)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in content:
            raise FileFormatError("is not a text file, which is needed here", path=path) from error
        what = f"the byte 0x{content[error.start]:02x} is not UTF-8 text; save the file as UTF-8"
        raise FileFormatError(what, path=path, line=content.count(b"\n", 0, error.start) + 1) from error


def document_kind(path: str | Path) -> str | None:
    """Return the entry `kind` (shock, vehicle ...) of a JSON file written by eightpost; None if it has none."""
    try:
        document = json_content(path)
    except InputError:
        return None  # the caller that reads the whole file reports the error
    kind = document.get("kind") if isinstance(document, dict) else None
    return kind if isinstance(kind, str) else None


def json_content(path: str | Path, *, advice: str = "", finite: bool = True) -> Any:
    """Return the content of a JSON file.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.
        finite: Whether to refuse NaN and infinities, which are not part of JSON but which some programs write.

    Raises:
        FileFormatError: The file cannot be read or is not JSON, has an entry twice or a number outside 64 bits, or is
            nested too deeply.
    """
    return parse_json(read_text(path, advice=advice), path, finite=finite)


def parse_json(text: str | bytes, path: str | Path, *, finite: bool = True) -> Any:
    """Return the content of a JSON text, like `json_content`; `path` is used in messages.

    Raises:
        FileFormatError: The text is empty or is not JSON, a number is outside 64 bits, or it is nested too deeply.
    """

    def constant(name: str) -> NoReturn:
        raise ValueError(f"{name} is not a finite number")

    def real(digits: str) -> float:
        value = float(digits)
        return constant(digits[:20]) if finite and value in (float("inf"), float("-inf")) else value

    if not text.strip():
        raise FileFormatError(_EMPTY, path=path)
    refused = {"parse_constant": constant} if finite else {}
    try:
        content = json.loads(text, parse_int=_integer, object_pairs_hook=_object,
                             parse_float=real, **refused)  # type: ignore[arg-type] # fmt: skip
        _check_tree(content)
    except json.JSONDecodeError as error:
        raise FileFormatError(f"cannot be read as JSON: {error.msg}", path=path, line=error.lineno) from error
    except RecursionError as error:
        raise FileFormatError(f"cannot be read as JSON: {_TOO_DEEP}", path=path) from error
    except ValueError as error:
        raise FileFormatError(f"cannot be read as JSON: {error}", path=path) from error
    return content


def toml_content(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        FileFormatError: The file cannot be read or is not TOML, a number is outside 64 bits, or it is nested too
            deeply.
    """
    return parse_toml(read_text(path), path)


def parse_toml(text: str, path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML text, like `toml_content`; `path` is used in messages.

    Raises:
        FileFormatError: The text is empty or is not TOML, a number is outside 64 bits, or it is nested too deeply.
    """
    if not text.strip():
        raise FileFormatError(_EMPTY, path=path)
    try:
        content = tomllib.loads(text)
        _check_tree(content)
    except RecursionError as error:
        raise FileFormatError(f"cannot be read as TOML: {_TOO_DEEP}", path=path) from error
    except ValueError as error:  # a TOMLDecodeError, or an integer with thousands of digits
        if Path(path).suffix.lower() in (".csv", ".json", ".parquet", ".fmu", ".mat", ".txt"):
            raise FileFormatError(f"is a {Path(path).suffix} file; a .toml file is needed here", path=path) from error
        raise FileFormatError(f"cannot be read as TOML: {error}", path=path) from error
    return content


def check_schema(
    content: Mapping[str, Any], newest: int, path: str | Path | None, *, key: str = "schema", what: str = ""
) -> None:
    """Check the schema number of a document that eightpost wrote or documents.

    Args:
        content: Content of the document.
        newest: Newest schema that this version reads; it is also the one that it writes.
        path: Path of the file, for the message; None for a part of a document.
        key: Entry with the number.
        what: Name of the part of a document.

    Raises:
        FileFormatError: The number is missing, is not a number, or is newer.
    """
    name, found = f"{what} {key}".strip().replace("_", " "), content.get(key)
    if found is None and not content.keys() & {"kind", "name", "model", "parameters"}:
        keys = ", ".join(map(repr, list(content)[:5])) or "nothing"
        raise FileFormatError(f"is not a file that eightpost wrote or documents: it contains {keys}", path=path)
    if found is None:
        raise FileFormatError(f"{name} is missing; write {key} = {newest}", path=path)
    if type(found) is not int or found < 1:
        raise FileFormatError(
            f"{name} is {found!r}, but must be a whole number of 1 or more; write {key} = {newest}", path=path
        )
    if found > newest:
        version = content.get("tool_version")
        tool = content.get("tool") or (version and f"eightpost {version}")
        raise FileFormatError(
            f"has {name} {found}{f' (written by {tool})' if tool else ''}, but this version reads schema {newest}: a "
            "newer version wrote the file; update eightpost",
            path=path,
        )


_EMPTY = "is empty; write it again, or name another file"
_TOO_DEEP = f"it is nested more than {DEEPEST} levels deep"


def _object(entries: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for name, value in entries:
        if name in content:
            raise ValueError(f"the entry {name!r} appears twice; keep one")
        content[name] = value
    return content


def _integer(digits: str) -> int:
    if len(digits) > 20 or not _LOWEST <= (value := int(digits)) <= _HIGHEST:
        raise ValueError(f"the integer {digits[:20]}{'...' if len(digits) > 20 else ''} is outside 64 bits")
    return value


def _check_tree(content: Any) -> None:
    """Refuse content that later steps cannot handle: deep nesting, integers beyond 64 bits, lone surrogates."""
    level = [content]
    for _ in range(DEEPEST):
        level = [child for node in level for child in _children(node)]
        if not level:
            return
    raise RecursionError


def _children(node: Any) -> list[Any]:
    """Return the elements of a table or a list; check a number or a text, which has no elements."""
    if isinstance(node, dict):
        return [*node, *node.values()]
    if isinstance(node, list):
        return node
    if isinstance(node, str) and _SURROGATE.search(node):
        raise ValueError(f"the text {node[:40]!r} contains half of a character pair (a lone surrogate)")
    if isinstance(node, int) and not _LOWEST <= node <= _HIGHEST:
        raise ValueError("an integer is outside 64 bits")
    return []


# ---- CSV cells that are safe in spreadsheets ------------------------------------------------------------------------
# A cell such as `=cmd|...` can run a program when a spreadsheet opens the file. Numbers such as -1.5 are not changed.
# `plain_cell` removes the apostrophe.

#: Beginning of a formula, after apostrophes that belong to the text; some spreadsheets also accept full-width signs.
_FORMULA = re.compile("'*[=+\\-@\t\r\n＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: A cell within a line that begins like a formula.
_CELLS = re.compile("(?:^|(?<=[,;\t]))(?='*[=+\\-@\r＝＋－＠])([^,;\t]*)")
_QUOTED = frozenset(',;"\t\r\n')


def safe_cell(text: str) -> str:
    """Return a text as a cell that no spreadsheet interprets as a formula.

    >>> safe_cell("=1+1"), safe_cell("-1.5"), safe_cell("-x")
    ("'=1+1", '-1.5', "'-x")
    """
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def plain_cell(cell: str) -> str:
    """Return the original text of a cell written by `safe_cell`.

    >>> plain_cell("'=1+1"), plain_cell("'tis")
    ('=1+1', "'tis")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def safe_line(line: str) -> str:
    """Return a line of free text, which a spreadsheet may split into several cells, with each cell made safe."""
    return _CELLS.sub(lambda found: safe_cell(found[1]), line)


def quoted_cell(text: str) -> str:
    """Return a text as a safe cell, quoted if it contains a delimiter (`,`, `;`, tab), a quote or a line break."""
    cell = safe_cell(text)
    return '"' + cell.replace('"', '""') + '"' if _QUOTED & set(cell) else cell


def write_rows(stream: IO[str], rows: Iterable[Sequence[str]], *, end: str = "\n") -> None:
    """Write rows of texts as comma-separated lines; `end` is the line ending."""
    stream.writelines(f"{','.join(map(quoted_cell, row))}{end}" for row in rows)
