"""Raw records: the columns of a file as they stand, before anything is chosen or converted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.errors import (
    FileFormatError,
    MissingChannelError,
    MissingUnitError,
    NotANumberError,
    UnknownUnitError,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.origin import Origin


@dataclass(frozen=True, slots=True, eq=False)
class RawRecord:
    """Named columns with the units that the file says.

    Attributes:
        origin: The file and the line of each sample.
        names: C column names, units stripped.
        units: C units as written, None where the file says none.
        columns: C vectors (N,): numbers, or texts where a cell is not a number.
        preamble: What stands above the table, one tuple of cells per line.
    """

    origin: Origin
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[NDArray[Any], ...]
    preamble: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            what = f"the column name {repeated[0]!r} comes twice; rename one of them"
            raise self.origin.header_fault(FileFormatError, what)

    def index(self, source: str, *, wanted_as: str) -> int:
        """Return the number of the column `source`; a MissingChannelError says what there is."""
        if source in self.names:
            return self.names.index(source)
        what = f"there is no column {source!r}; the file has: {', '.join(self.names)}"
        raise self.origin.header_fault(MissingChannelError, what, channel=wanted_as)

    def unit(self, index: int, *, channel: str, given: Mapping[str, str], mapped: str | None) -> str:
        """Return a column's unit: from the channel map, else as `given` by name, else from the file.

        Raises:
            MissingUnitError: Nobody says it.
            UnknownUnitError: The file and `given` say different ones.
        """
        source, stated = self.names[index], self.units[index]
        said = given.get(channel) or given.get(source)
        if said and stated and not mapped and said != stated:
            raise self.origin.header_fault(
                UnknownUnitError,
                f"the file says [{stated}] for the column {source!r}, and {said!r} was given; leave that away, or set "
                "the unit in a channel map if the file is wrong",
                channel=channel,
            )
        unit = mapped or said or stated
        if unit is None:
            raise self.origin.header_fault(
                MissingUnitError,
                f"the column {source!r} says no unit; write it into the header as `{source} [unit]`, pass "
                f"`--units {channel}=unit` (in a system file: units = {{ {channel} = 'unit' }}), or use a channel map",
                channel=channel,
            )
        return unit

    def numbers(self, index: int, *, channel: str) -> NDArray[np.float64]:
        """Return a column (N,) as numbers; a NotANumberError names the first cell that is none."""
        column = self.columns[index]
        if column.dtype != object:
            return column.astype(np.float64, copy=False)
        return np.array([self._number(cell, row, channel) for row, cell in enumerate(column)])

    def _number(self, cell: object, row: int, channel: str) -> float:
        try:
            return float(str(cell).replace(",", "."))
        except ValueError:
            what = "the cell is empty" if cell == "" else f"{cell!r} is not a number"
            advice = "repair the cell or cut those lines out"
            raise self.origin.fault(NotANumberError, f"{what}; {advice}", channel=channel, sample=row) from None
