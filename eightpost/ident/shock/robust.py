"""Robust fit: outliers replaced or down-weighted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.ident.shock.closed import FullLag, best_lag
from eightpost.ident.shock.curve import knot_basis
from eightpost.ident.shock.force import ForceModel, gas_columns, limits_for
from eightpost.ident.shock.runs import Prepared, Runs
from eightpost.rig.dyno_test import DynoTest

# ---- A first force model that is accurate enough to find outlying samples -------------------------------------------


def screened_force(runs: Runs) -> list[Array]:
    """Return the force of a single-lag model (N,) [N] over each run."""
    limits = limits_for(runs.measured, runs.rate)
    basis = knot_basis(runs.velocity, runs.inside)
    model = ForceModel(runs, basis, gas_columns(runs, "estimate")[0], FullLag(limits))
    force = model.force(best_lag(model, limits.time_constant))
    return [np.asarray(force[part]) for part in runs.parts]


# ---- Treatment of outliers ------------------------------------------------------------------------------------------

#: `auto`: only if there are outliers; `none`; `_huber` and `_tukey`: these weights in any case.
Robust = Literal["auto", "none", "huber", "tukey"]

#: Ratio of the standard deviation to the median absolute deviation of a normal distribution.
_NORMAL = 1.4826

#: A raw sample is a spike if it exceeds this many standard deviations of the noise, ...
_SPIKE = 10.0

#: ... and differs by this share of the force's standard deviation from a running median of this many samples. The
#: median follows anything longer than half of its samples; smaller spikes have no effect after the low-pass.
_SPIKES = ((5, 0.1), (7, 0.25))

#: Below this number of samples per period of the cutoff frequency, spikes cannot be distinguished from the motion.
_FINE = 10.0

#: Tuning constants of Huber and Tukey, in standard deviations; wide, because the residual is not normal noise.
_HUBER, _TUKEY = 2.5, 9.0

#: `auto` weights rows if one exceeds this many standard deviations, and this share of the force's standard deviation.
_FAR, _FAR_SHARE = 8.0, 0.5

#: Above this share the law or the curve does not fit, rather than samples being outliers; `auto` then changes nothing.
_MOST_OUTLIERS = 0.05

#: A row counts as down-weighted below this weight.
_DOWN = 0.5


def _spikes_of(raw: Array, predicted: Array, deviation: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return a raw signal (N,) without its spikes, and which samples (N,) were spikes.

    Args:
        raw: Measured signal.
        predicted: Signal predicted by a model; a running median follows the remainder.
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
    """Return a test whose force has no spikes over the prepared segment, and the number of replaced samples.

    Args:
        test: Measured test.
        prepared: Prepared part of the test.
        force: Force (N,) predicted at the prepared record's samples [N].
    """
    if test.series.sample_rate < _FINE * prepared.cutoff:
        return test, 0
    time = test.series.time - test.series.time[0]
    here = (time >= prepared.record.time[0]) & (time <= prepared.record.time[-1])
    predicted = np.interp(time[here], prepared.record.time, force)
    whole = test.series["force"].copy()
    whole[here], spiked = _spikes_of(whole[here], predicted, prepared.deviation)
    if not spiked.any():
        return test, 0
    return replace(test, series=test.series.with_channel("force", "N", whole)), int(spiked.sum())


def without_motion_spikes(test: DynoTest) -> tuple[DynoTest, dict[str, int]]:
    """Return a test whose motion has no outlying single samples, and the number of replaced samples by channel."""
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
    """Return the function of residuals (R,) and the force's standard deviation [N] that gives weights (R,), or None."""
    kinds: dict[str, Callable[[Array, float], Array] | None] = {
        "none": None,
        "huber": lambda residual, _: _huber(residual),
        "tukey": lambda residual, _: _tukey(residual),
        "auto": _only_where_far,
    }
    return kinds[robust]


def _huber(residual: Array) -> Array:
    """Return Huber's weights (R,): 1 up to a number of standard deviations, then falling as 1 / |r|."""
    size = np.abs(residual) / (_HUBER * _scale(residual))
    return np.asarray(1.0 / np.maximum(size, 1.0))


def _tukey(residual: Array) -> Array:
    """Return Tukey's bisquare weights (R,): 0 beyond a number of standard deviations."""
    size = np.minimum(np.abs(residual) / (_TUKEY * _scale(residual)), 1.0)
    return np.asarray((1.0 - size**2) ** 2)


def nearly_equal(weights: Array, others: Array) -> bool:
    """Return whether weights (R,) are so close to others that a fit with them would be the same."""
    return bool(np.abs(weights - others).max() < 0.05)


def downweighted_rows(weights: Array) -> int:
    """Return the number of rows with a weight below one half."""
    return int(np.sum(weights < _DOWN))


def _only_where_far(residual: Array, deviation: float) -> Array:
    size = np.abs(residual)
    far = size > max(_FAR * _scale(residual), _FAR_SHARE * deviation)
    weights = _tukey(residual)
    few = downweighted_rows(weights) <= _MOST_OUTLIERS * weights.size
    return weights if far.any() and few else np.ones_like(residual)


def _scale(residual: Array) -> float:
    middle = float(np.median(residual))
    return max(_NORMAL * float(np.median(np.abs(residual - middle))), 1e-12)


#: Maximum number of searches for spikes.
_SCREENINGS = 3


def screened_runs(
    tests: Sequence[DynoTest], prepared: Callable[[Sequence[DynoTest]], Runs]
) -> tuple[Runs, int, list[str]]:
    """Return runs without spikes, the number of replaced samples, and notes on what was replaced.

    Args:
        tests: Measured tests.
        prepared: Function that prepares tests for the fit.
    """
    cleaned, notes = [], []
    total = 0
    for test in tests:
        clean, found = without_motion_spikes(test)
        cleaned.append(clean)
        total += sum(found.values())
        notes += [f"{count} outlying samples of {name} were replaced" for name, count in found.items()]
    runs, counts = prepared(cleaned), [0] * len(cleaned)
    for _ in range(_SCREENINGS):
        forces = screened_force(runs)
        found_now = [without_spikes(t, p, f) for t, p, f in zip(cleaned, runs.prepared, forces, strict=True)]
        if [count for _, count in found_now] == counts:
            break
        counts = [count for _, count in found_now]
        runs = prepared([test for test, _ in found_now])
    spikes = sum(counts)
    if spikes:
        notes.append(f"{spikes} samples of the force were replaced: spikes, far from the model, and their neighbours")
    return runs, total + spikes, notes
