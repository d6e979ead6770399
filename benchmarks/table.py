"""Numbers in the tables that the benchmarks print."""

from __future__ import annotations


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text with a few significant digits."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"
