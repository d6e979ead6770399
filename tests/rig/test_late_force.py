"""The phase over the frequency distinguishes a late force from a shock's own lag, from gas and from hysteresis."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.rig.force_scale import lag_statement
from eightpost.rig.late_force import MOST_LAG, band_lags, delay_reasons, delay_statement
from eightpost.signals import TimeSeries

RATE, SECONDS = 500.0, 10.0


def motion(time, highest, seed):
    """Return displacement and velocity of a random sum of sines from 0.5 Hz to the highest frequency."""
    random = np.random.default_rng(seed)
    frequency = np.linspace(0.5, highest, 40) if highest > 0.5 else np.array([highest])
    size = 0.02 / np.sqrt(frequency.size) / np.maximum(frequency, 1.0)
    angle = 2.0 * np.pi * frequency[:, None] * time + random.uniform(0.0, 6.3, frequency.size)[:, None]
    return size @ np.sin(angle), (size * 2.0 * np.pi * frequency) @ np.cos(angle)


def record(*, delay=0.0, lag=8e-4, stiffness=2e3, friction=0.0, highest=20.0, seed=0):
    """Return the record of a digressive shock with gas and friction; the instruments delay its force."""
    time = np.arange(int(RATE * SECONDS)) / RATE
    x, v = motion(time, highest, seed)
    path, _ = motion(time - delay, highest, seed)
    speed = motion(time - delay - lag, highest, seed)[1]
    force = 150.0 + 400.0 * np.tanh(speed / 0.08) + 2500.0 * speed + stiffness * path
    force += friction * np.tanh((path - np.roll(path, 4)) / 1e-4)
    noise = np.random.default_rng(seed + 1).standard_normal((3, time.size))
    channels = {"displacement": ("m", x + 2e-6 * noise[0]), "velocity": ("m/s", v + 1e-4 * noise[1])}
    return TimeSeries.from_channels(time, channels | {"force": ("N", force + 2.0 * noise[2])})


@pytest.mark.nightly
@settings(max_examples=8, deadline=None)
@given(
    delay=st.floats(3.5e-3, 0.015), lag=st.floats(0.0, 1.5e-3), stiffness=st.floats(0.0, 2e4), seed=st.integers(0, 99)
)
def test_a_delay_is_found_in_both_bands_to_a_fraction_of_a_millisecond(delay, lag, stiffness, seed):
    series = record(delay=delay, lag=lag, stiffness=stiffness, seed=seed)
    for band in band_lags(series):
        assert band.seconds == pytest.approx(delay + lag, abs=4e-4)
    (reason,) = delay_reasons(series, "run")
    assert float(re.search(r"a delay of ([\d.]+) ms", reason.figure)[1]) == pytest.approx(1e3 * (delay + lag), abs=0.6)
    assert "advance the force" in reason.remedy


@settings(max_examples=8, deadline=None)
@given(lag=st.floats(0.0, 0.8 * MOST_LAG), stiffness=st.floats(0.0, 2e4), friction=st.floats(0.0, 200.0),
       seed=st.integers(0, 99))  # fmt: skip
def test_lag_gas_and_friction_of_a_shock_are_no_delay(lag, stiffness, friction, seed):
    series = record(lag=lag, stiffness=stiffness, friction=friction, seed=seed)
    assert not list(delay_reasons(series, "run"))


def test_a_delay_is_a_reason_of_the_record_and_a_statement():
    late = record(delay=6e-3)
    assert any(delay_reasons(late, "run"))
    assert "delay the force by about 6.8 ms" in lag_statement(late)
    assert "at most 0.8" in delay_statement(record())


@pytest.mark.parametrize("highest", [0.5, 1.0])
def test_a_record_without_different_frequencies_leaves_the_delay_unknown(highest):
    for delay in (0.0, 8e-3):
        series = record(delay=delay, highest=highest)
        assert not list(delay_reasons(series, "run"))
        assert "is unknown" in delay_statement(series)


def test_a_lag_at_low_frequencies_alone_may_be_hysteresis():
    assert "which hysteresis causes too" in delay_statement(record(delay=8e-3, highest=4.0))


def test_a_short_record_has_no_bands():
    assert band_lags(record().at(slice(0, 300))) is None
