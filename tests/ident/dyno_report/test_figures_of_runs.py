"""Every figure of a run is that of a shock whose closed form is known."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from eightpost.ident.dyno_report.builds import CarCorner
from eightpost.ident.dyno_report.cycles import STROKES, Unknown, cycles_of, force_at_rest, slow_figures
from eightpost.ident.dyno_report.entry import entry_of_test, with_gas_of_slow_runs
from eightpost.ident.dyno_report.loop import forces_at, ratio_at
from eightpost.signals import TimeSeries
from eightpost.virtual.dynamometer import random_multisine

from .conftest import RATE, run, sine, two_lines, valve, viscous

pytestmark = pytest.mark.filterwarnings("error")

#: Shrinking takes minutes, and a failing shock is as readable as a smaller one.
QUICK = settings(deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
RATES = st.floats(800.0, 20_000.0)


def entry(series, **conditions):
    return entry_of_test(run(series, **conditions), "run", "build")


# ---- Energy, hysteresis, lag ----------------------------------------------------------------------------------------


@settings(QUICK, max_examples=20)
@given(RATES, st.floats(0.0, 0.012), st.floats(0.0, 4000.0), st.floats(1.0, 4.0))
def test_the_width_at_zero_velocity_is_that_of_lag_and_gas_spring(rate, lag, stiffness, frequency):
    amplitude, w = 0.02, 2.0 * np.pi * frequency
    force = valve(viscous(rate), viscous(rate), stiffness=stiffness, gas=90.0)
    cycles = cycles_of(sine(force, amplitude=amplitude, frequency=frequency, lag=lag))
    expected = 2.0 * (rate * amplitude * w * np.sin(w * lag) + stiffness * amplitude * np.cos(w * lag))
    assert cycles.width == pytest.approx(expected, rel=0.01, abs=0.002 * rate * amplitude * w)


@pytest.mark.slow
@settings(QUICK, max_examples=6)
@given(RATES, RATES, st.floats(0.0, 0.02), st.floats(0.03, 0.2))
def test_the_lag_is_the_delay_of_the_force_for_every_curve(compression, rebound, lag, knee):
    force = valve(two_lines(compression, 0.3 * compression, knee), two_lines(rebound, 0.5 * rebound, knee))
    assert entry(sine(force, lag=lag)).lag == pytest.approx(lag, abs=2e-4)


def test_a_force_that_has_nothing_to_do_with_velocity_has_no_lag():
    noise = np.random.default_rng(1).normal(size=6000)
    series = sine(lambda v, x: noise[: v.size] * 100.0)
    assert isinstance(entry(series).lag, Unknown)


def test_the_peaks_are_the_forces_at_the_highest_speeds():
    series = sine(valve(viscous(3000.0), viscous(5000.0), gas=100.0), amplitude=0.02, frequency=2.0)
    top = 0.02 * 2.0 * np.pi * 2.0
    for sign, rate in ((1.0, 3000.0), (-1.0, 5000.0)):
        (peak,) = cycles_of(series).peaks(sign)
        assert peak.count >= 10
        assert peak.speed == pytest.approx(top, rel=0.005)
        assert peak.force == pytest.approx(rate * peak.speed + sign * 100.0, rel=1e-6)


def test_a_random_motion_has_no_energy_per_cycle_and_a_short_one_no_cycle():
    drive = random_multisine(1, duration=10.0)
    series = motion_of(drive)
    cycles = cycles_of(series)
    assert isinstance(cycles.energy, Unknown) and "split" in cycles.energy.reason
    short = cycles_of(sine(valve(viscous(1e3), viscous(1e3)), duration=0.8))
    assert isinstance(short.energy, Unknown) and "two whole cycles" in short.energy.reason


def motion_of(drive, force=None, lag=0.0):
    """Return the record of a drive file's motion with a force of velocity and displacement, delayed by a lag [s]."""
    series = drive.series
    x = series[series.names[0]]
    v = np.gradient(x, series.time)
    f = (force or valve(viscous(2e3), viscous(2e3)))(v, x)
    return TimeSeries.from_channels(series.time, {
        "velocity": ("m/s", v), "displacement": ("m", x), "force": ("N", np.interp(series.time - lag, series.time, f)),
    })  # fmt: skip


def test_the_force_at_rest_is_exact_without_a_lag():
    force = valve(viscous(1500.0), viscous(6000.0), gas=200.0, stiffness=700.0)
    series = motion_of(random_multisine(1, duration=20.0), force)
    middle = 0.5 * (series["displacement"].max() + series["displacement"].min())
    assert force_at_rest(series) == pytest.approx(200.0 + 700.0 * middle, rel=1e-3)


def test_the_force_at_rest_of_a_sine_is_the_mean_of_both_ends():
    series = sine(valve(viscous(1500.0), viscous(6000.0), gas=200.0, stiffness=700.0), lag=0.002, ends=0.01)
    assert isinstance(force_at_rest(series), Unknown)
    assert entry(series).offset == pytest.approx(207.0, abs=2.0)


# ---- Curves, knees, ratios ------------------------------------------------------------------------------------------


def test_a_straight_stroke_has_no_knee_and_one_slope():
    for stroke, rate in zip(STROKES, (2500.0, 4000.0), strict=True):
        one = entry(sine(valve(viscous(2500.0), viscous(4000.0), gas=120.0))).strokes[stroke]
        assert isinstance(one.knee, Unknown) and "no knee" in one.knee.reason
        assert one.low == one.high == pytest.approx(rate, rel=0.005)


def test_the_curve_reaches_the_highest_speed_and_is_not_extrapolated():
    found = entry(sine(valve(viscous(2e3), viscous(2e3)), amplitude=0.02, frequency=2.0))
    top = 0.02 * 4.0 * np.pi
    assert found.highest == pytest.approx(top, rel=0.005)
    beyond = found.curve.force_at(1.05 * top, "compression")
    assert isinstance(beyond, Unknown) and "in/s" in beyond.reason


def test_a_ratio_needs_forces_against_the_motion():
    found = entry(sine(valve(viscous(2e3), viscous(-500.0))))
    assert isinstance(ratio_at(found.curve, 0.1), Unknown)


# ---- Gas force and friction -----------------------------------------------------------------------------------------


def slow_record(gas, stiffness, friction, rate, *, holds, noise=0.0):
    """Return a slow triangle, or steps with holds, about 10 mm, with a seal drag that acts at rest too."""
    if holds:
        levels = np.concatenate([np.arange(0, 6), np.arange(4, -1, -1), np.arange(1, 6)]) * 0.004
        parts = [np.full(2000, levels[0])]
        for a, b in pairwise(levels):
            parts += [np.linspace(a, b, 800), np.full(2000, b)]
        x = np.concatenate(parts) - 0.010
    else:
        x = 0.010 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * 0.1 * np.arange(30_000) / RATE))
    time = np.arange(x.size) / RATE
    v = np.gradient(x, time)
    direction = np.where(np.abs(v) > 1e-5, np.sign(v), 0.0)
    moving = np.flatnonzero(direction)
    direction = direction[moving[np.maximum(np.searchsorted(moving, np.arange(x.size), "right") - 1, 0)]]
    force = gas + stiffness * x + friction * direction + rate * v
    force = force + noise * np.random.default_rng(0).normal(size=x.size)
    return TimeSeries.from_channels(
        time, {"velocity": ("m/s", v), "displacement": ("m", x + 0.03), "force": ("N", force)}
    )


@settings(QUICK, max_examples=10)
@given(st.floats(-100.0, 400.0), st.floats(0.0, 5000.0), st.floats(2.0, 60.0))
def test_gas_force_stiffness_and_friction_are_found_in_steps_with_holds(gas, stiffness, friction):
    found = slow_figures(slow_record(gas, stiffness, friction, 3000.0, holds=True, noise=1.0))
    assert found.gas_force == pytest.approx(gas, abs=0.5)
    assert found.stiffness == pytest.approx(stiffness, rel=0.01, abs=20.0)
    assert found.friction == pytest.approx(friction, abs=0.5)
    assert found.residual == pytest.approx(1.0, rel=0.2)


def test_at_one_speed_gas_force_and_stiffness_are_known_and_friction_is_not():
    found = slow_figures(slow_record(150.0, 2000.0, 20.0, 3000.0, holds=False))
    assert found.gas_force == pytest.approx(150.0, abs=0.1)
    assert found.stiffness == pytest.approx(2000.0, rel=1e-3)
    assert isinstance(found.friction, Unknown) and "one speed" in found.friction.reason


def test_friction_and_valves_are_distinguished_in_a_slow_sine():
    force = valve(viscous(3000.0), viscous(3000.0), gas=120.0, stiffness=1500.0, friction=25.0)
    found = slow_figures(sine(force, amplitude=0.02, frequency=0.15, duration=20.0))
    assert found.gas_force == pytest.approx(120.0, abs=0.2)
    assert found.stiffness == pytest.approx(1500.0, rel=0.002)
    assert found.friction == pytest.approx(25.0, abs=0.2)


def test_a_fast_sine_has_no_gas_force_and_one_without_displacement_no_stiffness():
    fast = slow_figures(sine(valve(viscous(2e3), viscous(2e3), gas=100.0)))
    assert isinstance(fast.gas_force, Unknown) and "slower than 10 mm/s" in fast.gas_force.reason
    without = slow_figures(slow_record(100.0, 1000.0, 20.0, 0.0, holds=False).select(["velocity", "force"]))
    assert isinstance(without.stiffness, Unknown) and "displacement" in without.stiffness.reason


def test_a_negative_friction_is_no_friction():
    found = slow_figures(slow_record(100.0, 1000.0, -30.0, 0.0, holds=True))
    assert all(isinstance(one, Unknown) for one in (found.gas_force, found.stiffness, found.friction))
    assert "negative friction" in found.friction.reason


def test_a_record_of_holds_has_no_lag():
    found = entry(slow_record(100.0, 1000.0, 30.0, 0.0, holds=True))
    assert isinstance(found.lag, Unknown)


def test_a_slow_motion_in_one_direction_does_not_show_friction():
    time = np.arange(6000) / RATE
    series = TimeSeries.from_channels(time, {
        "velocity": ("m/s", np.full(6000, 0.005) + 1e-6 * time), "displacement": ("m", 0.005 * time),
        "force": ("N", 100.0 + 200.0 * time),
    })  # fmt: skip
    found = slow_figures(series)
    assert isinstance(found.friction, Unknown) and "one direction" in found.friction.reason


def test_warming_energy_and_power_are_those_of_the_record():
    series = sine(valve(viscous(2e3), viscous(2e3)), duration=6.0, heat=lambda t: 300.0 + 0.5 * t)
    warming = entry(series).warming
    w = 4.0 * np.pi
    assert warming.start == pytest.approx(300.0 + 0.5 * 0.3, abs=1e-3)
    assert warming.drift == pytest.approx(0.5 * 5.4, abs=1e-6)
    assert warming.energy == pytest.approx(12.0 * np.pi * 2e3 * w * 0.025**2, rel=1e-3)
    assert warming.power == pytest.approx(warming.energy / 6.0, rel=1e-3)
    cold = entry(sine(valve(viscous(2e3), viscous(2e3)))).warming
    assert isinstance(cold.drift, Unknown) and "no temperature" in cold.drift.reason


@given(st.floats(50.0, 800.0), st.floats(5e3, 3e5), st.floats(0.3, 1.5), st.floats(0.01, 0.95))
def test_the_damping_ratio_is_that_of_the_eigenvalues(mass, rate, motion_ratio, share):
    c = share * 2.0 * np.sqrt(rate * mass) / motion_ratio**2
    matrix = np.array([[0.0, 1.0], [-rate / mass, -c * motion_ratio**2 / mass]])
    poles = np.linalg.eigvals(matrix)
    expected = -poles[0].real / abs(poles[0])
    assert CarCorner("lf", mass, rate, motion_ratio).damping_ratio(c) == pytest.approx(expected, rel=1e-6)


@pytest.mark.nightly
@settings(QUICK, max_examples=15)
@given(st.floats(50.0, 400.0), st.floats(0.0, 2000.0), st.floats(0.0, 120.0))
def test_a_fast_run_has_the_gas_force_of_the_slow_run_of_its_setting_subtracted(gas, stiffness, held):
    """The fast sine holds back a force that the slow run does not have, as at the ends of its stroke."""
    slow = entry(slow_record(gas, stiffness, 20.0, 3000.0, holds=True), clicks="4")
    force = valve(viscous(2000.0), viscous(2000.0), gas=gas + held - 0.03 * stiffness, stiffness=stiffness)
    fast, other = (entry(sine(force, ends=0.03), clicks=clicks) for clicks in ("4", "8"))
    found = with_gas_of_slow_runs([slow, fast, other])
    assert found[0] is slow
    assert found[2] is other
    assert found[1].level == pytest.approx(gas, abs=2.0)
    assert other.level == pytest.approx(gas + held, abs=2.0)
    for stroke, sign in (("compression", 1.0), ("rebound", -1.0)):
        expected = 400.0 + sign * held
        assert forces_at(found[1].curve, 0.2, stroke) == pytest.approx(expected, abs=0.02 * expected + 3.0)
    assert "from the slow run" in found[1].notes[-1]
