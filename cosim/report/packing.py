"""Arrays and scripts as text in a page: numbers as bytes, compressed, in base 64."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eightpost.page import compressed

Array = NDArray[np.float64]

#: Steps between the least and the greatest value of a channel: 16 bits are 100 times finer than a screen.
LEVELS = 65535


@dataclass
class Store:
    """Arrays one after the other in one block of bytes, each known by where it begins."""

    _content: bytearray = field(default_factory=bytearray)

    def add(self, values: Array) -> int:
        """Add numbers as they are (little-endian, 64 bits) and return where they begin."""
        return self._append(values.astype("<f8").tobytes())

    def add_single(self, values: Array) -> int:
        """Add numbers to seven digits (little-endian, 32 bits) and return where they begin."""
        return self._append(values.astype("<f4").tobytes())

    def add_levels(self, values: Array) -> int:
        """Add (M,) values as 16-bit levels between their least and greatest, and return where they begin.

        Each level is stored as its difference from the one before, modulo 2^16: a smooth signal compresses well.
        """
        low, high = float(values.min()), float(values.max())
        levels = np.rint((values - low) * (LEVELS / (high - low))) if high > low else np.zeros_like(values)
        differences = np.diff(levels.astype("<u2"), prepend=np.uint16(0))
        return self._append(differences.astype("<u2").tobytes())

    @property
    def text(self) -> str:
        """All of it, for a page."""
        return compressed(bytes(self._content))

    def _append(self, content: bytes) -> int:
        self._content.extend(b"\0" * (-len(self._content) % 8))  # a browser reads doubles at multiples of eight only
        place = len(self._content)
        self._content.extend(content)
        return place
