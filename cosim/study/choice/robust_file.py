"""Tables and files of robustness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from pydantic import BaseModel, ConfigDict, Field

from cosim.study.choice.compare_file import read_run_to_run
from cosim.study.choice.robust import Spread, Uncertain
from cosim.study.result import StudyResult
from eightpost import units
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, read_text
from eightpost.signals.parquet_file import read_table
from eightpost.toml_document import parse_model

# ---- File of the spreads of a study's measures, including all draws -------------------------------------------------

_COLUMNS = pa.schema(
    [
        ("measure", pa.string()),
        ("setups", pa.list_(pa.int64())),
        ("values", pa.list_(pa.float64())),
        ("draws", pa.list_(pa.list_(pa.float64()))),
        ("run_to_run", pa.float64()),
        ("runs", pa.int64()),
    ]
)


_STUDY = b"study"


def write_spreads(spreads: Sequence[Spread], path: str | Path, *, digest: str) -> None:
    """Write spreads, one row per measure [SI]; an existing file is replaced only after the new one is complete.

    Args:
        spreads: Spreads of the measures.
        path: Output file.
        digest: Digest of the study.
    """
    rows = [
        {
            "measure": spread.measure,
            "setups": spread.setups.tolist(),
            "values": spread.values.tolist(),
            "draws": spread.draws.tolist(),
            "run_to_run": spread.run_to_run,
            "runs": spread.runs,
        }
        for spread in spreads
    ]
    with atomic_path(path) as temporary:
        table = pa.Table.from_pylist(rows, schema=_COLUMNS.with_metadata({_STUDY: digest.encode()}))
        pyarrow.parquet.write_table(table, temporary, compression="zstd")


def read_spreads(path: str | Path, *, digest: str) -> tuple[Spread, ...]:
    """Read a file of `write_spreads` for the study with this digest.

    Raises:
        FileFormatError: The file cannot be read, or belongs to another study.
    """
    table = read_table(path, schema=_COLUMNS, advice="run `eightpost robust` first")
    if (table.schema.metadata or {}).get(_STUDY, b"") != digest.encode():
        raise FileFormatError("belongs to another study or to other FMUs; run `eightpost robust` again", path=path)
    try:
        return tuple(_spread(row) for row in table.to_pylist())
    except MALFORMED as error:
        raise FileFormatError(f"is not a file of spreads ({error}); run `eightpost robust` again", path=path) from error


def _spread(row: Mapping[str, Any]) -> Spread:
    return Spread(
        row["measure"],
        np.array(row["setups"], dtype=np.int64),
        np.array(row["values"], dtype=np.float64),
        np.array(row["draws"], dtype=np.float64).reshape(-1, len(row["setups"])),
        row["run_to_run"],
        row["runs"],
    )


# ---- Reader of uncertainty files (TOML, docs/how_to/study_choice.md) ------------------------------------------------


SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainties of a study's parts and of the rig."""

    parts: tuple[Uncertain, ...] = ()  #: Uncertain parameters with their covariance.
    #: Shock files by build; the uncertainty is read from the fit in the file.
    fits: Mapping[str, Path] = field(default_factory=dict)
    vehicles: tuple[Path, ...] = ()  #: FMUs of equivalent vehicles, such as fits of other records.
    run_to_run: Mapping[str, float] = field(default_factory=dict)  #: Standard deviation of one rig run by measure [SI].
    runs: int = 1  #: Number of rig runs of each setup that would be averaged.


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Known(_Strict):
    value: float
    deviation: float = Field(ge=0.0)
    lowest: float = -inf
    highest: float = inf


class _Part(_Strict):
    part: str
    parameters: dict[str, _Known] = Field(min_length=1)
    correlation: list[list[float]] | None = None


class _File(_Strict):
    schema_: int = Field(alias="schema")
    uncertain: list[_Part] = Field(default_factory=list)
    fits: dict[str, str] = Field(default_factory=dict)
    vehicles: list[str] = Field(default_factory=list)
    run_to_run: dict[str, float | str] = Field(default_factory=dict)
    compared: str = ""
    runs: int = Field(default=1, ge=1)


def read_uncertainty(path: str | Path, result: StudyResult) -> Uncertainty:
    """Read an uncertainty file for a study; paths in it are relative to the file.

    Raises:
        FileFormatError: The file cannot be read, or an entry is unknown, missing or invalid; the message has its line.
    """
    path = Path(path)
    text = read_text(path, advice="name an uncertainty file (docs/how_to/study_choice.md)")
    document = parse_model(_File, text, path, SCHEMA)
    try:
        return _uncertainty(document, path.parent, result)
    except InputError as error:
        raise FileFormatError(str(error), path=path) from error


def _uncertainty(document: _File, folder: Path, result: StudyResult) -> Uncertainty:
    for build in document.fits:
        if build not in result.study.bank:
            raise InputError(f"fits: there is no build {build!r}; the builds are {', '.join(result.study.bank)}")
    measured = read_run_to_run(folder / document.compared) if document.compared else {}
    return Uncertainty(
        parts=tuple(_part(entry) for entry in document.uncertain),
        fits={build: folder / file for build, file in document.fits.items()},
        vehicles=tuple(folder / file for file in document.vehicles),
        run_to_run=measured | {name: _noise(name, value, result) for name, value in document.run_to_run.items()},
        runs=document.runs,
    )


def _part(entry: _Part) -> Uncertain:
    known = list(entry.parameters.values())
    deviation = np.array([k.deviation for k in known])
    rows = np.eye(len(known)).tolist() if entry.correlation is None else entry.correlation
    if [len(row) for row in rows] != [len(known)] * len(known):
        raise InputError(
            f"{entry.part}: the correlation of {len(known)} parameters must be a matrix of {len(known)} rows and "
            "columns"
        )
    return Uncertain(
        entry.part,
        tuple(entry.parameters),
        np.array([k.value for k in known]),
        np.array(rows) * np.outer(deviation, deviation),
        np.array([k.lowest for k in known]),
        np.array([k.highest for k in known]),
    )


def _noise(name: str, value: float | str, result: StudyResult) -> float:
    """Return a run-to-run deviation in SI; numbers without a unit are in SI."""
    result.study.measure(name)
    if not isinstance(value, str):
        return value
    number, unit = units.quantity(value)
    return abs(float(units.convert(number, unit, result.unit(name))))
