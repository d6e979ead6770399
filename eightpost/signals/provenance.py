"""Header of the files that eightpost writes: schema version, tool version, units and sources."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import check_schema, parse_json

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

#: Version of the time-series schema that this tool writes, and the newest that it reads.
SCHEMA_VERSION = 1


def time_series_header(units: Mapping[str, str], *, sources: Mapping[str, str] | None = None, note: str = "") -> str:
    """Return the header of a time-series file as JSON.

    Args:
        units: SI units by channel name.
        sources: SHA-256 digests by name of the files from which the series was made.
        note: Description of the data for the user.
    """
    header = {
        "schema": "eightpost.time_series",
        "schema_version": SCHEMA_VERSION,
        "tool_version": __version__,
        "units": dict(units),
        "sources": dict(sources or {}),
        "note": note,
    }
    return json.dumps(header)


def parse_header(text: str | bytes, path: Path) -> dict[str, Any]:
    """Return the header of a file; refuse newer schema versions.

    Raises:
        FileFormatError: The text is not a header of eightpost, or has a newer schema version.
    """
    header = parse_json(text, path)
    version = header.get("schema_version") if isinstance(header, dict) else None
    if type(version) is not int or not _is_texts(header.get("units", {})) or type(header.get("note", "")) is not str:
        what = "its eightpost header cannot be read: it must have a schema_version, units by channel and a note"
        raise FileFormatError(what, path=path)
    check_schema(header, SCHEMA_VERSION, path, key="schema_version")
    return dict(header)


def _is_texts(units: object) -> bool:
    return isinstance(units, dict) and all(isinstance(unit, str) for unit in units.values())
