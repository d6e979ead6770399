"""The conditions of a dynamometer test, and what the preamble of its file says about them."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from eightpost import units
from eightpost.errors import UnknownUnitError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


@dataclass(frozen=True, slots=True)
class DynoConditions:
    """The conditions of a dynamometer test, as far as they are known.

    Attributes:
        build: The shock's build, as the team names it.
        clicks: The adjusters and how they are counted, in the team's words (`1 from closed, rebound`).
        gas_pressure: [Pa].
        gas_force: Static force of the gas at the test's ride height [N], positive in compression.
        temperature: Of the shock when the test began [K].
        run: The test's name in the file.
        date: Of the test, as the file writes it.
    """

    build: str | None = None
    clicks: str | None = None
    gas_pressure: float | None = None
    gas_force: float | None = None
    temperature: float | None = None
    run: str | None = None
    date: str | None = None

    def over(self, other: DynoConditions) -> DynoConditions:
        """Return these conditions, and those of `other` where nothing is known here."""
        ours = {field.name: getattr(self, field.name) for field in fields(self)}
        return DynoConditions(**{n: getattr(other, n) if value is None else value for n, value in ours.items()})


#: Keys of a preamble by condition, in lower case without anything but letters.
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
#: Words that make any other key one of an adjuster.
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
    """Return the conditions that a preamble says, and in words what of it could not be taken.

    Lines are `key: value`, `key = value` or `key,value`; several in one line where each key ends in a colon. A
    quantity needs its unit, beside it (`150 psi`), in a cell of its own, or with the key (`Gas Pressure (psi)`).

    Args:
        preamble: The cells of each line.
    """
    texts: dict[str, str] = {}
    quantities: dict[str, float] = {}
    clicks, notes = [], []
    for key, value in (pair for cells in preamble for pair in _pairs(cells)):
        name = _condition(key)
        if name in ("gas", "temperature"):
            try:
                quantities |= _quantity(name, key, value)
            except UnknownUnitError as error:
                notes.append(f"the preamble's {key!r} is not taken: {error}")
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
    """Return the condition that a key is about."""
    match = _IN_BRACKETS.match(key)
    plain = re.sub(r"[^a-z]", "", (match["key"] if match else key).lower())
    for name, keys in _KEYS.items():
        if plain in keys:
            return name
    return "clicks" if any(word in plain for word in _ADJUSTERS) else None


def _pairs(cells: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield the keys and values of a line."""
    starts = [i for i, cell in enumerate(cells) if i == 0 or cell.endswith((":", "="))]
    for start, stop in zip(starts, [*starts[1:], len(cells)], strict=True):
        head, *rest = cells[start:stop]
        match = re.match(r"^([^:=]*[^:=\s])\s*[:=]\s*(.*)$", head)
        key, first = (match[1], [match[2]] if match[2] else []) if match else (head, [])
        words = [word for word in (*first, *rest) if word]
        if key and words:
            yield key.strip(), _joined(words)


def _joined(words: list[str]) -> str:
    """Join the cells of a value: a number and its unit by a blank, all else by commas."""
    if len(words) == 2 and units.is_unit(words[1]) and re.fullmatch(r"[-+]?[\d.]+", words[0]):
        return " ".join(words)
    return ", ".join(words)


def _quantity(name: str, key: str, value: str) -> dict[str, float]:
    """Return the one condition [SI] that a quantity says; gas is a pressure or a force by its unit."""
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
