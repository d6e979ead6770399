"""Types of the entries of documents that eightpost reads: one check for JSON and TOML files and for parts of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ConfigDict, ValidationError, create_model
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from eightpost.errors import FileFormatError, suggestion
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
#: Error types of an unknown entry.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
#: Error types whose message does not need the value.
_WITHOUT_VALUE = ("missing", "quantity")
#: Faults that a message lists, and characters of a value.
_LISTED, _SHOWN = 3, 60

#: What to do with a vehicle that was given in place of another file.
_VEHICLE = "eightpost inspect shows it, validate compares it with rig records, and build makes an FMU of it"

#: An object of which only some entries are read, as are its parts that state nothing else; files of earlier versions
#: have others.
OPEN = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False)
#: The same, with figures that may be infinite or NaN.
REPORT = OPEN | ConfigDict(allow_inf_nan=True)
_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

Kind = TypeVar("Kind")


def object_of(entries: Mapping[str, Any], *, total: bool = True) -> Any:
    """Return the type of an object with entries of given types, as `TypedDict` does for entries known beforehand."""
    made: Any = TypedDict
    return made("Entries", dict(entries), total=total)


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
        advice = _VEHICLE if other == "a vehicle" else advice
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
    try:
        return validated(kind, content)
    except ValidationError as error:
        faults = [told for _, told in faults_of(error, kind, place)]
        raise FileFormatError(f"{joined(faults)}{'; ' * bool(advice)}{advice}", path=path) from error


def validated(kind: type[Kind], content: object) -> Kind:
    """Return JSON or TOML values as a type, or raise pydantic's ValidationError; dates become texts."""
    return cast("Kind", _model(kind).model_validate_json(json.dumps({"content": content}, default=str)).content)  # type: ignore[arg-type]


@lru_cache
def _model(kind: Any) -> Any:
    return create_model("Document", __config__=_STRICT, content=(kind, ...))


def joined(faults: Sequence[str]) -> str:
    """Return the first faults, and how many there are more."""
    more = f"; and {len(faults) - _LISTED} more" if len(faults) > _LISTED else ""
    return "; ".join(faults[:_LISTED]) + more


def faults_of(
    error: ValidationError, kind: Any, place: str = "", words: Mapping[str, str] = WORDS
) -> list[tuple[tuple[str | int, ...], str]]:
    """Return the place of each wrong entry and what is wrong with it, with missing ones, perhaps misspelled, last."""
    faults = sorted(error.errors(), key=lambda fault: fault["type"] == "missing")
    return [(fault["loc"][1:], _message(fault, kind, (place, *fault["loc"][1:]), words)) for fault in faults]


def _message(fault: Any, kind: Any, place: tuple[str | int, ...], words: Mapping[str, str]) -> str:
    where = ".".join(str(part) for part in place if part != "")
    if fault["type"] == "value_error":
        return str(fault["ctx"]["error"])
    what = words.get(fault["type"]) or fault["msg"].replace("Input should be", "must be")
    if fault["type"] in _UNKNOWN:
        what += f"; {_known(kind, fault['loc'])}"
    elif fault["type"] not in _WITHOUT_VALUE:
        value = repr(fault["input"])
        what += f", not {value[:_SHOWN]}{'...' if len(value) > _SHOWN else ''}"
    return f"{where}: {what}" if where else f"it {what}"


def _known(kind: Any, place: tuple[str | int, ...]) -> str:
    """Return the entries of all parts that are similar to an unknown one, or else the entries beside it."""
    node = whole = _model(kind).model_json_schema()
    parts, name = whole.get("$defs", {}), str(place[-1])
    for key in place[:-1]:
        node = node.get("properties", {}).get(key) or node.get("additionalProperties") or node.get("items") or {}
        node = parts.get(node.get("$ref", "").rpartition("/")[2], node)
    beside, *others = ([entry for entry in part.get("properties", ()) if entry] for part in (node, *parts.values()))
    known = list(dict.fromkeys([*beside, *chain.from_iterable(others)]))
    if name in known:
        return "another part of the file has it"
    close = get_close_matches(name, known, cutoff=0.75) or get_close_matches(name, known, n=1)
    return suggestion(name, close or beside or known)
