"""Types of the entries of documents that eightpost reads: one check for JSON and TOML files and for parts of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ConfigDict, ValidationError, create_model

from eightpost.errors import FileFormatError
from eightpost.files import check_schema

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

#: An object of which only some entries are read, as are its parts that state nothing else; files of earlier versions
#: have others.
OPEN = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False)
#: The same, with figures that may be infinite or NaN.
REPORT = OPEN | ConfigDict(allow_inf_nan=True)
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

Kind = TypeVar("Kind")


def document_of(kind: type[Kind], content: object, path: Path, name: str, newest: int, advice: str) -> Kind:
    """Return the content of a file that eightpost wrote as a typed dictionary.

    Args:
        kind: Typed dictionary with the entries of the file.
        content: Content of the file.
        path: Path of the file, for messages.
        name: Entry `kind` of such files; files of other programs may lack it.
        newest: Newest schema that this version reads.
        advice: Advice for the user, such as which command makes the file.

    Raises:
        FileFormatError: The file is of another kind, has a newer schema, or a wrong entry; see `checked`.
    """
    if not isinstance(content, dict) or (found := content.get("kind", name)) != name:
        other = f"a {found}" if isinstance(content, dict) else "a JSON"
        raise FileFormatError(f"is {other} file, not a {name} file; {advice}".replace("_", " "), path=path)
    check_schema(content, newest, path)
    return checked(kind, content, path=path, advice=advice)


def checked(
    kind: type[Kind],
    content: object,
    *,
    path: str | Path | None = None,
    place: str = "",
    advice: str = "",
) -> Kind:
    """Return JSON values as a type: a dataclass, a typed dictionary, a list; no value is converted to another type.

    Dataclasses and typed dictionaries accept no further entries and no NaN, unless their `__pydantic_config__` does.

    Args:
        kind: Type of the content.
        content: Values as JSON has them.
        path: Path of the file, for the message.
        place: Entry of the file that has the content, for the message.
        advice: Advice for the user, at the end of the message.

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
        raise FileFormatError(f"{what}{more}{'; ' * bool(advice)}{advice}", path=path) from error


@lru_cache
def _model(kind: Any) -> Any:
    return create_model("Document", __config__=_STRICT, content=(kind, ...))


def message(fault: Any, place: tuple[str | int, ...], words: Mapping[str, str] = WORDS) -> str:
    """Return in words what is wrong with an entry, for one of pydantic's errors, and the value that it has."""
    where = ".".join(str(part) for part in place if part != "")
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    what = words.get(fault["type"]) or fault["msg"].replace("Input should be", "must be")
    if fault["type"] not in _WITHOUT_VALUE:
        value = repr(fault["input"])
        what += f", not {value[:_SHOWN]}{'...' if len(value) > _SHOWN else ''}"
    return f"{where}: {what}" if where else f"it {what}"
