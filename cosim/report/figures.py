"""Numbers and lists as a reader meets them."""

from __future__ import annotations

from collections.abc import Sequence

#: Names of a list that are written in full; the others are counted.
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
    """Return a share that is given in percent, to two digits."""
    return f"{figure(value, 2 if abs(value) < 100.0 else 3)}\N{NO-BREAK SPACE}%"


def listed(names: Sequence[str]) -> str:
    """Return names in a row; of many, the first ones and how many more there are."""
    more = len(names) - _NAMED
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_NAMED])} and {more} more"
