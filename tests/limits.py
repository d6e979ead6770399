"""The size at which a rule begins or ceases to apply, which shows the limits in it without a copy of their values."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt


def limit_of(applies: Callable[[float], bool], low: float, high: float, *, steps: int = 6) -> float:
    """Return the size between two positive ones at which a rule changes, to the last of so many bisections.

    Each bisection is in the geometric middle. The rule must differ at the two ends.
    """
    at_low = applies(low)
    assert applies(high) != at_low, f"the rule is the same at {low:g} and {high:g}"
    for _ in range(steps):
        middle = sqrt(low * high)
        low, high = (middle, high) if applies(middle) == at_low else (low, middle)
    return low


def first_of(applies: Callable[[int], bool], low: int, high: int) -> int:
    """Return the smallest number at which a rule is as at the higher one of two; it must differ at the two."""
    at_low = applies(low)
    assert applies(high) != at_low, f"the rule is the same at {low} and {high}"
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if applies(middle) == at_low else (low, middle)
    return high
