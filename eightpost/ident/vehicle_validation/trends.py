"""Trends over records: does the vehicle rank setups as the rig does (Figs 6.27, 6.28)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import rankdata

from eightpost.ident.vehicle_validation.comparison import quantity

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle_validation.comparison import Comparison

    Array = NDArray[np.float64]

#: Fewest records that make a trend.
FEWEST = 3

#: A measure that differs by less than this part between records has no trend to be predicted.
_FLAT = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """The RMS of one output over records.

    Attributes:
        name: Of the output.
        unit: SI.
        measured: RMS of each record (R,).
        predicted: RMS of each record (R,).
    """

    name: str
    unit: str
    measured: Array
    predicted: Array

    @property
    def spread(self) -> float:
        """Largest less smallest measured RMS over their mean [1]."""
        return float(np.ptp(self.measured) / self.measured.mean())

    @property
    def is_flat(self) -> bool:
        """Whether the records hardly differ, so that their order is chance."""
        return self.spread < _FLAT

    @property
    def correlation(self) -> float:
        """Pearson's, of predicted and measured [1]."""
        return _correlation(self.measured, self.predicted)

    @property
    def rank(self) -> float:
        """Spearman's rank correlation [1]."""
        return _correlation(rankdata(self.measured), rankdata(self.predicted))

    @property
    def bias(self) -> float:
        """Mean of predicted over measured less one [1]: a level that is wrong though the trend may be right."""
        return float(np.mean(self.predicted / self.measured) - 1.0)

    @property
    def left(self) -> float:
        """Largest error of a ratio of RMS to their mean over records [1]: what the wrong level does not explain."""
        return float(np.abs(self.predicted / self.predicted.mean() - self.measured / self.measured.mean()).max())


def trends_of(records: Sequence[Sequence[Comparison]]) -> tuple[Trend, ...]:
    """Return the trends of all outputs that setups are judged by; none of fewer than three records.

    Args:
        records: The comparisons of each record.
    """
    if len(records) < FEWEST:
        return ()
    by_name = [{found.name: found for found in outputs} for outputs in records]
    names = [n for n, found in by_name[0].items() if found.is_judged and all(n in other for other in by_name)]
    return tuple(_trend([outputs[name] for outputs in by_name]) for name in sorted(names, key=quantity))


def _trend(found: Sequence[Comparison]) -> Trend:
    measured, predicted = np.array([one.rms for one in found]).T
    return Trend(found[0].name, found[0].unit, measured, predicted)


def _correlation(first: Array, second: Array) -> float:
    a, b = first - first.mean(), second - second.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0
