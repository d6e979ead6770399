"""TOML files with settings, as pydantic models; messages have the line of the entry."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BeforeValidator, ValidationError
from pydantic_core import PydanticCustomError

from eightpost.errors import FileFormatError, InputError
from eightpost.files import check_schema, parse_toml
from eightpost.schema import WORDS, faults_of, joined, validated
from eightpost.units import convert, quantity

#: Messages for pydantic's error types that differ in a TOML file.
_WORDS = WORDS | dict.fromkeys(("dict_type", "model_type", "dataclass_type"), "must be a table")

Kind = TypeVar("Kind")


def parse_model(
    kind: type[Kind], text: str, path: Path, schema: int = 1, words: Mapping[str, str] | None = None
) -> Kind:
    """Return the content of a TOML text as a type; see `eightpost.schema.checked`.

    Args:
        kind: Type of the content, with an entry `schema`: a model, a dataclass, a typed dictionary.
        text: Text of the file.
        path: Path of the file, for messages.
        schema: Schema that this version reads, also if the file states none.
        words: Messages for pydantic's error types, in place of the usual ones.

    Raises:
        FileFormatError: The text is not TOML, its schema is newer, or an entry is unknown, missing or wrong.
    """
    content: dict[str, Any] = {"schema": schema, **parse_toml(text, path)}
    check_schema(content, schema, path)
    try:
        return validated(kind, content)
    except ValidationError as error:
        faults = [
            (_line_of(text, place), told) for place, told in faults_of(error, kind, words={**_WORDS, **(words or {})})
        ]
        first = faults[0][0]
        told = [told if line in (None, first) else f"line {line}: {told}" for line, told in faults]
        raise FileFormatError(joined(told), path=path, line=first) from error


def in_unit(unit: str) -> BeforeValidator:
    """Return the annotation of a number that a file has in quotes with its unit, in `unit`: `Annotated[float, ...]`."""

    def number(value: object) -> float:
        try:
            if not isinstance(value, str):
                raise InputError(f"is {value!r}")
            return float(convert(*quantity(value), unit))
        except InputError as error:
            what = {"what": str(error).partition(";")[0], "unit": unit}
            advice = 'write a number with its unit in quotes, such as "1.5 {unit}"'
            raise PydanticCustomError("quantity", f"{{what}}; {advice}", what) from error  # type: ignore[arg-type]

    return BeforeValidator(number)


def _line_of(text: str, place: Sequence[str | int]) -> int | None:
    """Return the one-based line of an entry, or the line of its table if the entry itself is not found."""
    lines, begin = text.splitlines(), 0
    found = None
    for depth, key in enumerate(place):
        if isinstance(key, int):
            continue
        position = place[depth + 1] if depth + 1 < len(place) else None
        at = _nth(lines, key, begin, position if isinstance(position, int) else 0)
        if at is not None:
            found = begin = at
        elif found is not None:
            break
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
