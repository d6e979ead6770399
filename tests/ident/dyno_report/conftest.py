"""Records of shocks whose figures are known in closed form."""

import numpy as np

from eightpost.rig import DynoConditions, DynoTest
from eightpost.signals import TimeSeries

RATE = 1000.0


def sine(force, *, amplitude=0.025, frequency=2.0, duration=6.0, lag=0.0, rate=RATE, heat=None, ends=0.0):
    """Return a record of a sine that starts at the extended end.

    Args:
        force: Function of velocity (N,) [m/s] and displacement (N,) [m] that returns the force (N,) [N].
        lag: Delay of the force [s].
        ends: Centre of the stroke [m].
    """
    time = np.arange(round(duration * rate)) / rate
    w = 2.0 * np.pi * frequency

    def motion(t):
        return amplitude * w * np.sin(w * t), ends - amplitude * np.cos(w * t)

    velocity, displacement = motion(time)
    channels = {"velocity": ("m/s", velocity), "displacement": ("m", displacement),
                "force": ("N", force(*motion(time - lag)))}  # fmt: skip
    if heat is not None:
        channels["temperature"] = ("K", heat(time))
    return TimeSeries.from_channels(time, channels)


def run(series, **conditions):
    """Return the test of a record."""
    return DynoTest(series, DynoConditions(**conditions))


def two_lines(low, high, knee):
    """Return the force magnitude over speed of two lines that meet at a knee."""
    return lambda speed: np.where(speed < knee, low * speed, low * knee + high * (speed - knee))


def valve(compression, rebound, *, gas=0.0, stiffness=0.0, friction=0.0):
    """Return a force of velocity and displacement from the magnitudes over speed of both strokes."""

    def force(velocity, displacement):
        strokes = np.where(velocity > 0.0, compression(np.abs(velocity)), -rebound(np.abs(velocity)))
        return strokes + gas + stiffness * displacement + friction * np.sign(velocity)

    return force


def viscous(rate):
    """Return the force magnitude over speed of a linear stroke."""
    return lambda speed: rate * speed
