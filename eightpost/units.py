"""Units: names, conversion to SI, display units."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import InputError, UnknownUnitError

# ---- Unit symbols of files and users in pint's notation -------------------------------------------------------------

# Spellings in file headers that pint would read differently. Here lb is a pound-force, and lbm is the mass.
_SPELLINGS = {
    "lb": "lbf", "lbs": "lbf", "lbsf": "lbf", "#": "lbf", "sec": "s", "secs": "s", "seconds": "s", "msec": "ms",
    "inch": "in", "inches": "in", '"': "in", "ips": "in/s", "in/sec": "in/s", "mm/sec": "mm/s", "m/sec": "m/s",
    "g": "g_0", "g's": "g_0", "gs": "g_0", "c": "degC", "degc": "degC", "°c": "degC", "f": "degF", "degf": "degF",
    "°f": "degF", "°": "deg", "-": "1", "": "1", "newton": "N", "newtons": "N",
    "click": "1", "clicks": "1", "lb-f": "lbf", "lb_f": "lbf", "lb f": "lbf", "pounds force": "lbf",
    "pounds-force": "lbf",
    "deg c": "degC", "deg. c": "degC", "degrees c": "degC", "celsius": "degC", "ºc": "degC", "℃": "degC",
    "deg f": "degF", "deg. f": "degF", "degrees f": "degF", "fahrenheit": "degF", "ºf": "degF", "℉": "degF",
    "kelvin": "K", "kgs": "kgf", "kp": "kgf", "hh:mm:ss": "s", "mm:ss": "s", "min:sec": "s", "mil": "thou",
    "mils": "thou",
}  # fmt: skip

#: Words of units in lower case; `MM/SEC` and `Inches per second` are read word by word.
_WORDS = {
    "inches": "in", "inch": "in", "ins": "in", "feet": "ft", "foot": "ft", "millimeter": "mm", "millimeters": "mm",
    "millimetre": "mm", "millimetres": "mm", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "mm": "mm",
    "centimeter": "cm", "centimeters": "cm", "cm": "cm", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "msec": "ms", "msecs": "ms", "millisecond": "ms", "milliseconds": "ms", "newton": "N", "newtons": "N", "kn": "kN",
    "kilonewton": "kN", "kilonewtons": "kN", "lbf": "lbf", "lbsf": "lbf", "pound": "lbf", "pounds": "lbf",
    "kgf": "kgf", "kilogramforce": "kgf", "ips": "in/s", "in": "in", "psi": "psi", "bar": "bar", "degc": "degC",
    "degf": "degF", "volt": "V", "volts": "V", "hertz": "Hz", "ft": "ft", "mps": "m/s",
}  # fmt: skip


#: Units whose upper and lower case matter, and capitals that would be siemens or a concentration (molar).
_CASES = {
    "C": "degC", "F": "degF", "Nm": "N.m", "kNm": "kN.m", "Nmm": "N.mm",
    "S": "s", "mS": "ms", "MS": "ms", "M": "m", "M/S": "m/s", "M/s": "m/s", "m/S": "m/s",
}  # fmt: skip


def _spelled(text: str) -> str:
    """Return a unit in usual spelling: `Inches/Sec` -> `in/s`; other units unchanged."""
    words = re.sub(r"\s+per\s+", "/", text, flags=re.IGNORECASE)
    words = re.sub(r"(?<=[a-z])\.(?=/|$)", "", words)  # in./sec.
    words = re.sub(r"(?<=[A-Z]/)S$", "s", words)  # MM/S: no quantity of this project is per siemens
    return re.sub(r"[A-Za-z]+", lambda found: _WORDS.get(found[0].lower(), found[0]), words)


def _expression(unit: str) -> str:
    """Return a unit symbol in pint's notation: `N.m` -> `N*m`, `m/s2` -> `m/s**2`; empty for a dimensionless unit."""
    text = unit.strip()
    text = _SPELLINGS.get(text.lower(), text) if re.search(r"[ -]", text) else text
    text = text if text in _SPELLINGS.values() else _spelled(text)
    text = _SPELLINGS.get(text.lower() if text.lower() in _SPELLINGS and text not in ("C", "F") else text, text)
    # Upper and lower case differ: Nm is a torque, nm a length.
    text = _CASES.get(text, text)
    text = re.sub(r"\b(lbs|lb)\b(?!m|f)", "lbf", text)
    text = re.sub(r"(?<![\w.])g(?![\w])", "g_0", text)
    text = text.replace("²", "2").replace("³", "3").replace("·", ".").replace("^", "")
    text = re.sub(r"(?<=[A-Za-z)])\s*[.\-]\s*(?=[A-Za-z(])", "*", text)
    text = re.sub(r"(?<=[A-Za-z])-(?=\d)", "**-", text)  # s-1, s^-1
    text = text.replace("g_0", "standard_gravity").replace("g_n", "standard_gravity")
    text = re.sub(r"(?<=[A-Za-z])(\d)", r"**\1", text)
    text = re.sub(r"(?<=[a-z])\s+(?=[a-z])", "*", text)
    return "" if text == "1" else text


# ---- Table of common units, computed with pint and stored in a file that loads faster than pint ---------------------

PATH = Path(__file__).with_name("unit_table.json")

#: Units in the table, in the notation of file headers.
COMMON = (
    "1", "%",
    "m", "mm", "cm", "um", "km", "in", "ft",
    "m/s", "mm/s", "cm/s", "in/s", "ft/s", "km/h", "mph",
    "m/s2", "mm/s2", "in/s2", "ft/s2", "g",
    "N", "kN", "mN", "lbf", "kgf", "N/s", "lbf/s",
    "N.m", "kN.m", "N.mm", "lbf.in", "in.lbf", "lbf.ft", "lbf.in/deg", "lbf.ft/deg",
    "N/m", "N/mm", "kN/m", "lbf/in", "lbf/ft",
    "N.s/m", "N.s/mm", "kN.s/m", "lbf.s/in", "lbf.s/ft", "lbf/(in/s)", "lbf/(ft/s)", "N/(m/s)", "N/(mm/s)",
    "kg", "lbm", "kg.m2", "lbm.in2", "lbm.ft2",
    "rad", "deg", "mrad", "rad/s", "deg/s", "rad/s2", "rpm",
    "s", "ms", "us", "min", "h", "Hz", "kHz", "1/s",
    "Pa", "kPa", "MPa", "bar", "psi", "W", "kW", "J", "kJ",
    "K", "degC", "degF", "V", "mV", "A",
    "m3", "cm3", "in3", "m2", "cm2", "mm2", "in2",
    "kg/m3", "Pa.s", "m2/s", "N/rad", "N.m/rad", "N.m.s/rad",
)  # fmt: skip


class Table(NamedTuple):
    """Properties of units, which are keys in pint's notation."""

    exponents: dict[str, dict[str, int]]  #: Exponents of the SI base units; base units outside SI have pint's name.
    factors: dict[str, float]  #: Value of one unit in SI base units.
    #: Pair (factor, offset) for each pair of units with the same dimension.
    conversions: dict[tuple[str, str], tuple[float, float]]


def read_table() -> Table:
    """Read the table from its file."""
    document = json.loads(PATH.read_text(encoding="utf-8"))
    pairs = {
        (source, target): (f, o) for source, row in document["conversions"].items() for target, (f, o) in row.items()
    }
    return Table(document["exponents"], document["factors"], pairs)


def _make_table() -> Table:
    """Compute the table with pint."""
    from eightpost import pint_units  # noqa: PLC0415 -- it takes long to load

    texts = tuple(dict.fromkeys(map(_expression, COMMON)))
    found = {pair: pint_units.conversion(*pair) for pair in product(texts, texts)}
    return Table(
        {text: pint_units.exponents(text) for text in texts},
        {text: pint_units.factor(text) for text in texts},
        {pair: conversion for pair, conversion in found.items() if conversion is not None},
    )


def main() -> None:
    """Write the table to its file, one line per unit."""
    table = _make_table()
    rows: dict[str, dict[str, tuple[float, float]]] = {text: {} for text in table.exponents}
    for (source, target), conversion in table.conversions.items():
        rows[source][target] = conversion
    sections = {"exponents": table.exponents, "factors": table.factors, "conversions": rows}
    text = json.dumps(sections, separators=(",", ":"))
    PATH.write_text(re.sub(r"(?<=\},)(?=\")|(?<=:\{)(?=\"[^\"]*\":\{)", "\n", text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()


# ---- Unit conversion ------------------------------------------------------------------------------------------------

Values = TypeVar("Values", float, "NDArray[np.float64]")

#: SI units of the quantities in the project.
SI_UNITS = (
    "m", "m/s", "m/s2", "N", "N.m", "N/m", "N.s/m", "N/s", "kg", "kg.m2", "rad", "rad/s", "s", "Hz", "Pa", "W", "J",
    "K", "1",
)  # fmt: skip

#: Display units for each SI unit: US customary and metric.
DISPLAY_UNITS = {
    "Pa": ("psi", "bar"),
    "K": ("degF", "K"),
    "m": ("in", "mm"),
    "m/s": ("in/s", "mm/s"),
    "m/s2": ("g", "m/s2"),
    "N": ("lbf", "N"),
    "N.m": ("lbf.in", "N.m"),
    "N/m": ("lbf/in", "N/m"),
    "N.s/m": ("lbf/(in/s)", "N.s/m"),
    "N/s": ("lbf/s", "N/s"),
    "N.m/rad": ("lbf.in/deg", "N.m/rad"),
    "kg": ("lbm", "kg"),
    "kg.m2": ("lbm.in2", "kg.m2"),
    "rad": ("deg", "deg"),
    "J": ("in.lbf", "J"),
}

_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")

#: Maximum length of a unit, and powers that would take pint very long or overflow: a power of a number, or an exponent
#: that has three digits, has an exponent itself, or is in parentheses.
_LONGEST = 60
_ENDLESS = re.compile(r"\d\s*\*\*|\*\*\s*(?![-+]?\d{1,2}(?:\.\d{1,3})?(?![\d.eE]))")

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

_EXAMPLES = "m, mm, in, m/s, in/s, N, lbf, lbf/in, kg, lbm, psi, s, ms, degC"


@cache
def _table() -> Table:
    return read_table()


@lru_cache(maxsize=1024)
def _known(unit: str) -> str:
    """Return the expression of a unit in pint's notation; raise UnknownUnitError if it cannot be read."""
    text = _expression(unit[: _LONGEST + 1])
    if text in _table().exponents:
        return text
    if len(unit) > _LONGEST or "//" in unit or _ENDLESS.search(text):  # pint reads // as a floor division
        shown = unit if len(unit) <= _LONGEST else f"{unit[:_LONGEST]}..."
        raise UnknownUnitError(f"unknown unit {shown!r}; examples of units: {_EXAMPLES}")
    from eightpost import pint_units  # noqa: PLC0415 -- it takes long to load

    try:
        pint_units.unit(text)
    except Exception as error:  # pint raises several types, including AssertionError from its parser
        raise UnknownUnitError(f"unknown unit {unit!r}; examples of units: {_EXAMPLES}") from error
    return text


@lru_cache(maxsize=4096)
def _converted(source: str, target: str) -> tuple[float, float] | None:
    """Return (factor, offset) between two units; None if their dimensions differ."""
    table, pair = _table(), (_known(source), _known(target))
    if all(text in table.exponents for text in pair):
        return table.conversions.get(pair)
    with _pint(f"cannot convert {source!r} to {target!r}") as pint_units:
        found: tuple[float, float] | None = pint_units.conversion(*pair)
        return found


@contextmanager
def _pint(what: str) -> Iterator[ModuleType]:
    """Yield `pint_units`; its errors, for example for an overflow or a power of a temperature, become ours."""
    from eightpost import pint_units  # noqa: PLC0415 -- it takes long to load

    try:
        yield pint_units
    except Exception as error:  # pint raises several types, including AssertionError from its parser
        raise UnknownUnitError(f"{what}: {error}") from error


def is_unit(text: str) -> bool:
    """Return whether `text` can be read as a unit."""
    if "[" in text or "]" in text:  # known without the library of units, which takes long to load
        return False
    try:
        _known(text)
    except UnknownUnitError:
        return False
    return True


def compatible(first: str, second: str) -> bool:
    """Return whether two units have the same dimension."""
    return _converted(first, second) is not None


def conversion(source: str, target: str) -> tuple[float, float]:
    """Return (factor, offset) so that `target_value = factor * source_value + offset`.

    Raises:
        UnknownUnitError: A unit is unknown, or the dimensions differ.
    """
    found = _converted(source, target)
    if found is None:
        raise UnknownUnitError(f"cannot convert {source!r} to {target!r}: the dimensions differ")
    return found


def convert(values: Values, source: str, target: str) -> Values:
    """Convert values (a float or an array) from one unit to another.

    >>> round(convert(1.0, "in/s", "m/s"), 4)
    0.0254
    """
    factor, offset = conversion(source, target)
    return values if (factor, offset) == (1.0, 0.0) else values * factor + offset


def us_customary(unit: str) -> str:
    """Return the US customary unit in which an SI unit is shown; the unit itself if it has none.

    Kelvin stays: degF has another zero, so a difference or an RMS value could not be converted to it.

    >>> us_customary("m/s"), us_customary("s"), us_customary("K")
    ('in/s', 's', 'K')
    """
    return unit if unit == "K" else DISPLAY_UNITS.get(unit, (unit, unit))[0]


def metric(unit: str) -> str:
    """Return the metric unit in which an SI unit is shown.

    >>> metric("m/s"), metric("N")
    ('mm/s', 'N')
    """
    return DISPLAY_UNITS.get(unit, (unit, unit))[1]


# ---- Units in which results are shown -------------------------------------------------------------------------------

#: Systems that a user can choose; `file`: that of the files which a command reads.
SYSTEMS = ("us", "si", "file")

#: Environment variable with the system, which counts before the choice of `eightpost units`.
CHOICE = "EIGHTPOST_UNITS"

_US, _SI = re.compile(r"\b(lb|lbf|in|inch|inches|ips|psi|ft)\b"), re.compile(r"\b(N|kN|mm|m|cm|bar|kPa)\b")

#: Systems of the files that the running command has read; None outside of a command.
_systems_read: ContextVar[list[str] | None] = ContextVar("systems_read", default=None)

#: System that the study or system file states of which results are shown; empty without one.
_stated: ContextVar[str] = ContextVar("stated", default="")


def choice_path() -> Path:
    """Return the path of the file with the user's choice of units."""
    import platformdirs  # noqa: PLC0415 -- it is needed only where a result is shown

    return platformdirs.user_config_path("eightpost") / "units"


def chosen_system() -> str:
    """Return the user's choice: `us`, `si` or `file`.

    The environment variable counts before a study or system file, and that before the choice of `eightpost units`.

    Raises:
        InputError: The environment variable or the file states another one.
    """
    path = choice_path()
    stated = os.environ.get(CHOICE) or _stated.get()
    stated = stated or (path.read_text(encoding="utf-8").strip() if path.is_file() else "file")
    if stated not in SYSTEMS:
        raise InputError(f"{CHOICE} or {path} states {stated!r}; it must be one of {', '.join(SYSTEMS)}")
    return stated


def shown_system() -> str:
    """Return the system in which results are shown: the user's choice, else that of the first file, else `us`."""
    chosen = chosen_system()
    return (_systems_read.get() or ["us"])[0] if chosen == "file" else chosen


@contextmanager
def following_files() -> Iterator[None]:
    """Show results in the units of the first file that is read in the block, unless the user has chosen others."""
    token, stated = _systems_read.set([]), _stated.set("")
    try:
        yield
    finally:
        _systems_read.reset(token)
        _stated.reset(stated)


@contextmanager
def stated_by(system: str) -> Iterator[None]:
    """Show results in the block in the system that a study or system file states; empty: it states none."""
    token = _stated.set(system or _stated.get())
    try:
        yield
    finally:
        _stated.reset(token)


def state(system: str) -> None:
    """Show results in the system that a study or system file states, until the running command ends."""
    if system and _systems_read.get() is not None:
        _stated.set(system)


def note_file(found: Iterable[str | None]) -> None:
    """Note the units of the columns of a file that is read."""
    text = " ".join(unit for unit in found if unit)
    seen = _systems_read.get()
    if seen is not None and (_US.search(text) or _SI.search(text)):
        seen.append("us" if _US.search(text) else "si")


def display_unit(unit: str) -> str:
    """Return the unit in which an SI unit is shown to this user."""
    return us_customary(unit) if shown_system() == "us" else metric(unit)


def shown_unit(unit: str, stated: str) -> str:
    """Return the unit in which an SI unit is shown to this user; `stated` counts if the user has chosen no system."""
    return stated or unit if chosen_system() == "file" else display_unit(unit)


def shown(value: float, unit: str) -> tuple[float, str]:
    """Return an SI value in the unit in which it is shown to this user, and that unit; kelvin are a temperature."""
    target = display_unit(unit) if unit != "K" else "degF" if shown_system() == "us" else "degC"
    return float(convert(value, unit, target)), target


def shown_range(low: float, high: float, unit: str) -> str:
    """Return two SI values as a range in the unit in which they are shown to this user; a single value stands alone."""
    (first, target), (last, _) = shown(low, unit), shown(high, unit)
    return f"{first:.3g} {target}" if low == high else f"{first:.3g} to {last:.3g} {target}"


def shown_difference(kelvin: float) -> tuple[float, str]:
    """Return a difference of two temperatures [K] in the unit in which it is shown to this user, and that unit."""
    return (1.8 * kelvin, "degF") if shown_system() == "us" else (kelvin, "degC")


def si_unit(unit: str) -> str:
    """Return the SI unit of the same dimension as `unit`.

    Raises:
        UnknownUnitError: The unit is not known, or no quantity of this project has its dimension.

    >>> si_unit("in/s")
    'm/s'
    """
    exponents = si_exponents(unit)
    for candidate in SI_UNITS:
        if si_exponents(candidate) == exponents:
            return candidate
    raise UnknownUnitError(f"no SI unit for {unit!r}: its dimension is not used by this project")


def si_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units of `unit`, as required by an FMI `BaseUnit` element.

    The radian is a base unit, as in FMI.

    >>> si_exponents("N")
    {'kg': 1, 'm': 1, 's': -2}
    """
    return dict(_exponents(unit))


@lru_cache(maxsize=1024)
def _exponents(unit: str) -> tuple[tuple[str, int], ...]:
    text = _known(unit)
    powers = _table().exponents.get(text)
    if powers is None:
        with _pint(f"no SI unit for {unit!r}") as pint_units:
            powers = pint_units.exponents(text)
    if unknown := sorted(set(powers) - set(_BASE)):
        raise UnknownUnitError(f"no SI unit for {unit!r}: {unknown[0]} is not supported")
    return tuple((name, powers[name]) for name in _BASE if powers.get(name))


def si_factor(unit: str) -> float:
    """Return the factor from `unit` to its SI base units.

    >>> si_factor("in")
    0.0254
    """
    text = _known(unit)
    factor = _table().factors.get(text)
    if factor is None:
        with _pint(f"no SI unit for {unit!r}") as pint_units:
            factor = pint_units.factor(text)
    return factor


def quantity(text: str) -> tuple[float, str]:
    """Split a value with a unit, for example `70 in`, into the number and the unit.

    >>> quantity("1.5e6 lbm.in2")
    (1500000.0, 'lbm.in2')

    Raises:
        UnknownUnitError: The text does not begin with a number, or the unit is missing or unknown.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise UnknownUnitError(f"{text!r} is not a value with a unit; write for example '70 in'")
    number, unit = match.groups()
    if not unit:
        raise UnknownUnitError(f"{text!r} has no unit; write for example '70 in'")
    _known(unit)
    return float(number), unit
