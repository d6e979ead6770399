"""Rising curves, and records of laws that random multisines drive, for the tests of fits."""

from functools import lru_cache

import numpy as np

from eightpost.ident.shock.simulation import simulate
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import StaticCurve
from eightpost.signals import TimeSeries
from eightpost.virtual.dynamometer import random_multisine

#: Sampling rate of the records [Hz], and that of the motions that drive the laws.
RATE, FINE = 500.0, 2000.0
#: Knots of the curves as shares of the highest speed.
SHARES = np.sign(np.linspace(-1.0, 1.0, 25)) * np.abs(np.linspace(-1.0, 1.0, 25)) ** 1.8
#: Slopes of a digressive curve at these knots [N.s/m].
DIGRESSIVE = 1200.0 + 5000.0 / (1.0 + (8.0 * SHARES) ** 2)


def curve_of(slopes=DIGRESSIVE, speed=0.8):
    """Return the curve through knots with slopes (25,) [N.s/m] up to a speed [m/s]."""
    velocity = speed * SHARES
    force = np.concatenate([[0.0], np.cumsum(0.5 * (slopes[1:] + slopes[:-1]) * np.diff(velocity))])
    return StaticCurve.through_knots(*(tuple(v.tolist()) for v in (velocity, force - force[12], slopes)))


@lru_cache
def motion(seed, duration=8.0):
    """Return displacement and velocity of a random multisine at 2 kHz."""
    drive = random_multisine(seed, duration=duration, rate=FINE).series
    velocity = np.gradient(drive["displacement"], 1.0 / FINE)
    channels = {"displacement": ("m", drive["displacement"]), "velocity": ("m/s", velocity)}
    return TimeSeries.from_channels(drive.time, channels)


def record_of(law, seed, *, duration=8.0, noise=3.0, factor=None, noise_seed=None, **conditions):
    """Return the record of a law at 500 Hz; `factor` is a function of the series and of the force that changes it."""
    fine = motion(seed, duration)
    force = simulate(law, fine)
    if factor is not None:
        force = force * factor(fine, force)
    every = round(FINE / RATE)
    series = fine.at(slice(None, None, every))
    random = np.random.default_rng(seed if noise_seed is None else noise_seed)
    return DynoTest(
        series.with_channel("force", "N", force[::every] + noise * random.standard_normal(len(series))), **conditions
    )
