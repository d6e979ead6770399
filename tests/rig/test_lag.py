"""The delay of the force behind velocity is right beside gas, friction and a curve, or it is unknown."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.ident.shock.simulation import lag as first_order
from eightpost.rig.motion import (
    EARLIEST,
    LAG,
    LATEST,
    LEAD,
    WIDEST,
    _ForceLag,
    delay_of,
    force_lag,
    lag_faults,
    lag_statement,
)
from eightpost.rig.plausibility import record_faults
from eightpost.signals import TimeSeries

SPEEDS = (0.0254, 0.0508, 0.0762, 0.127, 0.2032, 0.254)


def sines(speeds=SPEEDS, *, amplitude=0.0254, cycles=2, rate=500.0):
    """Return time, displacement and velocity of sines of some peak speeds, one after the other."""
    phase, frequency = [], np.array(speeds) / (2.0 * np.pi * amplitude)
    for one in frequency:
        phase.append(2.0 * np.pi * one * np.arange(round(cycles / one * rate)) / rate)
    angle = np.concatenate(phase)
    speed = np.repeat(speeds, [part.size for part in phase])
    return np.arange(angle.size) / rate, amplitude * np.sin(angle), speed * np.cos(angle)


def random_motion(seed=0, *, highest=15.0, seconds=8.0, rate=500.0):
    """Return time, displacement and velocity of a random sum of sines."""
    time, frequency = np.arange(round(seconds * rate)) / rate, np.linspace(0.5, highest, 30)
    size = 0.004 / np.maximum(frequency, 1.0)
    angle = 2.0 * np.pi * frequency[:, None] * time + np.random.default_rng(seed).uniform(0.0, 6.3, 30)[:, None]
    return time, size @ np.sin(angle), (size * 2.0 * np.pi * frequency) @ np.cos(angle)


def digressive(velocity):
    """Return the force of a curve with knees, steeper in rebound."""
    return np.where(velocity < 0.0, 1.6, 1.0) * (300.0 * np.tanh(velocity / 0.08) + 900.0 * velocity)


def record(motion, *, lag=2e-3, curve=digressive, stiffness=0.0, friction=0.0, noise=2.0, seed=0):
    """Return a record of a curve with gas and friction whose force is late by a lag [s]."""
    time, x, v = motion
    force = 200.0 + curve(v) + stiffness * x + friction * np.tanh(v / 4e-3)
    force = np.interp(time - lag, time, force) + noise * np.random.default_rng(seed).standard_normal(time.size)
    return TimeSeries.from_channels(time, {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", force)})


@pytest.mark.parametrize("stiffness", [0.0, 1900.0, 12000.0])
def test_gas_does_not_change_the_lag_of_sines_of_several_speeds_and_is_found_itself(stiffness):
    found = force_lag(record(sines(), lag=4e-3, stiffness=stiffness, friction=45.0))
    assert found.seconds == pytest.approx(4e-3, abs=2e-4)
    assert found.low <= 4e-3 <= found.high
    assert found.high - found.low < 1.5e-3
    assert found.stiffness == pytest.approx(stiffness, rel=0.02, abs=15.0)
    assert found.stiffness >= 0.0


@pytest.mark.parametrize("lag", [-5e-3, 30e-3])
def test_a_random_motion_shows_the_lag_to_a_fraction_of_a_millisecond(lag):
    found = force_lag(record(random_motion(), lag=lag, stiffness=2000.0, friction=20.0))
    assert found.seconds == pytest.approx(lag, abs=1e-4)
    assert found.low <= lag <= found.high
    assert found.high - found.low < 1e-3


def test_the_lag_of_first_order_of_a_compressible_shock_is_its_time_constant():
    time, x, v = sines(rate=1000.0)
    force = first_order(digressive(v), 1.5e-3, 1e-3) + 3000.0 * x
    channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", force)}
    found = force_lag(TimeSeries.from_channels(time, channels))
    assert found.seconds == pytest.approx(1.5e-3, abs=1e-4)


@pytest.mark.nightly
@settings(max_examples=150, deadline=None)
@given(
    lag=st.floats(-5e-3, 0.03), stiffness=st.floats(0.0, 5e3), friction=st.floats(0.0, 60.0), seed=st.integers(0, 999),
    speeds=st.lists(st.floats(0.02, 0.5), min_size=2, max_size=5), noise=st.floats(0.5, 15.0),
    steep=st.floats(0.0, 3.0),
)  # fmt: skip
def test_the_interval_contains_the_lag_of_any_sines_and_random_motion(
    lag, stiffness, friction, seed, speeds, noise, steep
):
    def curve(v):
        return digressive(v) + 1000.0 * steep * v * np.abs(v)

    for motion in (sines(speeds), random_motion(seed)):
        found = force_lag(
            record(motion, lag=lag, curve=curve, stiffness=stiffness, friction=friction, noise=noise, seed=seed)
        )
        assert found is None or found.low - 2e-4 <= lag <= found.high + 2e-4


def test_one_sine_shows_the_lag_of_a_curve_with_a_knee():
    found = force_lag(record(sines([0.2], cycles=8), stiffness=1500.0))
    assert found.low <= 2e-3 <= found.high


def test_a_spring_does_not_pull_so_that_a_larger_lag_than_the_loop_shows_is_less_likely_than_a_smaller_one():
    found = force_lag(record(sines([0.2], cycles=8), noise=20.0))
    assert found.low <= 2e-3 <= found.high
    assert 0.0 < found.high - found.seconds < 0.6 * (found.seconds - found.low)


def test_many_samples_do_not_make_the_lag_more_certain_than_the_model_is():
    few, many = (force_lag(record(random_motion(seconds=seconds), noise=20.0)) for seconds in (8.0, 40.0))
    for found in (few, many):
        assert 2.5e-4 < found.high - found.seconds < 5e-4
        assert 2.5e-4 < found.seconds - found.low < 5e-4


def test_a_fast_sine_has_no_lag_of_a_whole_period_more():
    time, _, v = fast = sines([0.4], amplitude=0.4 / (2.0 * np.pi * 20.0), cycles=60)
    assert force_lag(record(fast, lag=-6e-3)).seconds == pytest.approx(-6e-3, abs=2e-4)
    assert delay_of(np.interp(time - 3e-3, time, v), v, 500.0, band=50.0).seconds == pytest.approx(3e-3, abs=2e-4)


def test_the_lag_of_one_sine_and_a_straight_line_is_unknown_because_a_spring_does_the_same():
    series = record(sines([0.2], cycles=8), curve=lambda v: 2000.0 * v, stiffness=1500.0, noise=20.0)
    assert force_lag(series) is None
    assert "unknown" in lag_statement(series)


def test_a_record_without_displacement_uses_the_integral_of_its_velocity():
    series = record(sines(), stiffness=3000.0)
    found = force_lag(series.select(["velocity", "force"]))
    assert found.seconds == pytest.approx(2e-3, abs=3e-4)
    assert found.stiffness == pytest.approx(3000.0, rel=0.02)


def test_an_offset_of_velocity_is_no_displacement():
    series = record(random_motion(seconds=20.0), stiffness=3000.0).select(["velocity", "force"])
    late = force_lag(series.with_channel("velocity", "m/s", series["velocity"] + 0.02))
    assert late.seconds == pytest.approx(2e-3, abs=3e-4)
    assert late.stiffness == pytest.approx(3000.0, rel=0.1)


@pytest.mark.parametrize("rate", [100.0, 2000.0])
def test_the_sample_rate_does_not_matter(rate):
    found = force_lag(record(sines(rate=rate), lag=15e-3, stiffness=1000.0))
    assert found.seconds == pytest.approx(15e-3, abs=3e-4)


def test_parts_from_start_to_end_stand_for_a_long_record():
    time, x, v = sines(np.tile(SPEEDS, 4))
    late, early = (record((time, x, v), lag=lag) for lag in (8e-3, 2e-3))
    force = np.where(time > 0.75 * time[-1], early["force"], late["force"])
    assert 4.8e-3 < force_lag(late.with_channel("force", "N", force)).seconds < 5.7e-3


# ---- Nothing absurd -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", [sines(), sines([0.2], cycles=8), random_motion()], ids=["sines", "sine", "random"])
def test_a_force_of_the_wrong_sign_or_of_noise_has_no_lag(motion):
    turned = record(motion)
    noise = 300.0 * np.random.default_rng(3).standard_normal(len(turned))
    for force in (-turned["force"], noise, np.full(len(turned), 200.0)):
        assert force_lag(turned.with_channel("force", "N", force)) is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_correlates_with_velocity_by_chance_has_no_lag(seed):
    motion = record(random_motion(seed, seconds=4.0))
    noise = 300.0 * np.random.default_rng(seed).standard_normal(len(motion))
    assert force_lag(motion.with_channel("force", "N", noise)) is None


def test_clipping_moves_the_lag_by_less_than_a_millisecond():
    series = record(random_motion(), lag=6e-3, stiffness=1000.0)
    clipped = series.with_channel("force", "N", np.clip(series["force"], -150.0, 450.0))
    assert force_lag(clipped).seconds == pytest.approx(6e-3, abs=1e-3)


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 9999), share=st.floats(0.0, 1.0), delay=st.floats(-0.4, 0.4))
def test_no_record_has_a_lag_outside_the_search_or_a_wide_interval(seed, share, delay):
    time, x, v = random_motion(seed, highest=3.0, seconds=4.0)
    noise = np.random.default_rng(seed).standard_normal(time.size)
    force = np.interp(time - delay, time, digressive(v)) + 500.0 * share * noise
    channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", force)}
    found = force_lag(TimeSeries.from_channels(time, channels))
    if found is not None:
        assert EARLIEST < found.low < found.seconds < found.high < LATEST
        assert found.high - found.low < 2.1 * WIDEST


def test_a_force_that_is_later_than_the_search_has_no_lag():
    assert force_lag(record(random_motion(highest=3.0), lag=0.15)) is None
    assert force_lag(record(random_motion(highest=3.0), lag=-0.05)) is None


def test_a_short_record_and_one_at_rest_have_no_lag():
    series = record(random_motion())
    assert force_lag(series.at(slice(0, 240))) is None
    assert force_lag(series.at(slice(0, 150))) is None
    assert force_lag(series.with_channel("velocity", "m/s", np.zeros(len(series)))) is None


@pytest.mark.parametrize(
    ("motion", "lag"), [(sines([0.2], cycles=8), -6e-3), (random_motion(), 20e-3)], ids=["sine", "random"]
)
def test_the_lag_between_two_velocities_is_right_on_a_sine_too(motion, lag):
    time, _, v = motion
    noise = 1e-3 * np.random.default_rng(1).standard_normal(v.size)
    found = delay_of(1.3 * np.interp(time - lag, time, v) + noise, v, 500.0, band=50.0)
    assert found.seconds == pytest.approx(lag, abs=2e-4)
    assert abs(found.seconds - lag) <= 3.0 * found.spread + 1e-4


def test_channels_at_rest_have_no_lag():
    v = random_motion()[2]
    assert delay_of(v, np.zeros(v.size), 500.0, band=50.0) == (0.0, 0.0, 0.0)


# ---- What is stated --------------------------------------------------------------------------------------------------


def test_the_statement_has_the_lag_and_its_interval():
    found = force_lag(record(sines()))
    assert str(_ForceLag(2e-3, 1.25e-3, 0.01)) == "2 ms (1.25 to 10 ms)"
    assert f"lag of the force behind velocity: {found}" in lag_statement(record(sines()))


def rules(series):
    return [reason.rule.name for reason in lag_faults(series)]


def test_only_a_lag_that_a_shock_certainly_does_not_have_is_a_reason():
    assert rules(record(sines(), lag=LAG + 1.5e-3)) == ["late force"]
    assert rules(record(sines(), lag=LAG)) == []
    assert rules(record(random_motion(), lag=-1.3e-3)) == []
    assert rules(record(random_motion(rate=2000.0), lag=-LEAD - 1e-4)) == []
    assert rules(record(random_motion(rate=2000.0), lag=-LEAD - 5e-4)) == ["early force"]
    assert rules(record(sines([0.2], cycles=8), curve=lambda v: 2000.0 * v, lag=30e-3)) == []


def test_a_lead_is_stated_without_a_minus():
    series = record(random_motion(), lag=-5e-3)
    (reason,) = lag_faults(series)
    lag = force_lag(series)
    assert reason.figure == f"by {_ForceLag(-lag.seconds, -lag.high, -lag.low)}"
    assert 0.0 < -lag.high < -lag.low


def test_a_velocity_that_is_a_difference_of_positions_makes_no_early_force():
    """It is half a sample late; at 100 Hz this is 5 ms."""
    assert rules(record(sines(rate=100.0), lag=-5e-3)) == []


def test_the_reasons_of_a_record_have_the_lag():
    series = record(sines(), lag=20e-3)
    (reason,) = record_faults(series, measured=series.names)
    assert reason.rule.name == "late force"
    assert reason.figure == f"by {force_lag(series)}"
