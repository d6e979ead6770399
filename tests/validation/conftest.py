"""Shocks with known parameters, and the dynamometer records that they would give."""

from functools import lru_cache

import numpy as np
import pytest

from eightpost.ident.shock.simulation import simulate
from eightpost.rig.dyno_test import DynoConditions, DynoTest
from eightpost.shock import Lpf1, Polylinear, Port, Shock, StaticCurve
from eightpost.signals import TimeSeries
from eightpost.virtual.dynamometer import random_multisine

INCH, POUND = 0.0254, 4.4482216152605

#: Table 3.3: amplitude [in] and peak velocity [in/s].
TABLE_3_3 = (
    (1.0, 1.0), (1.0, 3.0), (1.0, 6.0), (1.0, 10.0), (1.0, 20.0), (1.0, 30.0), (0.5, 5.0), (0.5, 10.0), (0.5, 20.0),
    (0.25, 10.0), (0.25, 20.0), (0.1, 2.5), (0.1, 5.0), (0.1, 10.0),
)  # fmt: skip

#: The gas spring that the records have: 46 lbf and 4 lbf/in, about 3 in.
GAS = Port(gas_preload=204.6, gas_stiffness=700.0)
REFERENCE = 3.0 * INCH


def _curve():
    """Return a digressive curve whose cubics join the inner polynomial in value and slope."""
    inner = (2600.0, 90.0, -1500.0, 60.0, 700.0, *[0.0] * 10)
    k = np.arange(1, 16)
    compression = (float(np.sum(inner)), float(k @ inner), -150.0, 30.0)
    rebound = (float((-1.0) ** k @ inner), float(-((-1.0) ** (k - 1) * k) @ inner), 200.0, -60.0)
    return StaticCurve(inner, compression, rebound, 0.381, 0.0127, 2.0, 2.0, 1000.0, 1000.0)


def shock_of(law, name="known", **conditions):
    """Return a shock with a given law."""
    return Shock(name, law, conditions={"displacement_reference [m]": REFERENCE, **conditions})


@pytest.fixture(scope="session")
def truth():
    """Return the true law of the records, with a lag of 1.7 ms."""
    return Lpf1(_curve(), port=GAS, time_constant=1.7e-3)


@pytest.fixture(scope="session")
def lagged(truth):
    """Return a shock with the true law."""
    return shock_of(truth)


@pytest.fixture(scope="session")
def static_curve(truth):
    """Return a shock with the true law without its lag."""
    return shock_of(Polylinear(truth.curve, port=GAS))


def record(law, displacement, rate, *, noise=1.0, extra=None, conditions=None):
    """Return a record of a law for a displacement (N,) [m] with 1 N, 10 um and 0.5 mm/s of noise."""
    time = np.arange(displacement.size) / rate
    velocity = np.gradient(displacement, 1.0 / rate)
    channels = {"velocity": ("m/s", velocity), "displacement": ("m", displacement)}
    about = {**channels, "displacement": ("m", displacement - REFERENCE)}
    force = simulate(law, TimeSeries.from_channels(time, about))
    generator = np.random.default_rng(displacement.size)
    sizes = {"velocity": 5e-4, "displacement": 1e-5, "force": 1.0}
    channels["force"] = ("N", force if extra is None else force + extra)
    noisy = {
        name: (unit, values + noise * sizes[name] * generator.standard_normal(values.size))
        for name, (unit, values) in channels.items()
    }
    return DynoTest(TimeSeries.from_channels(time, noisy), conditions or DynoConditions())


def sine_path(amplitude, velocity, periods=4, rate=2000.0):
    """Return a sine of Table 3.3 [in, in/s] with rest before and after it."""
    frequency = velocity / (2.0 * np.pi * amplitude)
    time = np.arange(round(max(periods / frequency, 0.8) * rate) + 1) / rate
    count = np.floor(time[-1] * frequency)
    wave = np.where(time * frequency <= count, np.sin(2.0 * np.pi * frequency * time), 0.0)
    return REFERENCE + amplitude * INCH * wave


def ramps(times, positions, rate):
    """Return straight lines between positions [in] at times [s]."""
    time = np.arange(round(times[-1] * rate) + 1) / rate
    return INCH * np.interp(time, times, positions)


def bump_path(rate=2000.0):
    """0.5 in up at 30 in/s, and down again a second later; corners of 2 ms."""
    ramp = 0.5 / 30.0
    path = ramps([0.0, 1.0, 1.0 + ramp, 2.0, 2.0 + ramp, 3.0], [3.0, 3.0, 3.5, 3.5, 3.0, 3.0], rate)
    kernel = np.hanning(9)[1:-1]
    return np.convolve(np.pad(path, 3, mode="edge"), kernel / kernel.sum(), mode="valid")


def static_path(rate=100.0, hold=20.0):
    """Fig 3.12: from 2 in, three steps of 1 in at 0.2 in/s and three back, a hold after each."""
    times, positions = [0.0, hold], [2.0, 2.0]
    for step in (1, 1, 1, -1, -1, -1):
        times += [times[-1] + 5.0, times[-1] + 5.0 + hold]
        positions += 2 * [positions[-1] + step]
    return ramps(times, positions, rate)


def dragged(path, drag):
    """Return a Coulomb drag [N] that keeps the direction of the last motion at rest, like that of a seal."""
    way = np.sign(np.round(np.gradient(path), 9))
    moved = np.maximum.accumulate(np.where(way != 0.0, np.arange(way.size), 0))
    return drag * way[moved]


@pytest.fixture(scope="session")
def random_test(truth):
    """Make a random record of the truth: random_test(seed, conditions=None)."""

    @lru_cache
    def make(seed, conditions=None):
        drive = random_multisine(seed, duration=10.5, draws=4).series
        return record(truth, REFERENCE + drive["displacement"], 2000.0, conditions=conditions)

    return make


@pytest.fixture(scope="session")
def sine_test(truth):
    """Make a sine record of the truth: sine_test(amplitude, velocity)."""
    return lru_cache(lambda amplitude, velocity: record(truth, sine_path(amplitude, velocity), 2000.0))


@pytest.fixture(scope="session")
def bump_test(truth):
    return record(truth, bump_path(), 2000.0)


@pytest.fixture(scope="session")
def static_test(truth):
    path = static_path()
    return record(truth, path, 100.0, extra=dragged(path, 20.0))
