"""Checks that several chapters share: sides of an equation, paths of a model, numbers in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex
from eightpost.report.tables import plain
from eightpost.vehicle import StateSpace

#: Relative difference up to which two sides of an equation are equal, as rounding errors grow with the condition [1].
ROUNDING = 1e-7


def holds(error: float, limit: float = ROUNDING) -> tuple[bool, str]:
    """Return whether two sides of an equation agree, and their largest relative difference in words."""
    return bool(error <= limit), f"largest relative difference {error:.1e}"


def difference(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the largest difference relative to the largest magnitude of the second."""
    return float(np.max(np.abs(first - second)) / np.max(np.abs(second)))


def difference_by_output(first: NDArray[Any], second: NDArray[Any]) -> float:
    """Return the largest difference of responses (p, ...) relative to the largest magnitude of each output."""
    scale = np.abs(second).max(axis=tuple(range(1, second.ndim)), keepdims=True)
    return float(np.max(np.abs(first - second) / scale))


def response(model: StateSpace, output: str, source: str, frequency: Array) -> Complex:
    """Return the response (K,) of one path."""
    path = model.select(inputs=[source], outputs=[output]).frequency_response(frequency)[0, 0]
    return np.asarray(path, dtype=np.complex128)


def falls(values: Iterable[float]) -> bool:
    """Return whether each value is below the one before."""
    return bool(np.all(np.diff(list(values)) < 0.0))


def shown(values: Iterable[float], unit: str = "") -> str:
    """Return numbers with three significant digits, and their unit."""
    return ", ".join(plain(value, 3) for value in values) + f" {unit}".rstrip()
