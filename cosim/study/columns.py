"""Columns of a study's table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from cosim.study.measures import Measure
from cosim.study.stored_table import StoredTable
from cosim.study.study import Study
from eightpost.errors import InputError

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
