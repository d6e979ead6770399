"""The inputs of the integration: pieces of drives side by side, smooth between their samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Span:
    """Samples `start` to `stop` of a run."""

    run: int
    start: int
    stop: int


def spans_of(run: int, samples: int, rate: float, piece: float | None) -> list[Span]:
    """Return the pieces of a run of `samples`, each at most `piece` long [s]; one where it is None."""
    length = samples if piece is None else max(round(piece * rate), 1)
    return [Span(run, start, min(start + length, samples)) for start in range(0, samples, length)]


class Drives:
    """The drives of all pieces as cubic Hermite splines through their samples.

    Before a run's start its first sample is held. Over the first third of the lead the drive grows from zero.
    """

    def __init__(self, inputs: Sequence[Array], spans: Sequence[Span], lead: int, steps: int) -> None:
        """Lay the drives out.

        Args:
            inputs: Roads and loads (U, N) of each run, on the same even grid of 1250 Hz.
            spans: The pieces.
            lead: Samples before each piece.
            steps: Steps of the integration per sample.
        """
        self.runs, self.lead = len(spans), lead
        self.samples = max(span.stop - span.start for span in spans)
        firsts = np.cumsum([0, *(values.shape[1] for values in inputs)])
        self._values = np.concatenate(inputs, axis=1).T.copy()
        self._slopes = np.concatenate([np.gradient(values, axis=1) for values in inputs], axis=1).T.copy()
        self._starts = np.array([firsts[span.run] + span.start for span in spans])
        self._least = np.array([firsts[span.run] for span in spans])
        self._most = np.array([firsts[span.run + 1] - 1 for span in spans])
        self._weights = _hermite(np.arange(1, steps + 1) / steps)
        self._steps = steps

    def between(self, sample: int) -> tuple[Array, Array]:
        """Return values and slopes [1/s] (S, U, B) after each of the S steps from `sample` to the next."""
        left, right = self._at(sample), self._at(sample + 1)
        knots = np.stack([*left, *right])  # (4, B, U)
        flat = knots.reshape(4, -1)
        shape = (self._steps, *knots.shape[1:])
        values, slopes = ((w @ flat).reshape(shape).transpose(0, 2, 1) for w in self._weights)
        return np.ascontiguousarray(values), np.ascontiguousarray(slopes) * 1250.0

    def _at(self, sample: int) -> tuple[Array, Array]:
        """Return the values and slopes per sample (B, U) of every piece at a sample from its start."""
        wanted = self._starts + sample
        places = np.clip(wanted, self._least, self._most)
        inside = (places == wanted)[:, None]
        values, slopes = self._values[places], np.where(inside, self._slopes[places], 0.0)
        growth, rise = self._growth(sample)
        return values * growth, slopes * growth + values * rise

    def _growth(self, sample: int) -> tuple[float, float]:
        """Return the factor with which the drive is brought in, and its change per sample."""
        ramp = max(self.lead // 3, 1)
        share = (sample + self.lead) / ramp
        if not 0.0 <= share < 1.0:
            return (1.0, 0.0) if share >= 1.0 else (0.0, 0.0)
        return float(0.5 - 0.5 * np.cos(np.pi * share)), float(0.5 * np.pi / ramp * np.sin(np.pi * share))


def _hermite(s: Array) -> tuple[Array, Array]:
    """Return the weights (S, 4) of value, slope, next value, next slope, for the curve and for its slope."""
    curve = np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2], axis=1)
    slope = np.stack([6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], axis=1)
    return curve, slope
