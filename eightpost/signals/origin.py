"""Where a record came from, so that a fault can name its place."""

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
    """The file of a record and the line of each of its samples.

    Attributes:
        path: The file, or None for a record that was never in one.
        lines: (N,) one-based line of each sample in a text file; None counts samples from 1.
        header_line: The line with the channel names and units, None in binary files.
    """

    path: Path | None = None
    lines: NDArray[np.int64] | None = None
    header_line: int | None = None

    def line(self, sample: int) -> int:
        """Return the one-based file line (sample number in binary files) of a zero-based sample."""
        return int(self.lines[sample]) if self.lines is not None else sample + 1

    def fault(self, kind: type[DataError], what: str, *, channel: str, sample: int) -> DataError:
        """Return an error of a `kind` at a zero-based sample."""
        return kind(what, path=self.path, line=self.line(sample), channel=channel)

    def header_fault(self, kind: type[DataError], what: str, *, channel: str | None = None) -> DataError:
        """Return an error of a `kind` about a column as a whole."""
        return kind(what, path=self.path, line=self.header_line, channel=channel)


#: A record that was made in memory.
IN_MEMORY = Origin()
