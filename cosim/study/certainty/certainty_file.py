"""The file certainty.parquet: one row per setup, and a header in its metadata (docs/explanation/certainty.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, cast, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from pydantic import create_model

from cosim.study.certainty.certainty import PROBABILITIES, Certainty, Levels
from cosim.study.stored_table import StoredTable, open_table
from eightpost.array_types import Array
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, check_schema, parse_json

#: Version of the files that are written, and the newest version that can be read.
SCHEMA = 1

_KEY = b"eightpost"

#: Columns of the criterion.
_OWN = ("best", "among", "feasible")

#: Fields of a certainty that are columns. All others are entries of the header.
_COLUMNS = ("setups", "levels", *_OWN)


@dataclass(frozen=True, slots=True)
class _Measure:
    """Header of one measure."""

    name: str
    relative: bool
    basis: str
    run_to_run: float | None = None


_TYPES = get_type_hints(Certainty)
_ENTRIES = {
    one.name: (_TYPES[one.name], ... if one.default is MISSING else one.default)
    for one in fields(Certainty)
    if one.name not in _COLUMNS
}

#: Header of a certainty: everything that is not a column.
_Header = create_model("_Header", measures=(tuple[_Measure, ...], ...), **cast("dict[str, Any]", _ENTRIES))


def expected_column(measure: str) -> str:
    """Return the name of the column with the expected levels of a measure."""
    return f"expected {measure}"


def best_column(measure: str) -> str:
    """Return the name of the column with the probabilities of being best by a measure."""
    return f"best by {measure}"


def half_width_column(measure: str, probability: float) -> str:
    """Return the name of the column with the half-widths of the intervals of a probability of a measure."""
    return f"half width {100.0 * probability:g} % of {measure}"


def write_certainty(certainty: Certainty, path: str | Path) -> None:
    """Write a certainty; an existing file is replaced only after the new one is complete."""
    columns: dict[str, Any] = {"setup": pa.array(certainty.setups, pa.int64())}
    columns |= {name: _column(getattr(certainty, name)) for name in _OWN}
    columns["tie"] = pa.array(certainty.tie)
    for name, levels in certainty.levels.items():
        columns[expected_column(name)] = _column(levels.expected, pa.float64())
        for probability, half in zip(PROBABILITIES, levels.half_widths, strict=True):
            columns[half_width_column(name, probability)] = _column(half)
        columns[best_column(name)] = _column(levels.best)
    header = {"schema": "eightpost.certainty", "schema_version": SCHEMA, **_header_of(certainty)}
    table = pa.table(columns).replace_schema_metadata({_KEY: json.dumps(header, allow_nan=False)})
    with atomic_path(path) as temporary:
        pyarrow.parquet.write_table(table, temporary, compression="zstd")


def read_certainty(path: str | Path, *, digest: str | None = None) -> Certainty:
    """Read a certainty that `write_certainty` wrote.

    Args:
        path: File, such as certainty.parquet in the folder of a study.
        digest: Digest of the study's result (Provenance.digest); None accepts a certainty of any study.

    Raises:
        FileFormatError: The file cannot be read, or belongs to another study.
    """
    path = Path(path)
    table = open_table(path, advice="run `eightpost study` again, or `eightpost robust`")
    content = _content(path, table)
    try:
        header = _Header.model_validate(content)
        own = {name: getattr(header, name) for name in _ENTRIES}
        measures: tuple[_Measure, ...] = header.measures
        if digest is not None and own["digest"] != digest:
            what = "belongs to another study or to other FMUs; run `eightpost study` again"
            raise FileFormatError(what, path=path)
        return Certainty(
            setups=np.asarray(table["setup"].to_numpy(), dtype=np.int64),
            best=_values(table, "best"),
            among=_values(table, "among"),
            feasible=_values(table, "feasible"),
            levels={measure.name: _levels(table, measure) for measure in measures},
            **own,
        )
    except (pa.ArrowException, *MALFORMED) as error:
        if isinstance(error, FileFormatError):
            raise
        what = f"is not a certainty that this version can read ({error}); run `eightpost study` again"
        raise FileFormatError(what, path=path) from error


def _header_of(certainty: Certainty) -> dict[str, Any]:
    measures = tuple(
        _Measure(name, one.relative, one.basis, one.run_to_run if np.isfinite(one.run_to_run) else None)
        for name, one in certainty.levels.items()
    )
    own = {name: getattr(certainty, name) for name in _ENTRIES}
    found: dict[str, Any] = _Header(measures=measures, **own).model_dump(mode="json")
    return found


def _column(values: Array, kind: pa.DataType | None = None) -> pa.Array:
    """Return a column; NaN is written as null."""
    return pa.array(values, kind or pa.float32(), mask=np.isnan(values))


def _values(table: pa.Table | StoredTable, name: str) -> Array:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def _levels(table: pa.Table | StoredTable, measure: _Measure) -> Levels:
    return Levels(
        _values(table, expected_column(measure.name)),
        np.stack([_values(table, half_width_column(measure.name, p)) for p in PROBABILITIES]),
        _values(table, best_column(measure.name)),
        measure.relative,
        measure.basis,
        np.nan if measure.run_to_run is None else measure.run_to_run,
    )


def _content(path: Path, table: pa.Table | StoredTable) -> Mapping[str, Any]:
    metadata = table.schema.metadata or {}
    found: Any = parse_json(metadata[_KEY], path) if _KEY in metadata else None
    if not isinstance(found, dict) or found.get("schema") != "eightpost.certainty":
        raise FileFormatError("is not the certainty of a study; name the certainty.parquet of a study", path=path)
    check_schema(found, SCHEMA, path, key="schema_version")
    return found
