"""Types of the entries of documents that eightpost reads: one check for JSON and TOML files and for parts of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ConfigDict, ValidationError, create_model

from eightpost.errors import FileFormatError

#: Messages for pydantic's error types, in words of a reader of the file.
WORDS = {
    "extra_forbidden": "is not an entry of this file",
    "unexpected_keyword_argument": "is not an entry of this file",
    "missing": "is missing",
    "dict_type": "must be an object",
    "model_type": "must be an object",
    "dataclass_type": "must be an object",
    "string_type": "must be a text",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "bool_type": "must be true or false",
    "finite_number": "must be a finite number",
}
#: Error types whose message does not need the value.
_WITHOUT_VALUE = ("extra_forbidden", "unexpected_keyword_argument", "missing")
#: Faults that a message lists, and characters of a value.
_LISTED, _SHOWN = 3, 60

#: An object with entries of which only some have a known type; the others are kept.
OPEN = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

Kind = TypeVar("Kind")


def checked(kind: type[Kind], content: object, *, path: str | Path | None = None, place: str = "") -> Kind:
    """Return JSON values as a type: a dataclass, a typed dictionary, a list; no value is converted to another type.

    Dataclasses and typed dictionaries accept no further entries, unless their `__pydantic_config__` is `OPEN`.

    Args:
        kind: Type of the content.
        content: Values as JSON has them, with finite numbers.
        path: Path of the file, for the message.
        place: Entry of the file that has the content, for the message.

    Raises:
        FileFormatError: An entry is unknown, missing, of another type, or refused by its dataclass.
    """
    text, model = json.dumps({"content": content}), _model(kind)  # type: ignore[arg-type]
    try:
        return cast("Kind", model.model_validate_json(text).content)
    except ValidationError as error:
        faults = error.errors()
        what = "; ".join(message(fault, (place, *fault["loc"][1:])) for fault in faults[:_LISTED])
        more = f"; and {len(faults) - _LISTED} more" if len(faults) > _LISTED else ""
        raise FileFormatError(what + more, path=path) from error


@lru_cache
def _model(kind: Any) -> Any:
    return create_model("Document", __config__=_STRICT, content=(kind, ...))


def message(fault: Any, place: tuple[str | int, ...], words: Mapping[str, str] = WORDS) -> str:
    """Return in words what is wrong with an entry, for one of pydantic's errors, and the value that it has."""
    where = ".".join(str(part) for part in place if part != "")
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    what = words.get(fault["type"], fault["msg"])
    if fault["type"] not in _WITHOUT_VALUE:
        value = repr(fault["input"])
        what += f", not {value[:_SHOWN]}{'...' if len(value) > _SHOWN else ''}"
    return f"{where}: {what}" if where else f"it {what}"
