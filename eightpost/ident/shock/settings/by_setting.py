"""Whether a parameter of the law `hysteresis` differs from setting to setting: a comparison on left-out quarters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from eightpost.ident.shock.cross_validation import PIECES, HeldOut, left_out_blocks
from eightpost.ident.shock.hysteresis_search import Projected, Projection
from eightpost.ident.shock.settings.joint_projection import JointPoint

#: Fit of the curves of a setting, by its number, to the rows of a projection with a weight.
Refit = Callable[[int, Projection], Projected]


@dataclass(frozen=True, slots=True, eq=False)
class BySetting:
    """Whether a parameter differs from setting to setting.

    Attributes:
        end: Minimum with a parameter of each setting; None if it is the same at all settings.
        note: Sentence on the choice with both held-out errors.
    """

    end: JointPoint | None
    note: str


def is_worthwhile(parts: Sequence[Projection], words: str, *, common: Refit, own: Refit) -> tuple[bool, str]:
    """Return whether parameters of each setting predict left-out quarters better, and a sentence with both errors.

    Args:
        parts: Force error of each setting on a thinned record.
        words: Name of the parameters in the sentence.
        common: Fit with a common parameter.
        own: Fit with a parameter of each setting.
    """
    pairs = [pair for number, part in enumerate(parts) for pair in _pieces(number, part, common, own)]
    without, with_own = (HeldOut(pieces) for pieces in zip(*pairs, strict=True))
    figures = f"held-out error {with_own.percent:.3g} % with {words} of each setting, {without.percent:.3g} % without"
    if without.is_beaten_by(with_own):
        return True, figures
    return (
        False,
        f"the {words} are the same at all settings: {figures}; they must be better by a standard error and 2 %",
    )


def _pieces(number: int, part: Projection, common: Refit, own: Refit) -> Iterator[tuple[float, float]]:
    """Yield the mean square errors of left-out pieces of a setting over the force's variance: common, own."""
    runs = part.model.runs
    for left_out in left_out_blocks(runs):
        kept = Projection(part.model.weighted(runs.weights * left_out.kept), is_thin=True)
        found = common(number, kept), own(number, kept)
        for rows in left_out.parts:
            variance = max(float(np.var(runs.target[rows])), 1e-300)
            ends = np.linspace(rows.start, rows.stop, PIECES + 1).astype(int)
            for first, last in pairwise(ends.tolist()):
                weights = runs.weights[first:last]
                if weights.sum() > 0.0:
                    errors = [float(np.average(one.error[first:last] ** 2, weights=weights)) for one in found]
                    yield errors[0] / variance, errors[1] / variance
