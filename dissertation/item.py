"""Inventory of the dissertation's numbered figures, tables and equations, with the values that it prints."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any

from eightpost.errors import InputError

#: Chapters of the inventory.
CHAPTERS = {
    3: "Shock absorbers",
    4: "Quarter car",
    5: "Full vehicle",
    6: "8-post rig",
    7: "Setups",
}


class Kind(StrEnum):
    """Kind of a numbered item."""

    FIGURE = "figure"
    TABLE = "table"
    EQUATION = "equation"


class Basis(StrEnum):
    """What a reproduction of an item can be based on."""

    PRINTED = "printed"  # all equations and parameters are printed
    STAND_IN = "stand-in"  # measured data that were never published: the virtual rigs replace them
    NOTHING = "nothing"  # a photograph or a drawing: nothing to compute


@dataclass(frozen=True, slots=True)
class PrintedValue:
    """A number in print."""

    key: str  #: Name of the value in the item.
    what: str  #: Description of the value.
    text: str  #: Digits as printed: `3.04`, a range `45..75`, or a limit `<25` or `>30`.
    unit: str = ""  #: Unit in print; empty for a plain number, `%` and `dB` are kept.
    #: Tolerance: `digits`, a share such as `2 %`, a factor such as `x 3`, or empty if it is reported only.
    within: str = ""

    def __post_init__(self) -> None:
        if not _PRINTED.fullmatch(self.text):
            raise InputError(f"printed value {self.key}: {self.text!r} is not a number, a range a..b or a limit <a, >a")
        if not _WITHIN.fullmatch(self.within):
            raise InputError(f"printed value {self.key}: the tolerance {self.within!r} must be digits, 'a %' or 'x a'")

    @property
    def numbers(self) -> tuple[float, ...]:
        """Printed number, or both ends of a printed range."""
        return tuple(float(number) for number in self.text.lstrip("<>").split(".."))


_NUMBER = r"-?\d+(\.\d+)?"
_PRINTED = re.compile(rf"[<>]?{_NUMBER}|{_NUMBER}\.\.{_NUMBER}")
_WITHIN = re.compile(r"|digits|\d+(\.\d+)? %|x \d+(\.\d+)?")


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement in words that can be checked."""

    key: str  #: Name of the statement in the item.
    statement: str  #: Statement, in our words.
    is_judged: bool = True  #: Whether the item differs if the statement does not hold.


@dataclass(frozen=True, slots=True)
class Item:
    """A numbered figure, table or equation."""

    kind: Kind  #: Kind of the item.
    number: str  #: Number such as `7.2`.
    title: str  #: Content, in our words.
    section: str  #: Section that states the values.
    page: int  #: Printed page; 0 if it is unknown.
    basis: Basis  #: Source of the data of the reproduction.
    reason: str  #: Reason for the basis, if it is not the printed text alone.
    values: tuple[PrintedValue, ...]  #: Printed numbers.
    claims: tuple[Claim, ...]  #: Statements to check.

    @property
    def name(self) -> str:
        """Identifier on the page and on the command line, such as `table-7.2`."""
        return f"{self.kind.value}-{self.number}"

    @property
    def label(self) -> str:
        """Name for people, such as `Table 7.2`."""
        return f"{'Eq' if self.kind is Kind.EQUATION else self.kind.value.capitalize()} {self.number}"

    @property
    def chapter(self) -> int:
        """Chapter of the item."""
        return int(self.number.partition(".")[0])

    @property
    def place(self) -> str:
        """Section and page in the dissertation."""
        return f"section {self.section}" + (f", page {self.page}" if self.page else "")

    @property
    def is_computed(self) -> bool:
        """Whether there is anything to compute."""
        return self.basis is not Basis.NOTHING


@cache
def inventory() -> tuple[Item, ...]:
    """Return all items in the order of the dissertation: figures, tables and equations of each chapter."""
    return tuple(item for chapter in CHAPTERS for item in _chapter(chapter))


def chosen(words: Sequence[str]) -> tuple[Item, ...]:
    """Return the items that words name, in the order of the inventory.

    Args:
        words: Chapters (`4`), numbers (`7.2`: the figure, the table and the equation with this number), or one item
            (`table-7.2`, `Fig 7.2`, `eq 6.8`).

    Raises:
        InputError: A word names no item; the message has the nearest ones.
    """
    found: set[str] = set()
    for word in words:
        names = [item.name for item in inventory() if _names(item, word)]
        if not names:
            raise InputError(f"there is no item {word!r}; the nearest are {', '.join(_nearest(word))}. See --list")
        found.update(names)
    return tuple(item for item in inventory() if item.name in found)


_WORD = re.compile(
    r"\s*(?P<kind>fig|figure|tab|table|eq|equation)?s?[\s.:_-]*(?P<number>\d+(\.\d+)?)\s*", re.IGNORECASE
)


def _names(item: Item, word: str) -> bool:
    found = _WORD.fullmatch(word)
    if found is None or (found["kind"] and not item.kind.value.startswith(found["kind"].lower())):
        return False
    return found["number"] in (item.number, str(item.chapter))


def _nearest(word: str) -> list[str]:
    """Return the items whose numbers are nearest to that in a word."""
    found = re.search(r"(\d+)(?:\.(\d+))?", word)
    chapter, number = (int(found[1]), int(found[2] or 0)) if found else (min(CHAPTERS), 0)
    kind = next((kind for kind in Kind if kind.value[:2] in word.lower()), None)

    def distance(item: Item) -> tuple[int, int, bool]:
        own = int(item.number.partition(".")[2])
        return abs(item.chapter - chapter), abs(own - number), kind is not None and item.kind is not kind

    return [item.label for item in sorted(inventory(), key=distance)[:4]]


def _chapter(chapter: int) -> tuple[Item, ...]:
    """Return the items of a chapter's TOML file."""
    text = files("dissertation").joinpath(f"printed/chapter_{chapter}.toml").read_text(encoding="utf-8")
    return tuple(_item(entry) for entry in tomllib.loads(text)["item"])


def _item(entry: Mapping[str, Any]) -> Item:
    kind, number = str(entry["id"]).split("-")
    return Item(
        Kind(kind),
        number,
        entry["title"],
        entry["section"],
        entry.get("page", 0),
        Basis(entry.get("basis", "printed")),
        entry.get("reason", ""),
        (*(PrintedValue(*row) for row in entry.get("printed", ())), *_grid(entry.get("grid"))),
        tuple(Claim(key, text, mode == "judged") for key, text, mode in entry.get("claims", ())),
    )


def _grid(grid: Mapping[str, Any] | None) -> tuple[PrintedValue, ...]:
    """Return the values of a printed table with the keys `row/column`."""
    if grid is None:
        return ()
    return tuple(
        PrintedValue(f"{row}/{column}", f"{row}, {column}", text, grid.get("unit", ""), grid.get("within", ""))
        for row, texts in grid["rows"].items()
        for column, text in zip(grid["columns"], texts, strict=True)
        if text
    )
