"""Samples that do not belong to the shock: spikes and dropouts, weighed down so that they bend nothing.

Two stages, as the faults are of two kinds. A spike of a sample or two is found in the raw force, against the model and
a running median of what the model leaves: on a clean record nothing is found and nothing changes. A fault that lasts
is found at the rows of the fit, whose weights are then those of a bounded influence (Huber, or Tukey's bisquare).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.ndimage import median_filter

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eightpost.ident.shock.record.preparation import Prepared
    from eightpost.rig.dyno_test import DynoTest

    Array = NDArray[np.float64]

#: `auto`: only where there are outliers; `none`; `huber` and `tukey`: these weights in any case.
Robust = Literal["auto", "none", "huber", "tukey"]

#: From the median absolute deviation to the standard deviation of a normal distribution.
_NORMAL = 1.4826

#: A raw sample is a spike from so many noise deviations, ...
_SPIKE = 10.0

#: ... and from this share of the force's deviation off a running median of so many samples, which follows what lasts
#: longer than half of them. Smaller ones drown in the low-pass.
_SPIKES = ((5, 0.1), (7, 0.25))

#: Records with fewer samples per period of the cut-off are too coarse to tell a spike from the motion.
_FINE = 10.0

#: Tuning constants of Huber and Tukey, in deviations: wide, for a residual of lag and curve is no normal noise.
_HUBER, _TUKEY = 2.5, 9.0

#: `auto` weighs rows from so many deviations, and from this share of the force's deviation.
_FAR, _FAR_SHARE = 8.0, 0.5

#: More than this share is no outliers but a law or a curve that does not fit: `auto` leaves it to be seen.
_MOST_OUTLIERS = 0.05

#: A weight under this counts as weighed down.
_DOWN = 0.5


def spikes_of(raw: Array, predicted: Array, deviation: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return a raw signal (N,) with its spikes taken off, and which samples (N,) these were.

    Args:
        raw: Measured.
        predicted: By a model; what it does not say is followed by a running median.
        deviation: Standard deviation of the signal.
    """
    left, clean = raw - predicted, raw
    for size, share in _SPIKES:
        rest = left - median_filter(left, size=size, mode="nearest")
        noise = _NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, share * deviation)
        clean = np.where(spiked & (clean == raw), raw - rest, clean)
    return clean, clean != raw


def without_spikes(test: DynoTest, prepared: Prepared, force: Array) -> tuple[DynoTest, int]:
    """Return a test whose force has no spikes over the prepared stretch, and how many samples were replaced.

    Args:
        test: As measured.
        prepared: What of it is fitted.
        force: (N,) predicted at the prepared record's samples [N].
    """
    if test.series.sample_rate < _FINE * prepared.cutoff:
        return test, 0
    time = test.series.time - test.series.time[0]
    here = (time >= prepared.record.time[0]) & (time <= prepared.record.time[-1])
    predicted = np.interp(time[here], prepared.record.time, force)
    whole = test.series["force"].copy()
    whole[here], spiked = spikes_of(whole[here], predicted, prepared.deviation)
    if not spiked.any():
        return test, 0
    return replace(test, series=test.series.with_channel("force", "N", whole)), int(spiked.sum())


def without_motion_spikes(test: DynoTest) -> tuple[DynoTest, dict[str, int]]:
    """Return a test whose motion has no single samples out of line, and how many were replaced in each channel."""
    found: dict[str, int] = {}
    series = test.series
    for name in ("velocity", "displacement"):
        if name not in series:
            continue
        values = series[name]
        smooth = median_filter(values, size=5, mode="nearest")
        rest = values - smooth
        noise = _NORMAL * float(np.median(np.abs(rest)))
        spiked = np.abs(rest) > max(_SPIKE * noise, 0.1 * float(np.ptp(np.quantile(values, (0.01, 0.99)))))
        if spiked.any():
            found[name] = int(spiked.sum())
            series = series.with_channel(name, series.units[series.names.index(name)], np.where(spiked, smooth, values))
    return (replace(test, series=series), found) if found else (test, found)


def weights_for(robust: Robust) -> Callable[[Array, float], Array] | None:
    """Return what gives row weights (R,) of residuals (R,) [N] and the force's deviation [N]; None: all weigh 1."""
    kinds: dict[str, Callable[[Array, float], Array] | None] = {
        "none": None,
        "huber": lambda residual, _: huber(residual),
        "tukey": lambda residual, _: tukey(residual),
        "auto": _only_where_far,
    }
    return kinds[robust]


def huber(residual: Array) -> Array:
    """Return Huber's weights (R,): 1 up to a number of deviations, then falling as 1 / |r|."""
    size = np.abs(residual) / (_HUBER * _scale(residual))
    return np.asarray(1.0 / np.maximum(size, 1.0))


def tukey(residual: Array) -> Array:
    """Return Tukey's bisquare weights (R,): 0 beyond a number of deviations."""
    size = np.minimum(np.abs(residual) / (_TUKEY * _scale(residual)), 1.0)
    return np.asarray((1.0 - size**2) ** 2)


def weighed_down(weights: Array) -> int:
    """Return how many rows count for less than half."""
    return int(np.sum(weights < _DOWN))


def _only_where_far(residual: Array, deviation: float) -> Array:
    size = np.abs(residual)
    far = size > max(_FAR * _scale(residual), _FAR_SHARE * deviation)
    weights = tukey(residual)
    few = weighed_down(weights) <= _MOST_OUTLIERS * weights.size
    return weights if far.any() and few else np.ones_like(residual)


def _scale(residual: Array) -> float:
    middle = float(np.median(residual))
    return max(_NORMAL * float(np.median(np.abs(residual - middle))), 1e-12)
