"""Figures that a record may not support: a value, or the reason why it is unknown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Unknown:
    """A figure that a record does not support."""

    reason: str  #: Reason why it is unknown, a clause without a full stop.


#: A value in SI, or the reason why it is unknown.
Found = float | Unknown


def known(values: Iterable[Found]) -> list[float]:
    """Return the values that are known."""
    return [value for value in values if not isinstance(value, Unknown)]


def mean_of(values: Iterable[Found]) -> Found:
    """Return the mean of the known values; the first reason if no value is known."""
    values = list(values)
    found = known(values)
    if found:
        return sum(found) / len(found)
    return next((value for value in values if isinstance(value, Unknown)), Unknown("there is no run"))
