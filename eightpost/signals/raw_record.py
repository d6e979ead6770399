"""Raw records: the columns of a file before selection and conversion."""

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
    """Named columns with the units stated in the file.

    Attributes:
        origin: File and line number of each sample.
        names: C column names without units.
        units: C units as written in the file, None for columns without a unit.
        columns: C vectors (N,) of numbers, or of texts if a cell is not a number.
        preamble: Lines above the table, one tuple of cells per line.
    """

    origin: Origin
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    columns: tuple[NDArray[Any], ...]
    preamble: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            what = f"the column name {repeated[0]!r} is not unique; rename one of the columns"
            raise self.origin.header_fault(FileFormatError, what)

    def index(self, source: str, *, channel: str) -> int:
        """Return the index of the column `source`; otherwise raise a MissingChannelError that lists the columns."""
        if source in self.names:
            return self.names.index(source)
        what = f"there is no column {source!r}; the file has: {', '.join(self.names)}"
        raise self.origin.header_fault(MissingChannelError, what, channel=channel)

    def unit(self, index: int, *, channel: str, given: Mapping[str, str], mapped: str | None) -> str:
        """Return a column's unit: from the channel map, otherwise from `given` (by name), otherwise from the file.

        Raises:
            MissingUnitError: No source states the unit.
            UnknownUnitError: The file and `given` state different units.
        """
        source, stated = self.names[index], self.units[index]
        given_unit = given.get(channel) or given.get(source)
        if given_unit and stated and not mapped and given_unit != stated:
            raise self.origin.header_fault(
                UnknownUnitError,
                f"the unit of the column {source!r} is [{stated}] in the file, but {given_unit!r} was given; leave "
                "that out, or set the unit in a channel map if the file is wrong",
                channel=channel,
            )
        unit = mapped or given_unit or stated
        if unit is None:
            raise self.origin.header_fault(
                MissingUnitError,
                f"the column {source!r} has no unit; add it to the header as `{source} [unit]`, pass "
                f"`--units {channel}=unit` (in a system file: units = {{ {channel} = 'unit' }}), or use a channel map",
                channel=channel,
            )
        return unit

    def numbers(self, index: int, *, channel: str) -> NDArray[np.float64]:
        """Return a column (N,) as numbers; a NotANumberError names the first cell that is not a number."""
        column = self.columns[index]
        if column.dtype != object:
            return column.astype(np.float64, copy=False)
        return np.array([self._number(cell, row, channel) for row, cell in enumerate(column)])

    def _number(self, cell: object, row: int, channel: str) -> float:
        try:
            return float(str(cell).replace(",", "."))
        except ValueError:
            what = "the cell is empty" if cell == "" else f"{cell!r} is not a number"
            advice = "correct the cell or delete these lines"
            raise self.origin.fault(NotANumberError, f"{what}; {advice}", channel=channel, sample=row) from None
