"""Numbers and lists as text, the units in which readers expect them, and tables of results in both systems."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path
from textwrap import wrap
from typing import Any

from markupsafe import Markup, escape
from rich.markup import escape as escape_markup

from eightpost import units
from eightpost.report.console import Column, Table, console_table

# ---- Numbers --------------------------------------------------------------------------------------------------------

#: Number of names of a list that are written in full.
_NAMED = 8

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def figure(value: float, digits: int = 4) -> str:
    """Return a number with its significant digits and a true minus sign.

    >>> figure(-0.0000744), figure(1234.5678)
    ('−7.44·10⁻⁵', '1235')
    """
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    power = f"·10{str(int(exponent)).translate(_SUPERSCRIPTS)}" if exponent else ""
    return f"{mantissa}{power}".replace("-", "−")


def fixed(value: float, digits: int = 4) -> str:
    """Return a number with all significant digits, including trailing zeros, so that the digits of a column align.

    >>> fixed(162.0), fixed(-0.05)
    ('162.0', '−0.05000')
    """
    if not 1e-4 <= abs(value) < 1e5:
        return figure(value, digits)
    places = max(0, digits - 1 - floor(log10(abs(value))))
    return f"{value:.{places}f}".replace("-", "−")


def plain(value: float, digits: int) -> str:
    """Return a number with the given significant digits, without an exponent if that is as short.

    >>> plain(0.123456, 3), plain(1234.5, 3), plain(-2.0, 3)
    ('0.123', '1230', '-2.00')
    """
    text = f"{value:#.{digits}g}"
    if "e" in text and 1.0 <= abs(value) < 1e6:
        text = f"{float(f'{value:.{digits}g}'):.0f}"
    return text.rstrip(".")


def percent(value: float) -> str:
    """Return a value given in percent, with two digits; with three, if two would be 1·10²."""
    return f"{figure(value, 2 if abs(value) < 99.5 else 3)}\N{NO-BREAK SPACE}%"


def file_size(path: Path) -> str:
    """Return the size of a file in KiB."""
    return f"{path.stat().st_size / 1024:.0f} KiB"


def listed(names: Sequence[str]) -> str:
    """Return names separated by commas; of a long list, the first ones and the number of the others."""
    more = len(names) - _NAMED
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_NAMED])} and {more} more"


# ---- Display units --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Display:
    """Unit in which a quantity is shown, and its conversion from SI: `shown = factor * value + offset`."""

    si: str
    unit: str
    factor: float
    offset: float

    @classmethod
    def of(cls, si: str, unit: str | None = None) -> Display:
        """Return the conversion from an SI unit to `unit`, by default that in which it is shown to this user.

        A unit that the units module does not know, such as one of a user-defined measure, is shown unchanged. The
        square of a unit per Hz, `N2/Hz`, is shown in the square of the unit's own display unit.
        """
        if si.endswith("2/Hz"):
            base = cls.of(si.removesuffix("2/Hz"), unit)
            return cls(si, f"{base.unit}2/Hz", base.factor**2, 0.0)
        unit = units.display_unit(si) if unit is None else unit
        known = si == unit or not units.is_unit(si)
        return cls(si, si, 1.0, 0.0) if known else cls(si, unit, *units.conversion(si, unit))

    @classmethod
    def us(cls, si: str) -> Display:
        """Return the conversion from an SI unit to US customary units, the first of the two systems of a page."""
        return cls.of(si, units.us_customary(si.removesuffix("2/Hz")))

    @classmethod
    def metric(cls, si: str) -> Display:
        """Return the conversion from an SI unit to the second system of a page: SI, but no pascals."""
        return cls.of(si, units.metric(si) if si == "Pa" else si)

    @property
    def squared(self) -> tuple[str, str]:
        """Squares of the display unit and of the SI unit, for power spectral densities."""
        return _squared(self.unit), _squared(self.si)

    def __call__(self, value: Any) -> Any:
        """Return a value in SI, or an array of values, in the display unit."""
        return self.factor * value + self.offset


def _squared(unit: str) -> str:
    """Return `m²` of `m`, `(m/s)²` of `m/s`."""
    return "1" if unit == "1" else f"{unit}²" if unit.isalpha() else f"({unit})²"


# ==== Tables of results: texts and amounts in SI, shown in US customary and in SI units ==============================


@dataclass(frozen=True, slots=True)
class Amount:
    """A value with its SI unit (`1` and `%` for plain numbers) and the number of significant digits to show."""

    value: float
    unit: str
    digits: int = 3


#: Content of a cell; Markup is HTML, which a terminal cannot show.
Cell = Amount | str

#: Text of a cell without a value.
NONE = "–"


@dataclass(frozen=True, slots=True)
class ResultTable:
    """A table."""

    title: str  #: Heading of the table; may be empty.
    #: Column headers: text, and the SI unit of the amounts below or an empty text. The texts below the header `unit`
    #: are SI units.
    heads: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]  #: Rows with a cell for each column.

    @classmethod
    def of(cls, title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell | float | None]]) -> ResultTable:
        """Return a table of texts and numbers.

        Args:
            title: Heading of the table.
            columns: Header of each column, with the SI unit of the numbers below and, if it is not 3, the number of
                significant digits: `record`, `RMS error [N]`, `offset [N] .2`.
            rows: Rows with a cell for each column: a text, a number, an amount of another unit, or None for no value.
        """
        heads = [_COLUMN.fullmatch(column) for column in columns]
        formats = [(head["text"], head["unit"] or "", int(head["digits"] or 3)) for head in heads if head]
        made = tuple(
            tuple(_cell(value, unit, digits) for value, (_, unit, digits) in zip(row, formats, strict=True))
            for row in rows
        )
        return cls(title, tuple((text, unit) for text, unit, _ in formats), made)

    @property
    def filled(self) -> ResultTable:
        """The same table without the columns in which no row has a value."""
        kept = [k for k in range(len(self.heads)) if any(row[k] not in (NONE, "") for row in self.rows)]
        rows = tuple(tuple(row[k] for k in kept) for row in self.rows)
        return ResultTable(self.title, tuple(self.heads[k] for k in kept), rows) if self.rows else self

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each column contains amounts."""
        return tuple(any(isinstance(row[k], Amount) for row in self.rows) for k in range(len(self.heads)))


#: Header of a column, its unit in brackets and the number of significant digits after a point.
_COLUMN = re.compile(r"(?P<text>.*?)(?: \[(?P<unit>[^\]]+)\])?(?: \.(?P<digits>\d))?", re.DOTALL)


def _cell(value: Cell | float | None, unit: str, digits: int) -> Cell:
    if value is None:
        return NONE
    return value if isinstance(value, Amount | str) else Amount(float(value), unit or "1", digits)


def result_table(table: ResultTable) -> Table:
    """Return a table for a terminal, in US customary units.

    Numbers and names of usual length are not broken; long headings and texts of several words are. A table of many
    columns has less space between them, so that it fits into 80 letters.
    """
    texts = [[_us_text(table, k, cell) for cell in (row[k] for row in table.rows)] for k in range(len(table.heads))]
    columns = [
        _column(_with_unit(*head), numeric, own)
        for head, numeric, own in zip(table.heads, table.numeric, texts, strict=True)
    ]
    rows = ([escape_markup(text) for text in row] for row in zip(*texts, strict=True))
    is_wide = len(columns) > _ROOMY
    return console_table(columns, rows, title=table.title, collapse_padding=is_wide, pad_edge=not is_wide)


#: Largest number of columns with full space between them, and the number of letters above which headings are broken.
_ROOMY, _HEADING = 7, 10

#: Number of letters above which a name is broken, such as that of a file.
_NAME = 24


def _column(heading: str, numeric: bool, texts: Sequence[str]) -> Column:
    is_whole = numeric or not any(" " in text or len(text) > _NAME for text in texts)
    if is_whole:
        width = max(_HEADING, *map(len, texts)) if texts else _HEADING
        heading = "\n".join(wrap(heading, width, break_long_words=False, break_on_hyphens=False))
    return Column(escape_markup(heading), justify="right" if numeric else "left", no_wrap=is_whole,
                  overflow="ellipsis" if is_whole else "fold")  # fmt: skip


def _with_unit(heading: str, unit: str) -> str:
    return f"{heading}, {Display.of(unit).unit}" if unit else heading


def _us_text(table: ResultTable, column: int, cell: Cell) -> str:
    if isinstance(cell, Amount):
        return plain(Display.of(cell.unit).factor * cell.value, cell.digits)
    return Display.of(cell).unit if table.heads[column][0] == "unit" else cell


def cell_html(cell: Cell) -> Markup:
    """Return the HTML of a cell: a text, or an amount in both unit systems."""
    if not isinstance(cell, Amount):
        return escape(cell)
    systems = (Display.us(cell.unit), Display.metric(cell.unit))
    shown = (plain(system.factor * cell.value, cell.digits) for system in systems)
    return _in_both_units(*(text.replace("-", "−") for text in shown))


def unit_html(si: str) -> Markup:
    """Return a unit in both systems."""
    return _in_both_units(Display.us(si).unit, Display.metric(si).unit)


def caption_html(text: str) -> Markup:
    """Return the HTML of a text, with each SI unit in braces, such as {N}, shown in both systems."""
    return Markup(re.sub(r"\{([^{}]+)\}", lambda found: unit_html(found[1]), str(escape(text))))


def _in_both_units(us: str, si: str) -> Markup:
    """Return HTML of which a page shows one of two texts, according to the reader's choice of units."""
    return escape(si) if us == si else Markup('<span class="us">{}</span><span class="si">{}</span>').format(us, si)


@dataclass(frozen=True, slots=True)
class Tile:
    """A value at the top of a page."""

    what: str  #: Name of the value.
    us: str  #: Value with its unit, in US customary units.
    detail: str  #: Remark on the value, such as a channel or a limit.
    si: str = ""  #: The same value in SI units; default: as in `us`.
