"""Detection of the intervals in which stepped loads are held constant."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Loads are held if they change by less than `_STILL` of their range within `_LOOK` [s], for at least `_SHORTEST` [s].
_STILL, _LOOK, _SHORTEST = 0.01, 0.2, 1.0


def holds(rows: Array, rate: float) -> list[slice]:
    """Return the second half of every hold, when oscillations have decayed.

    Args:
        rows: Loads (A, N).
        rate: Sample rate [Hz].
    """
    look = max(1, round(_LOOK * rate))
    change = np.abs(rows[:, look:] - rows[:, :-look]).max(axis=0)
    still = np.concatenate(([False], change <= _STILL * np.ptp(rows, axis=1).max(), [False]))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST * rate]
    return [slice((start + stop) // 2, stop) for start, stop in spans]
