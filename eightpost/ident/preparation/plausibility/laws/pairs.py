"""Left and right corners of an axle."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from eightpost.corners import CORNERS
from eightpost.ident.preparation.plausibility.comparison import Comparison

#: Left and right corner of each axle.
AXLES = (CORNERS[:2], CORNERS[2:])


def axles(corners: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the left and the right corner of each axle of which both are given."""
    known = set(corners)
    for left, right in AXLES:
        if {left, right} <= known:
            yield left, right


def across(corner: str) -> str | None:
    """Return the other corner of the same axle; None for a quarter car."""
    return next((pair[1 - pair.index(corner)] for pair in AXLES if corner in pair), None)


def difference(left: Comparison, right: Comparison, tolerance: float) -> Comparison:
    """Return the comparison of a figure at the left with the same figure at the right corner."""
    effect = {**left.effect, **{name: -size for name, size in right.effect.items()}}
    law = f"the symmetry of left and right in {left.law}"
    deviation = float(np.hypot(left.deviation, right.deviation))
    return Comparison(law, left.kind, left.value - right.value, tolerance, deviation, effect)
