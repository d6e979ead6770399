"""Conditions of a dynamometer test, and how they are read from the preamble of a file."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from eightpost import units
from eightpost.errors import UnknownUnitError
from eightpost.signals.column_headers import letters_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


@dataclass(frozen=True, slots=True)
class DynoConditions:
    """Conditions of a dynamometer test; unknown conditions are None."""

    build: str | None = None  #: Team's own name for the shock build.
    #: Adjuster settings and how they are counted, in the team's words (`1 from closed, rebound`).
    clicks: str | None = None
    gas_pressure: float | None = None  #: Gas pressure [Pa].
    gas_force: float | None = None  #: Static gas force at the ride height of the test [N], positive in compression.
    temperature: float | None = None  #: Temperature of the shock at the start of the test [K].
    run: str | None = None  #: Name of the test in the file.
    date: str | None = None  #: Date of the test, as written in the file.

    def over(self, other: DynoConditions) -> DynoConditions:
        """Return these conditions, with unknown ones taken from `other`."""
        ours = {field.name: getattr(self, field.name) for field in fields(self)}
        return DynoConditions(**{n: getattr(other, n) if value is None else value for n, value in ours.items()})


#: Keys of a preamble by condition, in lower case and reduced to letters.
_KEYS = {
    "build": {
        "shock", "shockid", "shockname", "shocknumber", "shockserial", "shockserialnumber", "damper", "damperid",
        "dampername", "build", "shockbuild", "serial", "serialnumber", "valving",
    },
    "run": {"test", "testname", "run", "runname", "testid", "testtitle", "title"},
    "date": {"date", "testdate", "datetime", "dateandtime", "dateoftest"},
    "gas": {
        "gas", "gaspressure", "preload", "preloadgas", "gaspreload", "gascharge", "nitrogen", "nitrogenpressure",
        "reservoirpressure", "canisterpressure", "gasforce", "pressure",
    },
    "temperature": {
        "temperature", "temp", "starttemperature", "starttemp", "testtemperature", "testtemp", "oiltemperature",
        "shocktemperature", "shocktemp", "bodytemperature", "ambienttemperature",
    },
}  # fmt: skip
#: Words in a key that make it an adjuster setting.
_ADJUSTERS = (
    "click",
    "adjust",
    "setting",
    "compression",
    "rebound",
    "lowspeed",
    "highspeed",
    "lsc",
    "hsc",
    "lsr",
    "hsr",
)
_IN_BRACKETS = re.compile(r"^(?P<key>.*\S)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")


def conditions_from(preamble: Iterable[tuple[str, ...]]) -> tuple[DynoConditions, tuple[str, ...]]:
    """Return the conditions stated in a preamble, and notes on entries that could not be read.

    Lines have the form `key: value`, `key = value` or `key,value`. A line may have several entries if each key ends in
    a colon. A quantity needs a unit: after the value (`150 psi`), in a separate cell, or with the key
    (`Gas Pressure (psi)`).

    Args:
        preamble: Cells of each line.
    """
    texts: dict[str, str] = {}
    quantities: dict[str, float] = {}
    clicks, notes = [], []
    for key, value in (pair for cells in preamble for pair in pairs(cells)):
        name = _condition(key)
        if name in ("gas", "temperature"):
            try:
                quantities |= _quantity(name, key, value)
            except UnknownUnitError as error:
                notes.append(f"the entry {key!r} of the preamble is ignored: {error}")
        elif name == "clicks":
            clicks.append(f"{key} {value}")
        elif name:
            texts.setdefault(name, value)
    found = DynoConditions(
        build=texts.get("build"),
        clicks="; ".join(clicks) or None,
        gas_pressure=quantities.get("gas_pressure"),
        gas_force=quantities.get("gas_force"),
        temperature=quantities.get("temperature"),
        run=texts.get("run"),
        date=texts.get("date"),
    )
    return found, tuple(notes)


def _condition(key: str) -> str | None:
    """Return the name of the condition for a key, or None."""
    match = _IN_BRACKETS.match(key)
    plain = letters_of(match["key"] if match else key)
    for name, keys in _KEYS.items():
        if plain in keys:
            return name
    return "clicks" if any(word in plain for word in _ADJUSTERS) else None


def pairs(cells: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield the keys and values of a line."""
    starts = [i for i, cell in enumerate(cells) if i == 0 or cell.endswith((":", "="))]
    for start, stop in zip(starts, [*starts[1:], len(cells)], strict=True):
        head, *rest = cells[start:stop]
        match = re.match(r"^([^:=]*[^:=\s])\s*[:=]\s*(.*)$", head)
        key, first = (match[1], [match[2]] if match[2] else []) if match else (head, [])
        words = [word for word in (*first, *rest) if word]
        if key and words:
            yield key.strip(), _join(words)


def _join(words: list[str]) -> str:
    """Join the cells of a value: a number and its unit with a space, other cells with commas."""
    if len(words) == 2 and units.is_unit(words[1]) and re.fullmatch(r"[-+]?[\d.]+", words[0]):
        return " ".join(words)
    return ", ".join(words)


def _quantity(name: str, key: str, value: str) -> dict[str, float]:
    """Return the condition [SI] given by a quantity; the unit decides whether gas is a pressure or a force."""
    match = _IN_BRACKETS.match(key)
    try:
        number, unit = units.quantity(value if match is None else f"{value} {match['unit']}")
    except ValueError as error:
        raise UnknownUnitError(str(error)) from error
    if name == "temperature":
        return {"temperature": units.convert(number, unit, "K")}
    if units.compatible(unit, "N"):
        return {"gas_force": units.convert(number, unit, "N")}
    return {"gas_pressure": units.convert(number, unit, "Pa")}
