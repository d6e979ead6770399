"""Column headers: name and optional unit, in the notations that files use."""

from __future__ import annotations

import re

from eightpost.units import is_unit

_BRACKETED = re.compile(r"^(?P<name>.*\S)\s*[\[(](?P<unit>[^\[\]()]*)[\])]$")
_BARE_BRACKETS = re.compile(r"^\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")

#: Header suffixes that are units after any name: `v_mm_s`, `F_lbf`.
_SUFFIXES = {
    "mm_per_s": "mm/s", "in_per_s": "in/s", "m_per_s": "m/s", "mm_s": "mm/s", "cm_s": "cm/s", "in_s": "in/s",
    "m_s": "m/s", "m_s2": "m/s2", "ips": "in/s", "mm": "mm", "cm": "cm", "inch": "in", "N": "N", "kN": "kN",
    "lbf": "lbf", "lbs": "lbf", "lb": "lbf", "Nm": "N.m", "psi": "psi", "bar": "bar", "kPa": "kPa",
    "MPa": "MPa", "Pa": "Pa", "degC": "degC", "degF": "degF", "Hz": "Hz", "rpm": "rpm", "sec": "s",
    "rad": "rad", "deg": "deg",
}  # fmt: skip

_TIME = {"t", "time", "timestamp"}
_LENGTH = {"x", "z", "disp", "displacement", "pos", "position", "travel", "stroke", "height", "road"}
_TEMPERATURE = {"t", "temp", "temperature"}
#: Suffixes that may also be words or abbreviations (`max_s`, `sensor_in`): units only after a matching quantity.
_CAUTIOUS = {
    "s": ("s", _TIME), "ms": ("ms", _TIME), "us": ("us", _TIME), "m": ("m", _LENGTH), "in": ("in", _LENGTH),
    "C": ("degC", _TEMPERATURE), "F": ("degF", _TEMPERATURE), "K": ("K", _TEMPERATURE),
}  # fmt: skip


def split_header(text: str) -> tuple[str, str | None]:
    """Split a column header into its name and its unit, which is None for a header without a unit.

    Brackets (`velocity [in/s]`, `Force (N)`) contain any unit, known or not. A suffix (`x_mm`, `v_mm_s`, `T_degC`) is a
    unit only if it is in a list of such suffixes: `lf_force` and `max_s` have no unit.

    >>> split_header("Force (N)"), split_header("v_mm_s"), split_header("max_s")
    (('Force', 'N'), ('v', 'mm/s'), ('max_s', None))
    """
    text = text.strip()
    match = _BRACKETED.match(text)
    if match:
        return match["name"], match["unit"].strip()
    for cut in [i for i, letter in enumerate(text) if letter == "_" and i > 0]:
        unit = _suffix_unit(text[:cut], text[cut + 1 :])
        if unit:
            return text[:cut], unit
    return text, None


def _suffix_unit(stem: str, suffix: str) -> str | None:
    if suffix in _SUFFIXES:
        return _SUFFIXES[suffix]
    unit, words = _CAUTIOUS.get(suffix, (None, set()))
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
    """Return whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True
