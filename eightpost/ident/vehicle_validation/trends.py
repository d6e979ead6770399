"""Trends of RMS over records, which show whether the vehicle ranks setups as the rig does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import rankdata

from eightpost.array_types import Array
from eightpost.ident.vehicle_validation.comparison import (
    Comparison,
    quantity,
)

if TYPE_CHECKING:
    Ranges = Mapping[str, tuple[float, float]]


#: Minimum number of records for a trend.
FEWEST = 3

#: Relative spread below which a measure has no trend.
_FLAT = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """RMS of one output over records.

    Attributes:
        name: Name of the output.
        unit: SI unit.
        measured: Measured RMS of each record (R,).
        predicted: Predicted RMS of each record (R,).
    """

    name: str
    unit: str
    measured: Array
    predicted: Array

    @property
    def spread(self) -> float:
        """Largest minus smallest measured RMS, over their mean [1]."""
        return float(np.ptp(self.measured) / self.measured.mean())

    @property
    def is_flat(self) -> bool:
        """Whether the records barely differ, so that their order is a matter of chance."""
        return self.spread < _FLAT

    @property
    def correlation(self) -> float:
        """Pearson correlation of predicted and measured RMS [1]."""
        return _correlation(self.measured, self.predicted)

    @property
    def rank(self) -> float:
        """Spearman rank correlation of predicted and measured RMS [1]."""
        return _correlation(rankdata(self.measured), rankdata(self.predicted))

    @property
    def bias(self) -> float:
        """Mean of predicted over measured RMS, minus one [1]; the trend may be right even if this level is wrong."""
        return float(np.mean(self.predicted / self.measured) - 1.0)

    @property
    def remaining_error(self) -> float:
        """Largest error of RMS relative to its mean over records [1]; the common level error is removed."""
        return float(np.abs(self.predicted / self.predicted.mean() - self.measured / self.measured.mean()).max())


def trends_of(records: Sequence[Sequence[Comparison]]) -> tuple[Trend, ...]:
    """Return the trends of all judged outputs; empty for fewer than three records.

    Args:
        records: Comparisons of each record.
    """
    if len(records) < FEWEST:
        return ()
    by_name = [{output.name: output for output in outputs} for outputs in records]
    names = [n for n, output in by_name[0].items() if output.is_judged and all(n in other for other in by_name)]
    return tuple(_trend([outputs[name] for outputs in by_name]) for name in sorted(names, key=quantity))


def _trend(outputs: Sequence[Comparison]) -> Trend:
    measured, predicted = np.array([one.rms for one in outputs]).T
    return Trend(outputs[0].name, outputs[0].unit, measured, predicted)


def _correlation(first: Array, second: Array) -> float:
    a, b = first - first.mean(), second - second.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0
