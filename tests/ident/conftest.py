"""Synthetic dynamometer records for the tests of the shock fit."""

from functools import lru_cache

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import CurveBasis
from eightpost.ident.shock.simulation import lag, simulate
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1, Port, StaticCurve
from eightpost.signals import TimeSeries
from eightpost.virtual.dynamometer import random_multisine

FINE = 20000.0
INNER = (2600.0, 90.0, -1500.0, 60.0, 700.0, *[0.0] * 10)


@lru_cache
def motion(seed, duration=10.5):
    """Return displacement and velocity of a Table 3.2 multisine at 20 kHz."""
    drive = random_multisine(seed, duration=duration, rate=FINE, draws=8).series
    velocity = np.gradient(drive["displacement"], 1.0 / FINE)
    return drive.with_channel("velocity", "m/s", velocity)


def sampled(series, force, rate, seed, noise=1.0):
    """Return the record of a dynamometer with 1 N, 10 um and 0.5 mm/s of noise at a sampling rate."""
    every = round(FINE / rate)
    generator = np.random.default_rng(seed)
    channels = {
        "force": ("N", force),
        "velocity": ("m/s", series["velocity"]),
        "displacement": ("m", series["displacement"]),
    }
    sizes = {"force": 1.0, "velocity": 5e-4, "displacement": 1e-5}
    noisy = {
        name: (unit, values[::every] + noise * sizes[name] * generator.standard_normal(values[::every].size))
        for name, (unit, values) in channels.items()
    }
    return DynoTest(TimeSeries.from_channels(series.time[::every], noisy))


@pytest.fixture(scope="session")
def curve():
    """Return a curve whose cubics join the inner polynomial in value and slope, as in a fit."""
    k = np.arange(1, 16)
    compression = (float(np.sum(INNER)), float(k @ INNER), -150.0, 30.0)
    rebound = (float((-1.0) ** k @ INNER), float(-((-1.0) ** (k - 1) * k) @ INNER), 200.0, -60.0)
    return StaticCurve(INNER, compression, rebound, 0.381, 0.0127, 2.0, 2.0, 1000.0, 1000.0)


@pytest.fixture(scope="session")
def rising():
    """Return a curve that rises everywhere, steep at low speed, with cubics that join in value and slope."""
    inner = (2600.0, 90.0, -1000.0, 60.0, 300.0, *[0.0] * 10)
    k = np.arange(1, 16)
    compression = (float(np.sum(inner)), float(k @ inner), 150.0, 30.0)
    rebound = (float((-1.0) ** k @ inner), float(-((-1.0) ** (k - 1) * k) @ inner), -200.0, -60.0)
    return StaticCurve(inner, compression, rebound, 0.381, 0.0127, 2.0, 2.0, 1000.0, 1000.0)


@pytest.fixture(scope="session")
def law_record():
    """Make a record of a law: law_record(law, seed, rate=2000, noise=1)."""

    @lru_cache
    def make(law, seed, *, rate=2000.0, noise=1.0, slower=1.0):
        series = motion(seed)
        series = TimeSeries(series.time, series.values / slower, series.names, series.units)
        return sampled(series, simulate(law, series), rate, seed, noise)

    return make


@pytest.fixture(scope="session")
def smooth_fit(curve, law_record):
    """The fit of LPF1 to a record of LPF1 with a smooth curve and a lag of 1.3 ms."""
    return fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1", name="build 1")


@pytest.fixture(scope="session")
def knots(smooth_fit):
    """A curve through the knots that a fit uses, so that a law with it is inside the class of the fit."""
    return smooth_fit.shock.law.curve


def digressive(velocity):
    """Return the force [N] of a smooth asymmetric valve, steep near zero velocity and not a polynomial."""
    nose = 5200.0 * velocity / np.sqrt(1.0 + (velocity / 0.0762) ** 2) + 1500.0 * velocity
    return nose * (1.0 - 0.2 * np.tanh(velocity / 0.15))


@pytest.fixture(scope="session")
def digressive_record():
    """Make a record of the digressive valve behind 1.7 ms of lag."""

    @lru_cache
    def make(seed):
        series = motion(seed)
        return sampled(series, lag(digressive(series["velocity"]), 1.7e-3, 1.0 / FINE), 2000.0, seed)

    return make


@pytest.fixture(scope="session")
def gas_port():
    """A gas force of the size of the dissertation's: 46 lbf and 4 lbf/in."""
    return Port(gas_preload=204.6, gas_stiffness=700.0)


@pytest.fixture(scope="session")
def basis():
    """Return the basis with the dissertation's transition."""
    return CurveBasis(0.381, 0.0127)
