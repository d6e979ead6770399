"""A peak-velocity table: the force of a shock at a few speeds, as a "peak velocity picture" gives it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import DataError, TooShortError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Fewest speeds that a curve is drawn through.
FEWEST = 2


@dataclass(frozen=True, slots=True, eq=False)
class PeakVelocityTable:
    """Force per speed in both strokes, at one setting of the adjusters; no dynamics.

    Attributes:
        speed: (K,) peak speeds [m/s], positive, rising.
        compression: (K,) force in compression [N], positive.
        rebound: (K,) force in rebound [N], negative.
        clicks: The adjusters and how they are counted, in the team's words.
        source: The file, None for a table made in memory.
        sha256: The file's digest, empty without a file.

    Raises:
        TooShortError: Fewer than two speeds.
        DataError: The columns differ in length, hold NaN, or speeds do not rise from above zero.
    """

    speed: Array
    compression: Array
    rebound: Array
    clicks: str | None = None
    source: Path | None = None
    sha256: str = ""

    def __post_init__(self) -> None:
        for name in ("speed", "compression", "rebound"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, values)
            if values.shape != (len(self),):
                what = f"has {values.size} values and speed {len(self)}: a row needs all three"
                raise DataError(what, path=self.source, channel=name)
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                raise DataError(f"row {row} is not a number; fill it or leave it out", path=self.source, channel=name)
        if len(self) < FEWEST:
            raise TooShortError(f"{len(self)} speeds; a curve needs {FEWEST} or more", path=self.source)
        if self.speed[0] <= 0.0 or (np.diff(self.speed) <= 0.0).any():
            what = f"speeds must be positive and rise from row to row, not {self.speed.tolist()}"
            raise DataError(what, path=self.source, channel="speed")

    def __len__(self) -> int:
        """The number of speeds K."""
        return int(np.size(self.speed))
