"""Whether a record's drive is broadband: only then do its channels determine the laws of the car."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.laws.tire import tire_fit
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Share of the roads that must be broadband [1]; one of four may be disconnected.
MOST = 0.7
#: Smallest number of frequencies over which the acceleration of a road is spread [1]; a sine has 3.
FREQUENCIES = 10.0
#: Smallest share of the segments over which it is spread [1]; a bump is in a few of them.
SEGMENTS = 0.5
#: A road at rest moves less than this share of the largest [1].
RESTING = 0.1
#: Tire force over road [N/m] above which the roads are at rest: sixty times the stiffness of a tire.
STIFFEST = 2e7
#: Share of the tire forces that roads and hubs explain below which they are noise [1]; above 0.95 in random tests.
EXPLAINED = 0.5


def is_broadband(spectra: Spectra, corners: Sequence[str]) -> bool:
    """Return whether most roads move at random: a random test or a track, not a sine, a bump or a single actuator."""
    roads = [_road(spectra, corner) for corner in corners]
    sizes = [0.0 if road is None else float(np.linalg.norm(spectra.rows[road])) for road in roads]
    if not any(sizes) or _is_at_rest(spectra, corners) or _is_noise(spectra, corners):
        return False
    broad = [
        road is not None and size > RESTING * max(sizes) and _spread(spectra, road) >= 1.0
        for road, size in zip(roads, sizes, strict=True)
    ]
    return float(np.mean(broad)) > MOST


def _road(spectra: Spectra, corner: str) -> str | None:
    """Return the road of a corner or its command, whichever is larger: one of them may be disconnected."""
    names = [name for name in (channel(corner, "road"), channel(corner, "road_command")) if name in spectra]
    return max(names, key=lambda name: float(np.linalg.norm(spectra.rows[name])), default=None)


def _is_at_rest(spectra: Spectra, corners: Sequence[str]) -> bool:
    """Return whether the roads have noise only, while aeroloaders move the car."""
    sizes = [
        max((float(np.linalg.norm(spectra.rows[name])) for name in names if name in spectra), default=0.0)
        for names in ([channel(corner, quantity) for corner in corners] for quantity in ("tire_force", "road"))
    ]
    return sizes[0] > STIFFEST * sizes[1]


def _is_noise(spectra: Spectra, corners: Sequence[str]) -> bool:
    """Return whether road and hub explain no tire's force, as in a quasi-static test."""
    fits = [fit for corner in corners if (fit := tire_fit(spectra, corner)) is not None]
    return bool(fits) and float(np.median([fit.explained for fit in fits])) < EXPLAINED


def _spread(spectra: Spectra, road: str) -> float:
    """Return the spread of a road's acceleration over frequencies and segments, relative to the limits; the smaller."""
    power = np.abs(spectra.derivative(road, 2)) ** 2
    by_frequency, by_segment = _number(power.sum(axis=0)), _number(power.sum(axis=1))
    return min(by_frequency / FREQUENCIES, by_segment / (SEGMENTS * len(power)))


def _number(parts: Array) -> float:
    """Return the effective number of parts (sum p)^2 / sum p^2."""
    squares = float(np.sum(parts**2))
    return float(parts.sum()) ** 2 / squares if squares > 0.0 else 0.0
