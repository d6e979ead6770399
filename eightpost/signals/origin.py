"""Origin of a record, which error messages use to state the location of a fault."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from eightpost.errors import DataError


@dataclass(frozen=True, slots=True, eq=False)
class Origin:
    """File of a record and line number of each sample.

    Attributes:
        path: Path of the file, or None for a record created in memory.
        lines: One-based line number (N,) of each sample in a text file; None for sample numbers from 1.
        header_line: Number of the line with the channel names and units, None for binary files.
    """

    path: Path | None = None
    lines: NDArray[np.int64] | None = None
    header_line: int | None = None

    def line(self, sample: int) -> int:
        """Return the one-based file line (sample number in binary files) of a zero-based sample."""
        return int(self.lines[sample]) if self.lines is not None else sample + 1

    def fault(self, kind: type[DataError], what: str, *, channel: str, sample: int) -> DataError:
        """Return an exception of the class `kind` about a zero-based sample."""
        return kind(what, path=self.path, line=self.line(sample), channel=channel)

    def header_fault(self, kind: type[DataError], what: str, *, channel: str | None = None) -> DataError:
        """Return an exception of the class `kind` about a whole column."""
        return kind(what, path=self.path, line=self.header_line, channel=channel)


#: Origin of a record created in memory.
IN_MEMORY = Origin()
