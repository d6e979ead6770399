"""Tables of results: texts and amounts in SI, shown in US customary and in SI units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from textwrap import wrap

from markupsafe import Markup, escape
from rich.markup import escape as escape_markup

from eightpost.report.console import Column, Table, console_table
from eightpost.report.numbers import Display, plain


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
