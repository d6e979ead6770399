"""Power of the inputs of records, which determines where a response is important."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import welch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.records import Records

    Array = NDArray[np.float64]


def input_power(records: Records, frequency: Array) -> Array:
    """Return the power spectral density of each input, averaged over all tests (m, K) [unit^2/Hz].

    Args:
        records: Tests.
        frequency: Frequencies (K,) [Hz], about evenly spaced; the spacing determines the length of the blocks.
    """
    spacing = float(np.mean(np.diff(frequency))) if frequency.size > 1 else float(frequency[0])
    total = np.zeros((len(records.inputs), frequency.size))
    for test in records.tests:
        size = min(test.u.shape[1], max(16, round(records.rate / spacing)))
        lines, power = welch(test.u, records.rate, nperseg=size)
        total += np.stack([np.interp(frequency, lines, row) for row in power])
    return np.asarray(total / len(records.tests))
