"""Where loads that step from level to level are held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Loads that change by less than this part of their range over `_LOOK` [s] are held; a hold lasts `_SHORTEST` [s].
_STILL, _LOOK, _SHORTEST = 0.01, 0.2, 1.0


def holds(rows: Array, rate: float) -> list[slice]:
    """Return the second half of every hold, where what rang has settled.

    Args:
        rows: The loads (A, N).
        rate: [Hz].
    """
    look = max(1, round(_LOOK * rate))
    change = np.abs(rows[:, look:] - rows[:, :-look]).max(axis=0)
    still = np.concatenate(([False], change <= _STILL * np.ptp(rows, axis=1).max(), [False]))
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST * rate]
    return [slice((start + stop) // 2, stop) for start, stop in spans]
