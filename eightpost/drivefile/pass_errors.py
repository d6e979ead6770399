"""Errors of a pass: measured minus target, by channel and by band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.drivefile.target import Target

#: Edges of the bands in tables [Hz].
EDGES = (0.0, 1.0, 4.0, 10.0, 16.0, 24.0, 1000.0)


@dataclass(frozen=True, slots=True)
class PassErrors:
    """Errors of one pass between the fades of the target, up to its highest frequency."""

    channels: Mapping[str, float]  #: RMS error by channel, relative to the RMS of the target without its mean [1].
    peaks: Mapping[str, float]  #: Largest error by channel, relative to the largest value of the target [1].
    #: RMS errors by channel in the bands of `EDGES`, relative to the RMS of the whole target [1].
    bands: Mapping[str, tuple[float, ...]]
    #: RMS of the measured minus the target above the highest frequency by channel, relative to the RMS of the target
    #: [1]; it includes sensor noise.
    beyond: Mapping[str, float]
    means: Mapping[str, float]  #: Measured mean minus target mean by channel, relative to the RMS of the target [1].

    @property
    def total(self) -> float:
        """Root mean square of the relative errors of all channels [1]."""
        return float(np.sqrt(np.mean(np.square(list(self.channels.values())))))

    def of_quantity(self, quantity: str) -> float | None:
        """Return the root mean square of the errors of a quantity's channels [1]; None if it is not a target."""
        found = [value for name, value in self.channels.items() if name.rpartition(".")[2] == quantity]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None

    @property
    def worst(self) -> tuple[str, float]:
        """Channel with the largest error, and its error [1]."""
        name = max(self.channels, key=lambda one: self.channels[one])
        return name, self.channels[name]

    def to_json(self) -> dict[str, Any]:
        """Return the errors for a JSON file."""
        return {
            "total": self.total,
            **{name: dict(getattr(self, name)) for name in ("channels", "peaks", "beyond", "means")},
            "bands": {name: list(row) for name, row in self.bands.items()},
        }


def pass_errors(target: Target, record: Array) -> PassErrors:
    """Return the errors of a record (C, N) from the rig, in SI and with its means."""
    lines, judged = target.lines, target.judged
    moving, means = target.without_means(record)
    difference = target.error_window * (moving - target.rows)
    wrong = lines.spectrum(difference)
    whole, error = lines.rows(lines.spectrum(target.rows))[:, judged], lines.rows(wrong)[:, judged]
    size = np.sqrt(np.mean(whole**2, axis=1))
    bands = []
    for low, high in pairwise(EDGES):
        inside = (lines.frequency >= low) & (lines.frequency < high)
        part = lines.rows(np.where(inside[:, None], wrong, 0.0))[:, judged]
        bands.append(np.sqrt(np.mean(part**2, axis=1)) / size)
    rest = (difference - difference.mean(axis=1, keepdims=True))[:, judged] - error

    def named(values: Array) -> dict[str, float]:
        return dict(zip(target.names, (float(value) for value in values), strict=True))

    return PassErrors(
        named(np.sqrt(np.mean(error**2, axis=1)) / size),
        named(np.abs(error).max(axis=1) / np.abs(whole).max(axis=1)),
        {name: tuple(float(band[k]) for band in bands) for k, name in enumerate(target.names)},
        named(np.sqrt(np.mean(rest**2, axis=1)) / size),
        named((means - target.means) / size),
    )
