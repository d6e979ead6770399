"""Column headers: names, units, numbers."""

from __future__ import annotations

import re

import numpy as np

from eightpost.signals.text_cleaning import numbers_with_groups, seconds_of
from eightpost.units import compatible, is_unit

_BRACKETED = re.compile(r"^(?P<name>.*\S)\s*[\[({](?P<unit>[^\[\](){}]*)[\])}]$")
#: A name and a unit behind a slash, a comma or a colon: `Force / N`, `v/(mm/s)`, `Time, s`.
_SEPARATED = re.compile(r"^(?P<name>[^/,:]*[^/,:\s])\s*[/,:]\s*(?P<unit>\([^()]+\)|[^()]+)$")
#: A column of a matrix in MATLAB's notation, `data(:,2)`, which is a name.
_MATRIX_COLUMN = re.compile(r":,\d+|\d+,:")
_BARE_BRACKETS = re.compile(r"^\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")

#: Header suffixes that are units after any name: `v_mm_s`, `F_lbf`.
_SUFFIXES = {
    "mm_per_s": "mm/s", "in_per_s": "in/s", "m_per_s": "m/s", "mm_s": "mm/s", "cm_s": "cm/s", "in_s": "in/s",
    "m_s": "m/s", "m_s2": "m/s2", "ips": "in/s", "mm": "mm", "cm": "cm", "inch": "in", "N": "N", "kN": "kN",
    "lbf": "lbf", "lbs": "lbf", "lb": "lbf", "kgf": "kgf", "Kgf": "kgf", "daN": "daN", "Nm": "N.m",
    "psi": "psi", "bar": "bar", "kPa": "kPa", "MPa": "MPa", "Pa": "Pa", "degC": "degC", "degF": "degF", "Hz": "Hz",
    "rpm": "rpm", "sec": "s",
    "rad": "rad", "deg": "deg", "mm_per_sec": "mm/s", "in_per_sec": "in/s", "m_per_sec": "m/s", "mm_sec": "mm/s",
    "in_sec": "in/s", "msec": "ms",
}  # fmt: skip

_TIME = {"t", "time", "timestamp"}
_LENGTH = {"x", "z", "disp", "displacement", "pos", "position", "travel", "stroke", "height", "road"}
_TEMPERATURE = {"t", "temp", "temperature"}
#: Suffixes that may also be words or abbreviations (`max_s`, `sensor_in`): units only after a matching quantity.
_CAUTIOUS = {
    "s": ("s", _TIME), "ms": ("ms", _TIME), "us": ("us", _TIME), "m": ("m", _LENGTH), "in": ("in", _LENGTH),
    "C": ("degC", _TEMPERATURE), "F": ("degF", _TEMPERATURE), "K": ("K", _TEMPERATURE),
}  # fmt: skip
#: Words of a name whose quantity confirms a unit behind a blank (`Force N`), by the SI unit of the quantity.
_QUANTITIES = {
    "s": _TIME | {"zeit", "tiempo", "tempo", "temps"},
    "m": _LENGTH | {"weg", "hub"},
    "m/s": {"v", "vel", "velocity", "speed", "geschwindigkeit", "vitesse", "velocidad"},
    "N": {"f", "force", "load", "kraft", "fuerza", "forza", "comp", "compression", "reb", "rebound", "bump", "droop"},
    "K": _TEMPERATURE,
    "Pa": {"p", "pressure", "druck"},
}
#: Names of a time that are its unit, as loggers write them.
_TIMES = {"millis": "ms", "milliseconds": "ms", "msec": "ms", "micros": "us", "microseconds": "us", "seconds": "s"}
#: The same suffixes in headers of capitals: `TIME_SEC`, `VEL_MM_S`.
_CAPITALS = {suffix.upper(): unit for suffix, unit in _SUFFIXES.items()}
_CAUTIOUS_CAPITALS = {suffix.upper(): (unit, words) for suffix, (unit, words) in _CAUTIOUS.items()}


def split_header(text: str) -> tuple[str, str | None]:
    """Split a column header into its name and its unit, which is None for a header without a unit.

    Brackets (`velocity [in/s]`, `Force (N)`) contain any unit, known or not. A text behind a slash, a comma or a colon
    (`Force / N`, `Time, s`) is a unit only if it is known, and behind a blank (`Force N`) only if the name states the
    same quantity. A suffix (`x_mm`, `v_mm_s`, `T_degC`, `TIME_SEC`) is a unit
    only if it is in a list of such suffixes: `lf_force` and `max_s` have no unit.

    >>> split_header("Force (N)"), split_header("v_mm_s"), split_header("max_s")
    (('Force', 'N'), ('v', 'mm/s'), ('max_s', None))
    """
    text = text.strip()
    if separated := _separated(text) or _behind_blank(text):
        return separated
    match = _BRACKETED.match(text)
    if match and not _MATRIX_COLUMN.fullmatch(match["unit"]):
        return match["name"], match["unit"].strip()
    for cut in [i for i, letter in enumerate(text) if letter == "_" and i > 0]:
        unit = _suffix_unit(text[:cut], text[cut + 1 :])
        if unit:
            return text[:cut], unit
    return text, _TIMES.get(text.lower())


def _separated(text: str) -> tuple[str, str] | None:
    """Return the name and the unit of `Force / N`; None if no unit follows the mark, or the name ends in one.

    `Vel mm/s` is not divided: its name would end in a unit.
    """
    match = _SEPARATED.match(text)
    *first, last = re.split(r"[ _]+", match["name"]) if match else [""]
    if match is None or (first and is_unit(last) and not is_number(last)):
        return None
    unit = match["unit"].strip().removeprefix("(").removesuffix(")").strip()
    return (match["name"], unit) if unit and not is_number(unit) and is_unit(unit) else None


def _behind_blank(text: str) -> tuple[str, str] | None:
    """Return the name and the unit of `Force N`; None if the last words are no unit of the quantity that is named.

    A number before the unit is a count (`Load 2 N`) if it has one digit, else it may be a factor (`Force 10 N`).
    """
    words = text.split()
    for count in (2, 1):
        stem, last = " ".join(words[:-count]), " ".join(words[-count:])
        if stem and is_number(stem.split()[-1]) and not re.fullmatch(r"\d", stem.split()[-1]):
            continue
        named = set(re.findall(r"[^\W\d_]+", stem.lower()))
        unit = _SUFFIXES.get(last) or _CAUTIOUS.get(last, (last, set()))[0]
        for si, quantities in _QUANTITIES.items():
            if named & quantities and last[:1].isalpha() and is_unit(unit) and compatible(unit, si):
                return stem, unit
    return None


def _suffix_unit(stem: str, suffix: str) -> str | None:
    if suffix in _SUFFIXES or ("/" in suffix and is_unit(suffix)):
        return _SUFFIXES.get(suffix, suffix)
    if stem.isupper() and suffix in _CAPITALS:
        return _CAPITALS[suffix]
    cautious = _CAUTIOUS | (_CAUTIOUS_CAPITALS if stem.isupper() else {})
    unit, words = cautious.get(suffix, (None, set()))
    return unit if re.split(r"[\s_.]", stem)[-1].lower() in words else None


def units_row(cells: list[str]) -> list[str] | None:
    """Return the units of a row under the header (`s;mm;N`, brackets allowed), or None if it is not a row of units.

    A row of units contains no number and at least one cell that can be read as a unit.
    """
    bare = [_BARE_BRACKETS.sub(lambda match: match["unit"], cell).strip() for cell in cells]
    if any(is_number(cell) for cell in bare if cell != "1"):
        return None
    return bare if any(cell and is_unit(cell) for cell in bare) else None


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma and thousands separators, or a time of day."""
    try:
        if numbers_with_groups(np.array([cell], dtype=object), ".") is not None or seconds_of(cell) is not None:
            return True
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def letters_of(name: str) -> str:
    """Return a name in lower case and reduced to its letters, for the comparison with usual names.

    >>> letters_of("Shock Vel. 1")
    'shockvel'
    """
    return re.sub(r"[^a-z]", "", name.lower())
