"""Writing of time series; the suffix of the file name determines the format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import FileFormatError
from eightpost.signals.csv_file import write_csv
from eightpost.signals.mat_file import write_mat
from eightpost.signals.parquet_file import write_parquet

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.signals.timeseries import TimeSeries

_WRITERS: dict[str, Callable[[TimeSeries, Path], None]] = {
    ".csv": write_csv,
    ".txt": write_csv,
    ".parquet": write_parquet,
    ".mat": write_mat,
}


def write_series(series: TimeSeries, path: str | Path) -> None:
    """Write a series in SI as .csv, .txt, .parquet or .mat, with full precision.

    The file is replaced atomically. `write_csv`, `write_parquet` and `write_mat` have more options.

    Raises:
        FileFormatError: The suffix is unknown.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FileFormatError(
            f"files with the suffix {path.suffix!r} cannot be written; supported: {', '.join(_WRITERS)}", path=path
        )
    writer(series, path)
