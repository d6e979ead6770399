"""Encoding of arrays and scripts as text in a page: numbers as bytes, compressed, in base 64."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eightpost.page import compressed

Array = NDArray[np.float64]

#: Number of levels between the minimum and the maximum of a channel: 16 bits are 100 times finer than a screen.
LEVELS = 65535


@dataclass
class Store:
    """Arrays in one block of bytes, each identified by its start position."""

    _content: bytearray = field(default_factory=bytearray)

    def add(self, values: Array) -> int:
        """Add numbers in full (little-endian, 64 bits) and return their start position."""
        return self._append(values.astype("<f8").tobytes())

    def add_single(self, values: Array) -> int:
        """Add numbers to seven digits (little-endian, 32 bits) and return their start position."""
        return self._append(values.astype("<f4").tobytes())

    def add_levels(self, values: Array) -> int:
        """Add (M,) values as 16-bit levels between their minimum and maximum, and return their start position.

        Each level is stored as its difference from the one before, modulo 2^16: a smooth signal compresses well.
        """
        low, high = float(values.min()), float(values.max())
        levels = np.rint((values - low) * (LEVELS / (high - low))) if high > low else np.zeros_like(values)
        differences = np.diff(levels.astype("<u2"), prepend=np.uint16(0))
        return self._append(differences.astype("<u2").tobytes())

    @property
    def text(self) -> str:
        """Contents as text for a page."""
        return compressed(bytes(self._content))

    def _append(self, content: bytes) -> int:
        self._content.extend(b"\0" * (-len(self._content) % 8))  # a browser reads doubles at multiples of eight only
        place = len(self._content)
        self._content.extend(content)
        return place
