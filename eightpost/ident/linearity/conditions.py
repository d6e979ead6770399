"""Conditions of Table 6.4: classification of a path by coherence and response energy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Condition(Enum):
    """Condition of Table 6.4."""

    I = 1  # noqa: E741  the numeral of the dissertation
    II = 2
    III = 3
    IV = 4

    @property
    def meaning(self) -> str:
        """Explanation of the condition."""
        return _MEANINGS[self]


_MEANINGS = {
    Condition.I: "high response, high coherence: a linear model predicts it",
    Condition.II: "low response, high coherence: a linear model predicts that it is low",
    Condition.III: "high response, low coherence: a linear model cannot predict it",
    Condition.IV: "low response, low coherence: the model's response may be set to a low value",
}


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Thresholds between low and high; 6.2 gives no numbers but calls a coherence of 0.5 low.

    Attributes:
        coherence: Lowest coherence that is high [1].
        level: Lowest level of a response that is high, relative to the output's largest power [dB].
    """

    coherence: float = 0.5
    level: float = -20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.coherence < 1.0:
            raise ParameterError(f"the coherence threshold must be between 0 and 1, not {self.coherence:g}")
        if not self.level < 0.0:
            raise ParameterError(f"the level threshold must be below 0 dB, not {self.level:g}")

    def condition(self, coherence: float, level: float) -> Condition:
        """Return the condition of a coherence [1] and a level [dB]."""
        if coherence >= self.coherence:
            return Condition.I if level >= self.level else Condition.II
        return Condition.III if level >= self.level else Condition.IV

    def shares(self, coherence: Array, level: Array, energy: Array) -> dict[Condition, float]:
        """Return the fraction of the energy under each condition.

        Args:
            coherence: Coherence (K,) [1].
            level: Level (K,) [dB].
            energy: Energy (K,), in any scale.
        """
        conditions = [self.condition(float(c), float(db)) for c, db in zip(coherence, level, strict=True)]
        total = float(energy.sum())
        parts = {kind: float(energy[[each is kind for each in conditions]].sum()) for kind in Condition}
        return {kind: part / total if total > 0.0 else 0.0 for kind, part in parts.items()}
