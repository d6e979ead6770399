"""Table 6.4: what coherence and response energy together say of a linear model."""

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
    """The four conditions of Table 6.4."""

    I = 1  # noqa: E741  the dissertation's numeral
    II = 2
    III = 3
    IV = 4

    @property
    def meaning(self) -> str:
        """What it means for a linear model."""
        return _MEANINGS[self]


_MEANINGS = {
    Condition.I: "high response, high coherence: a linear model predicts it",
    Condition.II: "low response, high coherence: a linear model predicts that it is low",
    Condition.III: "high response, low coherence: a linear model cannot predict it",
    Condition.IV: "low response, low coherence: the model may be set to a low response",
}


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Where high ends and low begins; 6.2 prints no numbers but calls a coherence of 0.5 low.

    Attributes:
        coherence: High from here [1].
        level: A response is high from here, in dB of power under the output's largest.
    """

    coherence: float = 0.5
    level: float = -20.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.coherence < 1.0:
            raise ParameterError(f"the coherence must lie between 0 and 1, not at {self.coherence:g}")
        if not self.level < 0.0:
            raise ParameterError(f"the level must be below 0 dB, not {self.level:g}")

    def condition(self, coherence: float, level: float) -> Condition:
        """Return the condition of a coherence [1] and a level [dB]."""
        if coherence >= self.coherence:
            return Condition.I if level >= self.level else Condition.II
        return Condition.III if level >= self.level else Condition.IV

    def shares(self, coherence: Array, level: Array, energy: Array) -> dict[Condition, float]:
        """Return which part of the energy falls under each condition.

        Args:
            coherence: (K,) [1].
            level: (K,) [dB].
            energy: (K,), in any scale.
        """
        found = [self.condition(float(c), float(db)) for c, db in zip(coherence, level, strict=True)]
        total = float(energy.sum())
        of = {kind: float(energy[[each is kind for each in found]].sum()) for kind in Condition}
        return {kind: part / total if total > 0.0 else 0.0 for kind, part in of.items()}
