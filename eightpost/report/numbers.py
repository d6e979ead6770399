"""Numbers and lists as text, and the units in which readers expect them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10
from pathlib import Path
from typing import Any

from eightpost import units

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
