"""Corner whose build explains most of a measure: dots are coloured by the build at this corner."""

from __future__ import annotations

import numpy as np

from cosim.study.report.sheet import Array, Column, Indices, Sheet


def dominant_corner(sheet: Sheet, measure: Column) -> int:
    """Return the corner whose build explains most of a measure's variance; the first corner if no setup ran."""
    if not np.isfinite(measure.levels).any():
        return 0
    return int(np.argmax([_between(placed, measure.levels) for placed in sheet.placed.T]))


def _between(placed: Indices, levels: Array) -> float:
    """Return the variance of the means over the setups with each build."""
    known = np.isfinite(levels)
    counts = np.bincount(placed[known])
    means = np.bincount(placed[known], levels[known])[counts > 0] / counts[counts > 0]
    return float(np.average((means - levels[known].mean()) ** 2, weights=counts[counts > 0]))
