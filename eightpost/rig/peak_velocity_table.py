"""Tables of peak velocities and forces (PVP)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.display import Summarized, Summary
from eightpost.errors import DataError, TooShortError
from eightpost.labelled import data_frame

if TYPE_CHECKING:
    import pandas as pd

#: Minimum number of speeds for a curve.
FEWEST = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PeakVelocityTable(Summarized):
    """Force by speed in both strokes, at one setting of the adjusters and without dynamics.

    Raises:
        TooShortError: There are fewer than two speeds.
        DataError: The columns differ in length or contain NaN, or the speeds are not positive and increasing.
    """

    speed: Array  #: Peak speeds (K,) [m/s], positive and increasing.
    compression: Array  #: Force in compression (K,) [N], positive.
    rebound: Array  #: Force in rebound (K,) [N], negative.
    clicks: str | None = None  #: Adjuster settings and how they are counted, in the team's words.
    source: Path | None = None  #: Path of the file, None for a table created in memory.
    sha256: str = ""  #: SHA-256 digest of the file, empty without a file.
    gas_force: float = 0.0  #: Gas force in the table [N]; `compression` and `rebound` are without it.
    gas_source: str = ""  #: Description of how the gas force was found; empty without a gas force.
    rest_force: float = 0.0  #: Mean force at zero speed [N]; 0 without such points.
    notes: tuple[str, ...] = ()  #: Sentences on what was left out or computed while reading.

    def __post_init__(self) -> None:
        for name in ("speed", "compression", "rebound"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, values)
            if values.shape != (len(self),):
                what = f"has {values.size} values, but speed has {len(self)}; every row needs all three values"
                raise DataError(what, path=self.source, channel=name)
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                what = f"row {row} is not a number; enter a number or delete the row"
                raise DataError(what, path=self.source, channel=name)
        if len(self) < FEWEST:
            what = f"the table has {len(self)} speeds; a curve needs at least {FEWEST}"
            raise TooShortError(what, path=self.source)
        if self.speed[0] <= 0.0 or (np.diff(self.speed) <= 0.0).any():
            what = f"speeds must be positive and increase from row to row, not {self.speed.tolist()}"
            raise DataError(what, path=self.source, channel="speed")

    def _summary(self) -> Summary:
        gas = f"{self.gas_force:.4g} N, not in the table: {self.gas_source}" if self.gas_force else ""
        return Summary.of(
            "Peak-velocity table",
            ("file", self.source.name if self.source else ""),
            ("clicks", self.clicks or ""),
            ("speed", f"{self.speed[0]:.3g} to {self.speed[-1]:.3g} m/s, {len(self)} speeds"),
            ("compression", f"{self.compression[0]:.4g} to {self.compression[-1]:.4g} N"),
            ("rebound", f"{self.rebound[0]:.4g} to {self.rebound[-1]:.4g} N"),
            ("gas force", gas),
            ("notes", "; ".join(self.notes)),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return the forces of both strokes [N] over the speed [m/s].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        forces = {"compression": self.compression, "rebound": self.rebound}
        return data_frame(forces, self.speed, "speed", dict.fromkeys(forces, "N"))

    def __len__(self) -> int:
        """Return the number of speeds K."""
        return int(np.size(self.speed))
