"""A force that is recorded too early is reported; what a shock does itself is not."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.rig.cycles import run_down
from eightpost.rig.skew import skew_reasons
from eightpost.signals import TimeSeries

RATE, SECONDS = 500.0, 10.0


def motion(time, *, sines, seed=0):
    """Return displacement, velocity and acceleration of a random sum of sines, or of one sine."""
    random = np.random.default_rng(seed)
    frequency = np.array([2.0]) if sines == 1 else np.linspace(0.4, 9.0, sines)
    size = 0.02 / np.sqrt(sines) / np.maximum(frequency, 1.0)
    angle = 2.0 * np.pi * frequency[:, None] * time + random.uniform(0.0, 6.3, sines)[:, None]
    omega = 2.0 * np.pi * frequency
    return size @ np.sin(angle), (size * omega) @ np.cos(angle), -(size * omega**2) @ np.sin(angle)


def record(*, skew=0.0, lag=5e-4, stiffness=2e3, mass=0.0, sines=30, seed=0):
    """Return the record of a digressive shock with gas, moved mass and a lag; the force is recorded late by `skew`."""
    time = np.arange(int(RATE * SECONDS)) / RATE
    x, v, _ = motion(time, sines=sines, seed=seed)
    path, _, acceleration = motion(time - skew, sines=sines, seed=seed)
    speed = motion(time - skew - lag, sines=sines, seed=seed)[1]
    force = 150.0 + 400.0 * np.tanh(speed / 0.08) + 2500.0 * speed + stiffness * path + mass * acceleration
    noise = np.random.default_rng(seed + 1).standard_normal((3, time.size))
    channels = {"displacement": ("m", x + 2e-6 * noise[0]), "velocity": ("m/s", v + 1e-4 * noise[1])}
    return TimeSeries.from_channels(time, channels | {"force": ("N", force + 2.0 * noise[2])})


@pytest.mark.parametrize("skew", [-0.003, -0.005])
def test_a_force_that_is_recorded_too_early_is_reported_with_a_lower_bound_of_its_lead(skew):
    (reason,) = skew_reasons(record(skew=skew), "run")
    stated = 1e-3 * float(re.search(r"leads by ([\d.]+) ms", reason.figure)[1])
    assert 0.4 * -skew < stated <= -skew
    assert reason.remedy.startswith(f"delay the force by at least {1e3 * stated:.2g} ms")


@pytest.mark.nightly
@settings(max_examples=30, deadline=None)
@given(
    lag=st.floats(0.0, 8e-3), stiffness=st.floats(0.0, 2e4), mass=st.floats(0.0, 1.5), sines=st.sampled_from([1, 30]),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_lag_gas_and_mass_of_a_shock_are_no_skew(lag, stiffness, mass, sines, seed):
    series = record(lag=lag, stiffness=stiffness, mass=mass, sines=sines, seed=seed)
    assert not list(skew_reasons(series, "run"))


def test_a_lead_in_one_stroke_alone_is_no_skew():
    early, right = record(skew=-5e-3), record()
    force = np.where(right["velocity"] > 0.0, early["force"], right["force"])
    assert not list(skew_reasons(right.with_channel("force", "N", force), "run"))


@settings(max_examples=30, deadline=None)
@given(
    strokes=st.tuples(st.floats(0.005, 0.025), st.floats(0.005, 0.025)),
    frequencies=st.tuples(st.floats(1.0, 4.0), st.floats(0.5, 4.0)),
)
def test_a_sine_that_follows_another_is_no_run_down(strokes, frequencies):
    cycles = 8
    parts = [
        stroke * np.sin(2.0 * np.pi * frequency * np.arange(int(RATE * cycles / frequency)) / RATE)
        for stroke, frequency in zip(strokes, frequencies, strict=True)
    ]
    path = np.concatenate(parts)
    assert run_down(np.arange(path.size) / RATE, path, np.gradient(path, 1.0 / RATE)) is None
