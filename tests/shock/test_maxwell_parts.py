"""The functions of Maxwell's step: each is correct and needs few evaluations of the curve."""

import re
from itertools import pairwise
from math import copysign, exp, inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eightpost.shock import Maxwell, Port, law, maxwell
from eightpost.shock import curve as shock_curve
from eightpost.shock.law import Piece
from eightpost.shock.maxwell import (
    _bow_of_curve,
    _chord_time_constant,
    _followed,
    _reach,
    _room_before_kink,
    _time_across,
    _time_constant,
    _time_for,
    _time_less_bow,
    _velocity_at,
    velocity_under,
)

from .example_curve import curve

STIFFNESS = 3.5e6
LAW = Maxwell(curve(), STIFFNESS)
KINKS = (-1.1, -0.38735, -0.37465, 0.37465, 0.38735, 1.2)

velocities = st.floats(-1.5, 1.5)


@pytest.fixture
def evaluations(monkeypatch):
    """Return a list to which each evaluation of the curve appends its velocity."""
    seen, force = [], maxwell.valve_force

    def counted(valve, velocity):
        seen.append(velocity)
        return force(valve, velocity)

    monkeypatch.setattr(maxwell, "valve_force", counted)
    return seen


def test_the_velocity_under_a_force_takes_few_evaluations_from_any_guess(evaluations):
    """For two thousand random forces and guesses: at most 10 evaluations, with a median of 4."""
    rng, counts = np.random.default_rng(1), []
    for force, guess in zip(rng.uniform(-8e3, 8e3, 2000), rng.uniform(-2.0, 2.0, 2000), strict=True):
        evaluations.clear()
        found = velocity_under(force, guess, LAW.static_force(guess), LAW.valve)
        counts.append(len(evaluations))
        assert LAW.static_force(found) == pytest.approx(force, rel=1e-13, abs=1e-11)
    assert max(counts) <= 10
    assert np.median(counts) <= 4


def test_at_the_force_of_the_guess_the_curve_is_not_evaluated(evaluations):
    assert velocity_under(LAW.static_force(0.2), 0.2, LAW.static_force(0.2), LAW.valve) == 0.2
    assert evaluations == []


def test_the_first_secant_is_over_a_millimetre_per_second(evaluations):
    velocity_under(50.0, 0.0, 0.0, LAW.valve)
    slope = LAW.static_force(1e-3) / 1e-3
    assert evaluations[:2] == pytest.approx([1e-3, 50.0 / slope], rel=1e-12)


@given(velocities)
def test_the_room_is_the_distance_to_the_next_kink_of_the_curve(w):
    """The scales of both sides are equal, so there is no kink at zero."""
    for side in (1.0, -1.0):
        ahead = [side * (kink - w) for kink in KINKS if side * (kink - w) > 1e-9]
        assert _room_before_kink(w, 0.3 * side, LAW.valve) == pytest.approx(min(ahead, default=inf), rel=1e-9)


def test_where_the_sides_are_scaled_differently_zero_is_a_kink():
    valve = Maxwell(curve(), STIFFNESS, port=Port(compression_scale=1.2)).valve
    assert _room_before_kink(-0.1, 1.0, valve) == pytest.approx(0.1)
    assert _room_before_kink(0.1, -1.0, valve) == pytest.approx(0.1)
    assert _room_before_kink(-0.1, 1.0, LAW.valve) == pytest.approx(0.47465)
    assert _room_before_kink(0.0, 1.0, valve) == pytest.approx(0.37465)


def test_a_kink_that_w_is_at_is_passed():
    valve = LAW.valve
    assert _room_before_kink(0.37465 - 0.5e-9, 1.0, valve) == pytest.approx(0.0127, rel=1e-6)
    assert _room_before_kink(0.37465 - 2e-9, 1.0, valve) == pytest.approx(2e-9, rel=1e-3)
    assert _room_before_kink(1.3, 1.0, valve) == inf


@given(velocities, velocities, velocities)
def test_the_reach_is_the_distance_to_the_farther_end(w, v, end):
    assert _reach(w, v, end) == max(abs(v - w), abs(end - w))


def test_the_velocity_of_a_piece_is_linear():
    piece = Piece(0.2, 0.6, 0.0, 0.0, 4e-3)
    assert [_velocity_at(piece, t) for t in (0.0, 1e-3, 4e-3)] == pytest.approx([0.2, 0.3, 0.6])


def test_a_time_constant_is_the_slope_of_the_chord_over_the_stiffness():
    force = LAW.static_force(0.1)
    chord = (LAW.static_force(0.3) - force) / 0.2
    assert _time_constant(0.1, force, 0.2, STIFFNESS, LAW.valve) == pytest.approx(chord / STIFFNESS, rel=1e-12)
    # A chord of no length is one of 1 nm/s, in its direction.
    tangent = (LAW.static_force(0.1 + 1e-6) - LAW.static_force(0.1 - 1e-6)) / 2e-6
    for change in (0.0, -1e-12):
        assert _time_constant(0.1, force, change, STIFFNESS, LAW.valve) == pytest.approx(tangent / STIFFNESS, rel=1e-4)
    # A falling curve, as may occur during a fit, causes no lag.
    assert _time_constant(0.1, force + 1e3, 0.01, STIFFNESS, LAW.valve) == 0.0


@given(velocities, velocities, velocities, st.floats(1e-7, 1e-1), st.floats(1e-4, 1e-2), st.floats(0.01, 0.1))
def test_in_the_time_of_a_part_w_changes_by_no_more_than_the_part_allows(w, v, end, tau, step, most):
    gap, last = v - w, end - w
    assume(gap * last >= 0.0 and max(abs(gap), abs(last)) > most)  # a step is divided where w turns
    far = max(abs(gap), abs(last))
    time = min(_time_for(most, abs(gap), far, step, tau), step)
    assert time >= min(tau * most / far, step) * (1.0 - 1e-9)
    assert abs(_followed(w, v, v + (end - v) * time / step, tau, time) - w) <= most * (1.0 + 1e-6)


def test_the_time_of_a_part_is_the_longest_of_three_that_are_safe():
    assert _time_for(0.01, 0.8, 1.0, 1e-3, 1e-3) == pytest.approx(1e-3 * 0.01 / 1.0)  # the largest gap ahead
    assert _time_for(0.01, 0.02, 1.0, 1e-3, 1e-4) == pytest.approx(0.02 / 980.0)  # until the gap has doubled
    assert _time_for(0.01, 0.2, 1.0, 1e-3, 1e-3) == pytest.approx(1e-3 * 0.01 / 0.3)  # on average 1.5 gap
    assert _time_for(0.01, 0.002, 1.0, 1e-3, 1e-6) == pytest.approx(0.008 / 998.0)  # w never passes v


@pytest.mark.repeated(2)
@pytest.mark.parametrize("stiffness", [1e5, 3e6, 2.7e7, 1e9])
@pytest.mark.parametrize(("w", "start", "end", "most"), [(0.65, 0.65, -0.5, 300), (-3.5, 7.2, -5.7, 999)])
def test_a_step_over_the_whole_curve_takes_few_parts_and_is_that_of_many_small_ones(
    monkeypatch, w, start, end, most, stiffness
):
    """In 60 ms; the first has 115 parts of 0.01 m/s, the second begins far from equilibrium."""
    parts, real = [], maxwell._chord_time_constant
    monkeypatch.setattr(maxwell, "_chord_time_constant", lambda *given: parts.append(1) or real(*given))
    shock, step, count = Maxwell(curve(), stiffness), 0.06, 1000

    def after(force, v, to, time):
        return shock.advance_piece(force, Piece(v, to, shock.static_force(v), shock.static_force(to), time))

    whole = small = shock.static_force(w)
    whole = after(whole, start, end, step)
    assert len(parts) <= most
    velocities = np.linspace(start, end, count + 1).tolist()
    for v, to in pairwise(velocities):
        small = after(small, v, to, step / count)
    assert whole == pytest.approx(small, abs=0.5)


def test_w_follows_as_a_first_order_lag_for_any_time_constant():
    w, v, end, step = 0.1, 0.3, 0.5, 1e-3
    for tau in (1e-5, 1e-3, 0.1):
        slope = (end - v) / step
        expected = end - slope * tau + (w - v + slope * tau) * exp(-step / tau)
        assert _followed(w, v, end, tau, step) == pytest.approx(expected, rel=1e-10)
    assert _followed(w, v, end, 0.0, step) == end
    assert _followed(w, v, end, 1e-6, step) == pytest.approx(end - (end - v) * 1e-3, rel=1e-15)


@given(velocities, velocities, velocities, st.floats(1e-5, 1e-1), st.floats(1e-5, 1e-2))
def test_the_time_across_is_when_w_has_moved_by_the_room(w, v, end, tau, step):
    whole = _followed(w, v, end, tau, step) - w
    gaps = v - w, end - w
    assume(min(gaps) * max(gaps) >= 0.0 and abs(whole) >= 1e-6)  # a step is divided so that w is monotonic
    room = 0.3 * abs(whole)
    time = _time_across(room, abs(whole), w, v, end, tau, step)
    assert 0.0 < time < step
    moved = _followed(w, v, v + (end - v) * time / step, tau, time) - w
    assert abs(moved) == pytest.approx(room, rel=1e-6, abs=1e-12)


def test_the_time_across_takes_few_steps(monkeypatch):
    counts, calls, real = [], [], maxwell._followed
    monkeypatch.setattr(maxwell, "_followed", lambda *given: calls.append(1) or real(*given))
    rng = np.random.default_rng(2)
    for _ in range(500):
        w, v, end = 0.0, *np.sort(rng.uniform(0.01, 1.0, 2))
        tau, step = 10.0 ** rng.uniform(-5.0, -2.0), 10.0 ** rng.uniform(-4.0, -2.0)
        whole = real(w, v, end, tau, step)
        calls.clear()
        _time_across(rng.uniform(0.05, 0.95) * whole, whole, w, v, end, tau, step)
        counts.append(len(calls))
    assert np.median(counts) <= 4
    assert max(counts) <= 60


def test_the_curves_deviation_from_its_chord_makes_a_crossing_earlier():
    """w is ahead by 1e-3 m/s and changes at 0.1 / 0.01 m/s2."""
    assert _time_less_bow(1e-2, 1e-3, 1e-2, 0.1) == pytest.approx(1e-2 - 1e-4)
    assert _time_less_bow(1e-2, -1e-3, 1e-2, 0.1) == pytest.approx(1e-2 + 1e-4)
    assert _time_less_bow(1e-2, 1e-3, 1e-2, -0.1) == pytest.approx(1e-2 + 1e-4)
    # A reduction by more than half is not applied.
    assert _time_less_bow(1e-4, 1e-3, 1e-2, 0.1) == 1e-4
    assert _time_less_bow(1e-2, 1e-3, 1e-2, 0.0) == 1e-2


@pytest.mark.parametrize("step", [1e-6, 1e-4, 1e-3, 1e-1])
def test_the_correction_for_the_curves_deviation_is_that_of_the_exact_integral(step):
    """Four deviations over the chord's slope, times z / 6 for short steps and 1 / z for long ones."""
    w, change, tau = 0.05, 0.2, 1e-3
    force = LAW.static_force(w)
    bow = LAW.static_force(w + 0.5 * change) - (force + 0.5 * STIFFNESS * tau * change)
    z = step / tau
    expected = 4.0 * bow / (STIFFNESS * tau) * z / (6.0 + 3.0 * z + z * z)
    assert _bow_of_curve(w, force, change, tau, step, STIFFNESS, LAW.valve) == pytest.approx(expected, rel=1e-9)


@given(velocities, velocities, velocities, st.floats(1e-5, 1e-2), st.floats(1e5, 1e8))
def test_a_chords_time_constant_is_consistent_with_the_w_that_results(w, v, end, step, stiffness):
    force = LAW.static_force(w)
    towards = v - w if abs(v - w) >= abs(end - w) else end - w
    if towards == 0.0:
        return
    room = _room_before_kink(w, towards, LAW.valve)
    nearby = _time_constant(w, force, copysign(min(abs(towards), 0.01, room), towards), stiffness, LAW.valve)
    tau = _chord_time_constant(w, force, nearby, v, end, step, room, stiffness, LAW.valve)
    change = _followed(w, v, end, tau, step) - w
    if abs(change) < 1e-7 or change * towards < 0.0:
        return
    found = _time_constant(w, force, copysign(min(abs(change), room), change), stiffness, LAW.valve)
    assert tau == pytest.approx(found, rel=1e-3)


def test_a_chord_takes_few_evaluations(evaluations):
    """Secants need two or three evaluations, at most ten."""
    rng, counts = np.random.default_rng(3), []
    for _ in range(1000):
        w = rng.uniform(-1.0, 1.0)
        v, end = w + rng.normal(0.0, 0.05, 2)
        force, stiffness = LAW.static_force(w), 10.0 ** rng.uniform(5.0, 7.5)
        room = _room_before_kink(w, v - w if abs(v - w) >= abs(end - w) else end - w, LAW.valve)
        tau = _time_constant(w, force, 1e-3, stiffness, LAW.valve)
        evaluations.clear()
        _chord_time_constant(w, force, tau, v, end, 10.0 ** rng.uniform(-4.0, -2.0), room, stiffness, LAW.valve)
        counts.append(len(evaluations))
    assert np.mean(counts) < 2.6
    assert max(counts) <= 10


def test_at_rest_the_force_is_kept_to_the_last_bit_and_the_curve_is_evaluated_only_to_find_the_velocity(evaluations):
    force = LAW.static_force(0.2)
    for step in (1e-6, 1e-3, 1.0):
        assert LAW.advance_piece(force, Piece(0.2, 0.2, force, force, step)) == force
    assert evaluations == []


C_CONSTANTS = {
    "CHORD": law.STRAIGHT,
    "SHORTEST": maxwell._SHORTEST,
    "FIRST": maxwell._FIRST,
    "SETTLED": maxwell._SETTLED,
    "AT_REST": maxwell._AT_REST,
    "FOUND": maxwell._FOUND,
    "AGREEMENT": maxwell._AGREEMENT,
    "LEAST_BEND": maxwell._LEAST_BEND,
    "NEAR": maxwell._NEAR,
    "FORCE_ROUNDING": maxwell._ROUNDING,
    "MOST_PARTS": maxwell._MOST_PARTS,
    "MOST_CORRECTIONS": maxwell._MOST_CORRECTIONS,
    "MOST_TRIES": maxwell._MOST_TRIES,
    "LOOKS": shock_curve.LOOKS,
    "TRANSITION_LOOKS": shock_curve.TRANSITION_LOOKS,
}


@pytest.mark.parametrize(
    ("file", "constants"),
    [
        ("shock_maxwell/model.c", C_CONSTANTS),
        ("common/shock.c", {"STRAIGHT": law.STRAIGHT, "MOST_PIECES": law.MOST_PIECES}),
    ],
)
def test_the_constants_of_the_c_law_are_those_of_the_python_law(file, constants):
    source = (Path(__file__).resolve().parents[2] / "fmus" / file).read_text(encoding="utf-8")
    listed = {name: float(value) for name, value in re.findall(r"\b([A-Z][A-Z_]+) = ([0-9.e-]+)[,; ]", source)}
    assert {name: listed[name] for name in constants} == constants


def test_a_curve_is_checked_at_every_256th_of_a_side_and_every_12th_of_its_transition(monkeypatch):
    seen, force = [], shock_curve.curve_force
    monkeypatch.setattr(shock_curve, "curve_force", lambda numbers, v: seen.append(v) or force(numbers, v))
    checked = curve()
    assert checked.falls_at() is None
    middle, width = checked.transition_speed, checked.transition_width
    expected = []
    for side, speed in ((1.0, checked.compression_speed), (-1.0, checked.rebound_speed)):
        expected += (side * np.linspace(0.0, speed, 257)).tolist()
        expected += (side * np.linspace(middle - 0.5 * width, middle + 0.5 * width, 13)).tolist()
    assert seen == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_velocity_is_found_on_a_curve_that_falls_in_places(monkeypatch):
    """A dip that the check of a curve does not see must not mislead the search."""
    seen = []

    def wavy(_valve, w):
        seen.append(w)
        return 1000.0 * w + 20.0 * np.sin(300.0 * w)

    monkeypatch.setattr(maxwell, "valve_force", wavy)
    rng, counts = np.random.default_rng(6), []
    for force, guess in rng.uniform((-500.0, -0.5), (500.0, 0.5), (2000, 2)):
        before = wavy(None, guess)
        seen.clear()
        found = velocity_under(force, guess, before, None)
        counts.append(len(seen))
        assert wavy(None, found) == pytest.approx(force, rel=1e-12, abs=1e-11)
    assert max(counts) <= 45
    assert np.mean(counts) < 15
