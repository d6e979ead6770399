"""Provenance of a study's values, and the header of its file, which states it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
from pydantic import TypeAdapter

from cosim.study.above_band import AboveBand
from cosim.study.stored_table import StoredTable
from cosim.study.study import Study
from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import check_schema, parse_json

#: Version of the files that are written, and the newest version that can be read.
SCHEMA = 1

_KEY = b"eightpost"


@dataclass(frozen=True, slots=True)
class Provenance:
    """Provenance of a study's values."""

    digest: str  #: SHA-256 of everything that affects the values.
    guids: Mapping[str, str]  #: GUID of every FMU, by file.
    digests: Mapping[str, str]  #: SHA-256 of every input file, by path.
    settings: Mapping[str, Any]  #: Settings of the runs: scheme, coupling step [s], its estimated error, and others.
    measure_units: Mapping[str, str]  #: SI unit of every measure.
    tool_version: str = __version__  #: Version of eightpost.
    #: Range of validity that each FMU states (Validity), by file; None if it states none.
    models: Mapping[str, Any] = field(default_factory=dict)
    #: Power of each measure above the band in which the vehicle was identified, in the run of the baseline or else of
    #: the first setup, by measure; empty if the vehicle states no band.
    above_band: Mapping[str, AboveBand] = field(default_factory=dict)

    @classmethod
    def of_header(cls, header: Mapping[str, Any]) -> Provenance:
        """Return the provenance that the header of a file states.

        Raises:
            ValueError: A value is missing or has another type.
        """
        return _PROVENANCE.validate_python({name: header[name] for name in cls.__dataclass_fields__ if name in header})


_PROVENANCE: TypeAdapter[Provenance] = TypeAdapter(Provenance)


def header_of(study: Study, provenance: Provenance, *, partial: bool) -> dict[bytes, str]:
    """Return the header of a result's file: provenance and definition of the study."""
    header = {
        "schema": "eightpost.study",
        "schema_version": SCHEMA,
        **asdict(provenance),
        "partial": partial,
        "study": json.loads(study.to_json()),
    }
    return {_KEY: json.dumps(header)}


def header_in(path: Path, table: pa.Table | StoredTable) -> dict[str, Any]:
    """Return the header of a file.

    Raises:
        FileFormatError: The file is not a study's result, or was written by a newer version.
    """
    metadata = table.schema.metadata or {}
    if _KEY not in metadata:
        raise FileFormatError("is not a study result: it has no eightpost header", path=path)
    header: dict[str, Any] = parse_json(metadata[_KEY], path, finite=False)
    if not isinstance(header, dict) or header.get("schema") != "eightpost.study":
        found = header.get("schema") if isinstance(header, dict) else header
        raise FileFormatError(f"is not a study result but {found!r}", path=path)
    check_schema(header, SCHEMA, path, key="schema_version")
    return header


def with_found_files(header: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a header whose relative paths lead to files from the current folder.

    The paths are relative to the folder in which the study was run. A file that the current folder does not have is
    looked for from the result's folder and from those above it.

    Args:
        header: Header of a result's file.
        folder: Folder of the result.
    """
    study = header["study"]
    models = [study["vehicle"], *study["bank"].values()]
    files = {model["fmu"] for model in models} | {*header["guids"], *header["digests"], *header.get("models", {})}
    for drive in study["drives"]:
        files |= {drive["file"], drive.get("channel_map") or drive["file"]}
    found = {file: there for file in files if (there := _found(file, folder.resolve())) != file}
    renamed: dict[str, Any] = _renamed(header, found) if found else dict(header)
    return renamed


def _found(file: str, folder: Path) -> str:
    if Path(file).exists():
        return file
    return next((str(place / file) for place in (folder, *folder.parents) if (place / file).exists()), file)


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Return a JSON value in which texts and keys that are among the names have their new names."""
    if isinstance(value, dict):
        return {names.get(key, key): _renamed(one, names) for key, one in value.items()}
    if isinstance(value, list):
        return [_renamed(one, names) for one in value]
    return names.get(value, value) if isinstance(value, str) else value
