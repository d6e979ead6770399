"""File of the spreads of a study's measures, including all draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from cosim.study.choice.robust import Spread
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path
from eightpost.signals.parquet_table import read_table

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
