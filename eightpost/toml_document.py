"""TOML files with settings, as pydantic models; messages have the line of the entry."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from eightpost.errors import FileFormatError
from eightpost.files import check_schema, parse_toml
from eightpost.schema import WORDS

#: Messages for pydantic's error types that differ in a TOML file.
_WORDS = {**WORDS, "dict_type": "must be a table", "model_type": "must be a table"}

Model = TypeVar("Model", bound=BaseModel)


def parse_model(
    model: type[Model], text: str, path: Path, schema: int, words: Mapping[str, str] | None = None
) -> Model:
    """Return the content of a TOML text as a model.

    Args:
        model: Type of the content, with an entry `schema`.
        text: Text of the file.
        path: Path of the file, for messages.
        schema: Schema that this version reads, also if the file states none.
        words: Messages for pydantic's error types, in place of pydantic's own.

    Raises:
        FileFormatError: The text is not TOML, its schema is newer, or an entry is unknown, missing or wrong.
    """
    content: dict[str, Any] = {"schema": schema, **parse_toml(text, path)}
    check_schema(content, schema, path)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        faults = [(fault["loc"], _message(model, words or {}, fault)) for fault in error.errors()]
        (first, what), *others = faults
        what = "; ".join([what, *(f"{_line(text, place)}{other}" for place, other in others)])
        raise FileFormatError(what, path=path, line=_line_of(text, first)) from error


def _message(model: type[BaseModel], words: Mapping[str, str], fault: Any) -> str:
    """Return what is wrong with an entry; of an unknown one also the similar entries, at any level of the model."""
    told = words.get(fault["type"]) or _WORDS.get(fault["type"], fault["msg"])
    what = f"{'.'.join(map(str, fault['loc']))}: {told}"
    if fault["type"] != "extra_forbidden":
        return what
    schema = model.model_json_schema()
    known = {name for part in (schema, *schema.get("$defs", {}).values()) for name in part.get("properties", ())}
    name = str(fault["loc"][-1])
    close = get_close_matches(name, sorted(known - {name}), cutoff=0.75)
    return f"{what}; did you mean {', '.join(close)}?" if close else what


def _line(text: str, place: Sequence[str | int]) -> str:
    line = _line_of(text, place)
    return f"line {line}: " if line else ""


def _line_of(text: str, place: Sequence[str | int]) -> int | None:
    """Return the one-based line of an entry, or the line of its table if the entry itself is not found."""
    lines, begin = text.splitlines(), 0
    found = None
    for depth, key in enumerate(place):
        if isinstance(key, int):
            continue
        position = place[depth + 1] if depth + 1 < len(place) else None
        at = _nth(lines, key, begin, position if isinstance(position, int) else 0)
        if at is None:
            break
        found = begin = at
    return None if found is None else found + 1


def line_with(text: str, message: str) -> int | None:
    """Return the one-based line that a message refers to: the last quoted name in it that the file contains.

    A name may be a text of the file, or a key that occurs once. The text after a semicolon is advice and is ignored.
    """
    lines = text.splitlines()
    for name in reversed(re.findall(r"'([^']+)'", message.partition(";")[0])):
        quoted = [number for number, line in enumerate(lines, 1) if f'"{name}"' in line or f"'{name}'" in line]
        keys = [number for number, line in enumerate(lines, 1) if re.match(rf"\s*{re.escape(name)}\s*=", line)]
        if quoted or len(keys) == 1:
            return (quoted or keys)[0]
    return None


def _nth(lines: Sequence[str], key: str, begin: int, position: int) -> int | None:
    """Return the line of a key, of a table's header, or of the `position`-th table of a list, from `begin` on."""
    name = rf"(?:\"{re.escape(key)}\"|'{re.escape(key)}'|{re.escape(key)})"
    pattern = re.compile(rf"\s*(?:\[\[?\s*(?:[^\[\]]*\.\s*)?{name}\s*\]|{name}\s*[=.]|.*[{{,]\s*{name}\s*=)")
    found = [k for k in range(begin, len(lines)) if pattern.match(lines[k])]
    if not found:
        return None
    return found[position] if position < len(found) and lines[found[0]].lstrip().startswith("[[") else found[0]
