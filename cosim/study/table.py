"""Table of a study in a Parquet file: its columns, its header with the provenance of the values, its row groups."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from pydantic import TypeAdapter

from cosim.study.measures import AboveBand, Measure
from cosim.study.study import Study
from eightpost import __version__
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, check_schema, parse_json
from eightpost.signals.parquet_file import parquet_size, read_columns, read_table

# ---- The file: written row group by row group, read column by column ------------------------------------------------

#: Largest size of a table that is read into memory as a whole [bytes]; larger ones are read column by column.
IN_MEMORY = 32 * 2**20

#: Size of a cell of a table in memory [bytes].
_CELL = 8


@dataclass(frozen=True, slots=True)
class StoredTable:
    """Table in a Parquet file, of which each column is read when it is asked for.

    It has those attributes of a pyarrow.Table that the study uses.
    """

    path: Path  #: Path of the file.
    schema: pa.Schema  #: Columns, and metadata of the file.
    num_rows: int  #: Number of rows.
    #: Size of the file [bytes] and time of its last change [ns], by which a replaced file is noticed.
    size: tuple[int, int]

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        names: list[str] = self.schema.names
        return names

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        """Read a column.

        Raises:
            FileFormatError: The file was replaced or removed since it was opened, or is damaged.
            KeyError: There is no such column.
        """
        if name not in self.schema.names:
            raise KeyError(name)
        return self._read([name])[name]

    def take(self, rows: object) -> pa.Table:
        """Return some rows of all columns."""
        return self.read().take(rows)

    def read(self) -> pa.Table:
        """Return the whole table."""
        return self._read(None)

    def _read(self, names: list[str] | None) -> pa.Table:
        if not self.path.is_file() or _identity(self.path) != self.size:
            raise FileFormatError("was replaced or removed while it was used; run the command again", path=self.path)
        return read_columns(self.path, names)


def open_table(path: Path, *, advice: str = "name the results.parquet of a study") -> pa.Table | StoredTable:
    """Return a table with its metadata: in memory if it is small, else column by column.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file does not exist, or is not a Parquet file.
    """
    size = _identity(path) if path.is_file() else (0, 0)
    schema, rows = parquet_size(path, advice=advice)
    if rows * len(schema) * _CELL <= IN_MEMORY:
        return read_table(path, advice=advice)
    return StoredTable(path, schema, rows, size)


def write_tables(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    """Write tables as row groups of one file, one after the other; an existing file is replaced when it is complete.

    Args:
        path: Path of the file.
        schema: Columns, and metadata of the file.
        tables: Tables in the order of their setups.

    Raises:
        InputError: Two rows have the same setup number, or the setups are not in order.
    """
    last = -1
    with (
        atomic_path(path) as temporary,
        pyarrow.parquet.ParquetWriter(temporary, schema, compression="zstd") as writer,
    ):
        for table in tables:
            numbers = np.concatenate([[last], table["setup"].to_numpy()])
            if np.any(np.diff(numbers) <= 0):
                raise InputError(f"{path}: two rows have the same setup number, or they are not in order")
            last = int(numbers[-1])
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_size, found.st_mtime_ns


# ---- Columns --------------------------------------------------------------------------------------------------------

#: Values of the column `status`.
DONE, FAILED = "done", "failed"

#: Names of the columns before and after those of corners and measures.
HEAD, TAIL = ("setup",), ("status", "message", "coupling_error_percent", "marks", "seconds")


def error_column(measure: str) -> str:
    """Return the name of the column with the coupling error of a measure, in the measure's SI unit."""
    return f"coupling error of {measure}"


def study_schema(study: Study, measure_units: Mapping[str, str]) -> pa.Schema:
    """Return the columns of a study's table."""
    tail = {"coupling_error_percent": pa.float64(), "seconds": pa.float64()}
    return pa.schema(
        [
            pa.field("setup", pa.int64()),
            *(pa.field(corner, pa.string()) for corner in study.corners),
            *(pa.field(m.name, pa.float64(), metadata=_words(m, measure_units[m.name])) for m in study.measures),
            *(pa.field(name, tail.get(name, pa.string())) for name in TAIL),
            *(_error_field(m, measure_units[m.name]) for m in study.measures),
        ]
    )


def result_table(rows: Sequence[Mapping[str, Any]], schema: pa.Schema) -> pa.Table:
    """Return rows, given by column name, as a table sorted by setup number.

    Raises:
        InputError: Two rows have the same setup number.
    """
    return in_order(pa.Table.from_pylist(list(rows), schema=schema))


def in_order(table: pa.Table) -> pa.Table:
    """Return a table sorted by setup number.

    Raises:
        InputError: Two rows have the same setup number.
    """
    table = table.sort_by("setup")
    numbers = table["setup"].to_numpy()
    if np.unique(numbers).size < numbers.size:
        raise InputError("two rows have the same setup number")
    return table


def _error_field(measure: Measure, unit: str) -> pa.Field:
    name = error_column(measure.name)
    return pa.field(name, pa.float64(), metadata=_words(measure, unit) | {"label": name})


def _words(measure: Measure, unit: str) -> dict[str, str]:
    return {"unit": unit, "display": measure.display or unit, "label": measure.name}


def check_columns(table: pa.Table | StoredTable, schema: pa.Schema) -> None:
    """Check that a table has the columns of a schema, and that every row has a setup number.

    Raises:
        ValueError: A column is missing or has another type, or a row has no setup number.
    """
    for column in schema:
        if column.name not in table.column_names:
            raise ValueError(f"the column {column.name!r} is missing")
        if not table.schema.field(column.name).type.equals(column.type):
            raise ValueError(f"the column {column.name!r} does not have the type {column.type}")
    if table["setup"].null_count:
        raise ValueError("a row has no setup number")


# ---- Provenance of the values, and the header that states it --------------------------------------------------------

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
