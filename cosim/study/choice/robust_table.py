"""Spreads of a study's measures as a file, draws and all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from cosim.study.choice.robust import Spread
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path

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
    """Write spreads, a row per measure [SI]; an existing good file is replaced only by a whole one.

    Args:
        spreads: Of the measures.
        path: The file.
        digest: Of the study that they are of.
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
    """Read what `write_spreads` wrote of a study with this digest.

    Raises:
        FileFormatError: It cannot be read as that, or is of another study.
    """
    try:
        metadata = pyarrow.parquet.read_schema(path).metadata or {}
        rows = pyarrow.parquet.read_table(path, schema=_COLUMNS, use_threads=False).to_pylist()
    except (OSError, pa.ArrowInvalid) as error:
        raise FileFormatError(f"is no file of spreads ({error}); run `eightpost robust` again", path=path) from error
    if metadata.get(_STUDY, b"").decode() != digest:
        raise FileFormatError("is of another study, or of other FMUs; run `eightpost robust` again", path=path)
    return tuple(
        Spread(
            row["measure"],
            np.array(row["setups"], dtype=np.int64),
            np.array(row["values"], dtype=np.float64),
            np.array(row["draws"], dtype=np.float64).reshape(-1, len(row["setups"])),
            row["run_to_run"],
            row["runs"],
        )
        for row in rows
    )
