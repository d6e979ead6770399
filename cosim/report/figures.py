"""Formatting of numbers and lists for display."""

from __future__ import annotations

from collections.abc import Sequence

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


def percent(value: float) -> str:
    """Return a value given in percent, with two digits."""
    return f"{figure(value, 2 if abs(value) < 100.0 else 3)}\N{NO-BREAK SPACE}%"


def listed(names: Sequence[str]) -> str:
    """Return names separated by commas; of a long list, the first ones and the number of the others."""
    more = len(names) - _NAMED
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_NAMED])} and {more} more"
