"""Conditions of a dynamometer test: what the lines above a table and the name of its file state about it."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar

from eightpost import units
from eightpost.errors import FileFormatError, UnknownUnitError
from eightpost.rig.columns import is_named
from eightpost.signals.table_text import letters_of
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path


# ---- Conditions in the preamble -------------------------------------------------------------------------------------


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
_KEYS = {name: words.split() for name, words in {
    "build": "shock shockid shockname shocknumber shockserial shockserialnumber damper damperid dampername build "
             "shockbuild serial serialnumber valving",
    "run": "test testname run runname testid testtitle title",
    "date": "date testdate datetime dateandtime dateoftest",
    "gas": "gas gaspressure preload preloadgas gaspreload gascharge nitrogen nitrogenpressure reservoirpressure "
           "canisterpressure gasforce pressure",
    "temperature": "temperature temp starttemperature starttemp testtemperature testtemp oiltemperature "
                   "shocktemperature shocktemp bodytemperature ambienttemperature",
}.items()}  # fmt: skip
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
    """
    stated: dict[str, Any] = {}
    clicks, notes = [], []
    for key, value in (pair for cells in preamble for pair in pairs(cells)):
        name = _condition(key)
        if name in ("gas", "temperature"):
            try:
                stated |= _quantity(name, key, value)
            except UnknownUnitError as error:
                notes.append(f"the entry {key!r} of the preamble is ignored: {error}")
        elif name == "clicks":
            clicks.append(f"{key} {value}")
        elif name:
            stated.setdefault(name, value)
    return DynoConditions(**stated, clicks="; ".join(clicks) or None), tuple(notes)


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
            is_quantity = len(words) == 2 and re.fullmatch(r"[-+]?[\d.]+", words[0]) and units.is_unit(words[1])
            yield key.strip(), (" " if is_quantity else ", ").join(words)


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


# ---- Signs and units for whole channels: `extension positive`, `Force units: lbf` -----------------------------------

Name = TypeVar("Name")

_SIDES = {
    "compression": r"compress\w*|bump|jounce|push\w*",
    "rebound": r"rebound|exten\w*|droop|tension|tensile|pull\w*",
}
_SIGNS = {"positive": r"positive|\+ve|\+(?!\s*[\d.])", "negative": r"negative|-ve|\(-\)"}
_CHANNELS = {
    ("force",): r"force|load",
    ("displacement", "velocity"): r"displacement|position|travel|stroke|motion|velocity|speed",
}
_WORDS = 8  #: Largest number of words of a clause that states a sign.


def reversed_channels(preamble: Iterable[tuple[str, ...]], path: Path) -> tuple[dict[str, bool], str]:
    """Return whether each channel with a stated sign is positive in rebound, and the statement.

    A clause names one stroke and a sign (`extension positive`, `force: negative in rebound`). It is about the force or
    the motion if it names one of them, else about all channels that no other clause names.

    Raises:
        FileFormatError: Two clauses contradict each other.
    """
    found: dict[str, bool] = {}
    general: set[bool] = set()
    statements = []
    for clause in (part for cells in preamble for cell in cells for part in re.split(r"[,;|]|\band\b", cell)):
        sides, signs = _words_in(clause, _SIDES), _words_in(clause, _SIGNS)
        if len(sides) != 1 or len(signs) != 1 or len(clause.split()) > _WORDS:
            continue
        statements.append(clause.strip())
        is_reversed = (sides == ["rebound"]) == (signs == ["positive"])
        channels = [name for names in _words_in(clause, _CHANNELS) for name in names]
        general |= set() if channels else {is_reversed}
        if len(general) > 1 or any(found.setdefault(name, is_reversed) != is_reversed for name in channels):
            what = f"its sign conventions contradict each other: {'; '.join(statements)}; delete the wrong one"
            raise FileFormatError(what, path=path)
    everywhere = dict.fromkeys(("displacement", "velocity", "force"), *general) if general else {}
    return everywhere | found, "; ".join(statements)


def _words_in(clause: str, patterns: Mapping[Name, str]) -> list[Name]:
    return [name for name, words in patterns.items() if re.search(rf"(?<!\w)(?:{words})(?!\w)", clause, re.IGNORECASE)]


def stated_units(preamble: Iterable[tuple[str, ...]]) -> dict[str, str]:
    """Return the units of channels from lines such as `Displacement units: in`."""
    found: dict[str, str] = {}
    for key, value in (pair for cells in preamble for pair in pairs(cells)):
        if match := re.fullmatch(r"(.*\S)[\s_]+units?", key, re.IGNORECASE):
            for channel in ("time", "velocity", "force", "displacement", "temperature"):
                if is_named(match[1].split()[-1], channel):
                    found.setdefault(channel, value)
    return found


# ---- Settings in the name of a file: `damper_2clicks`, `run_1.5A`, `t1_n10_150psi` ----------------------------------

_NUMBER = r"(?<![A-Za-z0-9.,])(\d+(?:[.,]\d+)?)"
#: Names of adjusters before a number.
_NAMED = re.compile(
    r"(?<![A-Za-z])(rebound|reb|compression|comp|bump|lsc|hsc|lsr|hsr)[ _-]?(\d+)(?![\d.,]*\d|[A-Za-z])", re.IGNORECASE
)
#: Units of settings in file names, and the adjuster that they belong to.
UNITS = {"click": "clicks", "mA": "current", "A": "current", "V": "voltage"}


def numbers_in(stem: str, unit: str, *, has_decimals: bool = False) -> list[float]:
    """Return the numbers with a unit (`click`, `A`, `psi`) in the name of a file, all or those with decimals."""
    word, ignore = ("clicks?", re.IGNORECASE) if unit == "click" else (re.escape(unit), re.NOFLAG)
    found = re.findall(rf"{_NUMBER}[ _-]?{word}(?![A-Za-z])", stem, ignore)
    return [float(one.replace(",", ".")) for one in found if not has_decimals or not one.isdigit()]


def setting_in(stem: str, adjuster: str, unit: str) -> float | None:
    """Return the setting of an adjuster in the name of a file: the number behind its name or before its unit.

    None without one, or if several numbers have the unit. An empty unit is that of no number.
    """
    found = [float(number) for name, number in _NAMED.findall(stem) if adjuster.lower().startswith(name.lower())]
    found = found or (numbers_in(stem, unit) if unit else [])
    return found[0] if len(found) == 1 else None


def conditions_in(path: Path) -> tuple[DynoConditions, tuple[str, ...]]:
    """Return the settings and the gas pressure in the name of a file, and a note if there are some."""
    stem = path.stem
    settings = [f"{name} {number}" for name, number in _NAMED.findall(stem)]
    # `1A` and `2V` may be the names of builds.
    settings += [
        f"{n:g} {unit.replace('click', 'clicks')}"
        for unit in UNITS
        for n in numbers_in(stem, unit, has_decimals=unit in ("A", "V"))
    ]
    pressures = {unit: found for unit in ("psi", "bar", "kPa") if len(found := numbers_in(stem, unit)) == 1}
    unit, (pressure,) = next(iter(pressures.items())) if len(pressures) == 1 else ("", (0.0,))
    stated = [*settings, *([f"gas {pressure:g} {unit}"] if unit else [])]
    note = f"from the name of the file: {', '.join(stated)}"
    return DynoConditions(
        clicks=", ".join(settings) or None, gas_pressure=convert(pressure, unit, "Pa") if unit else None
    ), (note,) if stated else ()
