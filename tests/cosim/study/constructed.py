"""Constructed study results: measures are known functions of the builds, without FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.study.choice.robust import Uncertain
from cosim.study.definition import Build, Drive, Study, Vehicle
from cosim.study.measures import Measure
from cosim.study.table import Provenance, StudyResult, result_table, study_schema
from eightpost.corners import CORNERS
from eightpost.signals.parquet_file import Table

#: Table 7.3.
BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")

Response = Callable[[np.ndarray], np.ndarray]


def study(measures: tuple[str, ...], /, builds: tuple[str, ...] = BUILDS, **fields: object) -> Study:
    bank = {name: Build(Path(f"{name.replace('/', '-')}.fmu")) for name in builds}
    given = {
        "name": "constructed",
        "vehicle": Vehicle(Path("car.fmu")),
        "bank": bank,
        "corners": dict.fromkeys(CORNERS, builds),
        "drives": (Drive("lap", Path("lap.parquet"), 30.0),),
        "measures": tuple(Measure(name, ("car.front.ride_height",), display="in") for name in measures),
    }
    return Study(**{**given, **fields})


def result(
    responses: Mapping[str, Response],
    *,
    kept: np.ndarray | None = None,
    marks: Mapping[int, str] | None = None,
    failed: tuple[int, ...] = (),
    **fields: object,
) -> StudyResult:
    """Return the result of a study whose measures are functions of the builds' indices (S, corners)."""
    made = study(tuple(responses), **fields)
    indices = made.space.indices if kept is None else kept
    digits = made.space.digits(indices)
    values = {name: response(digits) for name, response in responses.items()}
    rows = []
    for place, index in enumerate(int(i) for i in indices):
        done = index not in failed
        measured = {name: float(column[place]) if done else None for name, column in values.items()}
        words = {"status": "done" if done else "failed", "message": "", "marks": (marks or {}).get(index, "")}
        numbers = {"coupling_error_percent": 0.1, "seconds": 0.03}
        rows.append({"setup": index, **made.space.setup(index).builds, **measured, **words, **numbers})
    units = dict.fromkeys(responses, "m")
    table = result_table(rows, study_schema(made, units))
    return StudyResult(made, table, Provenance("0" * 64, {}, {}, {}, units))


def cells(table: Table, *without: str) -> dict[str, list[Any]]:
    """Return the cells of a table by column, without some columns; a missing number is None."""
    names = (name for name in table.columns if name not in without)
    return {name: [None if cell != cell else cell for cell in table[name].tolist()] for name in names}  # noqa: PLR0124


def edited(found: StudyResult, **columns: list[Any]) -> StudyResult:
    """Return a result with other cells in some columns; None is a missing number."""
    others = {name: np.array(values, dtype=found.table[name].dtype) for name, values in columns.items()}
    return replace(found, table=replace(found.table, columns={**found.table.columns, **others}))


def independent(part: str, parameters: dict[str, tuple[float, float]], **limits: float) -> Uncertain:
    """Return independent uncertain parameters, given by value and standard deviation."""
    values, deviations = np.array(list(parameters.values()), dtype=np.float64).reshape(-1, 2).T
    return Uncertain(part, tuple(parameters), values, np.diag(deviations**2), **limits)
