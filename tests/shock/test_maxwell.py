"""Maxwell's law (a curve and a spring in series) for any step: a stiff solver as reference, its limits, and energy."""

from dataclasses import replace
from itertools import pairwise, product
from math import exp

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from eightpost.shock import Lpf1, Maxwell, Polylinear, Port
from eightpost.shock.law import Piece, Valve, valve_force
from eightpost.shock.maxwell import advance_core, velocity_under

from .example_curve import curve

STIFFNESS = 3.5e6


def straight(slope, **changes):
    """Return a straight line with a slope [N.s/m]."""
    at = slope * 0.381
    return curve(
        inner=(at, *[0.0] * 14), compression=(at, at, 0.0, 0.0), rebound=(-at, -at, 0.0, 0.0), compression_slope=slope,
        rebound_slope=slope, **changes,
    )  # fmt: skip


LAW = Maxwell(curve(), STIFFNESS)
few = settings(max_examples=25)
velocities = st.floats(-2.0, 2.0)
stiffnesses = st.floats(1e4, 1e12)
steps = st.floats(1e-9, 10.0)


def exact(law, force, velocity, stop):
    """Return F [N] by Radau at 1e-10, with w by Brent's method, for a damper velocity(t)."""

    def rate(t, forces):
        w = brentq(lambda w: law.static_force(w) - forces[0], -50.0, 50.0, xtol=1e-15, rtol=1e-15)
        return [law.series_stiffness * (velocity(t) - w)]

    solution = solve_ivp(rate, (0.0, stop), [force], method="Radau", rtol=1e-10, atol=1e-8)
    assert solution.success
    return solution.y[0, -1]


def followed(law, force, velocity, stop, count):
    times = np.linspace(0.0, stop, count + 1)
    for start, end in pairwise(times):
        force = law.follow(force, velocity(start), velocity(end), end - start)
    return force


def slow_sine(t):
    """Return a velocity [m/s] within the inner polynomial, where the curve is smooth."""
    return 0.3 * np.sin(2.0 * np.pi * 8.0 * t)


@pytest.mark.nightly
def test_the_error_falls_with_the_square_of_the_step():
    start, stop = LAW.static_force(0.0), 0.03
    truth = exact(LAW, start, slow_sine, stop)
    errors = [abs(followed(LAW, start, slow_sine, stop, n) - truth) for n in (60, 120, 240)]
    assert np.diff(np.log2(errors)) == pytest.approx(-2.0, abs=0.1)


def test_the_error_under_a_held_velocity_falls_even_faster():
    """Because of the correction for the curve's deviation from its chord: 2.5e-7 N of 124 N in eight steps."""
    truth = exact(LAW, 0.0, lambda t: 0.05, 1e-3)
    errors = [abs(followed(LAW, 0.0, lambda t: 0.05, 1e-3, n) - truth) for n in (4, 8, 16)]
    assert np.diff(np.log2(errors)).max() < -3.0


@pytest.mark.repeated(2)
@pytest.mark.parametrize("velocity", [0.05, 0.3, -0.9, 1.6])
def test_one_step_however_large_the_jump_is_accurate(velocity):
    """Within 1e-4 of the force, in parts of 0.01 m/s of w and across kinks of the curve."""
    truth = exact(LAW, 0.0, lambda t: velocity, 1.5e-3)
    assert LAW.follow(0.0, velocity, velocity, 1.5e-3) == pytest.approx(truth, rel=1e-4)


@pytest.mark.nightly
def test_a_fast_drive_over_the_whole_curve_is_accurate_at_a_step_of_a_millisecond():
    def drive(t):
        return 0.9 * np.sin(2.0 * np.pi * 8.0 * t + 0.5)

    start = LAW.static_force(drive(0.0))
    assert followed(LAW, start, drive, 0.05, 50) == pytest.approx(exact(LAW, start, drive, 0.05), abs=0.5)


@few
@given(velocities, velocities, steps, st.floats(1e2, 1e4), stiffnesses, velocities)
def test_a_straight_curve_makes_it_lpf1(start, end, step, slope, stiffness, before):
    line = straight(slope)
    lpf1, law = Lpf1(line, slope / stiffness), Maxwell(line, stiffness)
    force = slope * before
    expected = lpf1.follow(force, start, end, step)
    assert law.follow(force, start, end, step) == pytest.approx(expected, rel=1e-9, abs=1e-9 * slope)


@few
@given(velocities, velocities, velocities, st.floats(1e-5, 1.0))
def test_a_rigid_spring_makes_it_polylinear(before, start, end, step):
    law = Maxwell(curve(), 1e16)
    force = law.follow(law.static_force(before), start, end, step)
    assert force == pytest.approx(Polylinear(curve()).static_force(end), rel=1e-6, abs=1e-2)


def test_a_soft_spring_holds_its_force():
    assert Maxwell(curve(), 1e-6).follow(500.0, 1.0, -1.0, 1e-3) == pytest.approx(500.0, abs=1e-8)


def test_where_the_curve_is_flat_the_valve_moves_at_once():
    """The curve is almost flat beyond the fit: the time to reach a force there is the time to the flat part alone."""
    law = Maxwell(curve(compression_slope=1e-9), STIFFNESS)
    top = law.static_force(1.2)
    assert law.follow(top, 1.9, 1.9, 1e-9) == pytest.approx(top, rel=1e-9)
    assert law.follow(top, -1.0, -1.0, 1.0) == pytest.approx(law.static_force(-1.0), rel=1e-12)


@few
@given(velocities, velocities, velocities, steps, stiffnesses)
def test_the_force_stays_between_its_start_and_the_static_forces(before, start, end, step, stiffness):
    law = Maxwell(curve(), stiffness)
    forces = [law.static_force(v) for v in (before, start, end)]
    force = law.follow(forces[0], start, end, step)
    assert min(forces) - 1e-9 <= force <= max(forces) + 1e-9


@few
@given(velocities, steps)
def test_in_equilibrium_it_stays(velocity, step):
    static = LAW.static_force(velocity)
    assert LAW.follow(static, velocity, velocity, step) == static


@pytest.mark.nightly
@few
@given(st.floats(-1e4, 1e4), velocities, velocities, steps, st.floats(0.05, 0.95))
def test_two_steps_give_what_one_gives(force, start, end, step, split):
    """To 1e-4 of the forces, because the parts of a step depend on its remaining length."""
    middle = start + split * (end - start)
    halves = LAW.follow(LAW.follow(force, start, middle, split * step), middle, end, (1.0 - split) * step)
    size = max(abs(force), abs(LAW.static_force(start)), abs(LAW.static_force(end)))
    assert LAW.follow(force, start, end, step) == pytest.approx(halves, abs=1e-4 * size + 1e-6)


@few
@given(st.floats(-8e3, 8e3), velocities)
def test_the_velocity_under_a_force_is_found_from_any_guess(force, guess):
    found = velocity_under(force, guess, LAW.static_force(guess), LAW.valve)
    assert LAW.static_force(found) == pytest.approx(force, rel=1e-13, abs=1e-11)


@few
@given(st.floats(-6e3, 6e3), velocities, velocities, steps)
def test_static_forces_are_as_good_as_velocities(force, start, end, step):
    """The result of one piece for a caller that does not know the velocities."""
    by_velocity = LAW.advance(force, start, end, step)
    by_force = LAW.advance_lag(force, LAW.static_force(start), LAW.static_force(end), step)
    assert by_force == pytest.approx(by_velocity, rel=1e-11, abs=1e-9)


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_it_returns_no_more_energy_than_it_has_absorbed(seed):
    """The work at the port since rest is the energy stored in the spring plus that dissipated: never negative."""
    rng, h, work, force = np.random.default_rng(seed), 2e-4, 0.0, 0.0
    v = np.cumsum(rng.normal(0.0, 0.05, 60))
    v -= np.linspace(v[0], 0.0, v.size)
    for start, end in pairwise(v):
        after = LAW.follow(force, start, end, h)
        work += h * (force * (2.0 * start + end) + after * (start + 2.0 * end)) / 6.0
        force = after
        assert work >= force**2 / (2.0 * STIFFNESS) - 0.02 * abs(work) - 1e-3


def test_its_loop_opens_like_a_lag_of_slope_over_stiffness():
    """At a small amplitude about rest the phase is that of a first-order lag."""
    slope, frequency = 1800.0 / 0.381, 20.0
    omega, h, force = 2.0 * np.pi * frequency, 1e-4, 0.0
    t = np.arange(2001) * h
    v = 1e-3 * np.sin(omega * t)
    forces = [0.0]
    for start, end in pairwise(v):
        force = LAW.follow(force, start, end, h)
        forces.append(force)
    last = slice(1500, 2000)  # one period of 500 samples
    turn = np.exp(-1j * omega * t[last])
    response = np.sum(np.array(forces)[last] * turn) / np.sum(v[last] * turn)
    assert response == pytest.approx(slope / (1.0 + 1j * omega * slope / STIFFNESS), rel=2e-3)


def test_the_gas_spring_and_the_seal_are_added():
    port = Port(gas_stiffness=700.0, gas_preload=90.0, seal_friction=18.0)
    response = replace(LAW, port=port).response(400.0, 0.5, 0.02)
    assert response.force == pytest.approx(400.0 + 18.0 + 90.0 + 14.0)
    assert (response.lagged_force, response.lag_weight) == (400.0, 1.0)


def test_the_motion_ratio_and_the_scales_are_the_valves():
    law = replace(LAW, port=Port(motion_ratio=0.8, compression_scale=1.5, rebound_scale=1.5))
    scaled = replace(LAW, curve=curve(
        inner=tuple(1.5 * c for c in curve().inner), compression=tuple(1.5 * c for c in curve().compression),
        rebound=tuple(1.5 * c for c in curve().rebound), compression_slope=4500.0, rebound_slope=5250.0))  # fmt: skip
    assert law.follow(100.0, 0.1, 0.605, 1e-3) == pytest.approx(scaled.follow(100.0, 0.08, 0.484, 1e-3), rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inner": (-10.0, *[0.0] * 14)}, r"does not rise with velocity at 0.0046\d* m/s"),
        ({"compression": (1490.0, 900.0, -900.0, 0.0)}, r"at 0\.\d+ m/s .* fit a monotone curve, or use LPF1"),
        ({"rebound": (-1400.0, 1100.0, 0.0, 0.0)}, r"at -0\.\d+ m/s"),
        ({"compression_slope": 0.0}, r"at 1.2 m/s"),
        ({"rebound_slope": 0.0}, r"at -1.1 m/s"),
    ],
)
def test_a_falling_curve_is_rejected_with_the_velocity(changes, message):
    with pytest.raises(ValueError, match=message):
        Maxwell(curve(**changes), STIFFNESS)


@pytest.mark.parametrize("value", [0.0, -1.0, float("inf"), float("nan")])
def test_a_stiffness_out_of_range_is_named(value):
    with pytest.raises(ValueError, match="series_stiffness"):
        Maxwell(curve(), value)


@pytest.mark.parametrize("name", ["compression_scale", "rebound_scale"])
def test_a_scale_of_zero_is_refused(name):
    with pytest.raises(ValueError, match=name):
        Maxwell(curve(), STIFFNESS, port=Port(**{name: 0.0}))


@few
@given(st.lists(st.floats(-5e3, 5e3), min_size=15, max_size=15), velocities, velocities, velocities, steps)
def test_its_core_function_returns_a_number_for_any_curve(inner, before, start, end, step):
    """During a fit the curve may fall, although the fitted curve does not."""
    valve = Valve(curve(inner=tuple(inner)).numbers(), 1.0, 1.0)
    statics = (valve_force(valve, start), valve_force(valve, end))
    force = advance_core(valve_force(valve, before), Piece(start, end, *statics, step), (STIFFNESS,), valve)
    assert np.isfinite(force)


def test_across_a_dip_too_small_to_see_the_force_goes_no_faster_than_the_spring():
    """A fall of 0.002 N in the last hundredths of a transition: w jumps there, and the force must not."""
    dip = curve(
        inner=(1000.0, *[0.0] * 14), compression=(1000.0, 320.0, 0.0, 0.0), rebound=(-1000.0, -1000.0, 0.0, 0.0),
        transition_width=0.005,
    )  # fmt: skip
    edge = dip.transition_speed + 0.5 * dip.transition_width
    fine = np.array([dip.force(v) for v in np.linspace(edge - dip.transition_width, edge, 2001)])
    assert dip.falls_at() is None
    assert 0.0 < fine.max() - fine[-1] < 0.01
    law, start = Maxwell(dip, 2e5), edge + 1e-4
    for h, v in product((2e-5, 3e-6, 1e-6), (0.1, -0.03, -0.037, -0.1, -0.4)):
        force = law.static_force(start)
        for _ in range(100):
            after = law.follow(force, v, v, h)
            assert abs(after - force) <= 2e5 * h * (abs(v) + start) * 1.001
            force = after


def test_the_first_step_from_rest_is_that_of_a_lag():
    line = straight(5000.0)
    law = Maxwell(line, 5e6)
    assert law.follow(0.0, 0.2, 0.2, 1e-3) == pytest.approx(1000.0 * (1.0 - exp(-1.0)), rel=1e-12)
