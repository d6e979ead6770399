"""A correct rig record passes with any drive, and channels with a wrong sign or corner are found."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.errors import WrongSignError
from eightpost.rig import SwappedCornersError
from eightpost.rig.rig_test import check_rig_record
from eightpost.virtual import (
    NO_DRIFT,
    TRUTHS,
    LinearDamper,
    RigSensors,
    bump_drive,
    configuration,
    random_drive,
    run_test,
    sine_drive,
)
from eightpost.virtual.drivefiles import HEAVE_SINES, SIGNS, TABLE_4_4, TILT_SINES

INCH, DAMPING = 0.0254, 175.127  # m; lbf.s/in in N.s/m
CHECKED = ("hub_acceleration", "tire_force", "road", "force", "displacement")


def recorded(car, drive, *, damping, noise, seed=0):
    """Run a test with linear dampers [lbf.s/in], or with configuration 9 of Table 3.1 if `damping` is zero."""
    shocks = [LinearDamper(damping * DAMPING) if damping else configuration(9)] * len(car.corners)
    quiet = {} if noise else {"sensors": RigSensors.perfect(), "drift": NO_DRIFT}
    return run_test(car, drive, shocks, seed=seed, lead=0.5, **quiet)


cars = st.sampled_from([make() for make in TRUTHS.values()])
dampings = st.sampled_from([0.0, 5.0, 9.0, 20.74, 60.0])


@pytest.mark.nightly
@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    car=cars,
    mode=st.sampled_from(list(SIGNS)),
    frequency=st.floats(0.5, 20.0),
    speed=st.floats(0.5, 8.0),
    damping=dampings,
    noise=st.booleans(),
)
def test_a_correct_sine_of_any_frequency_amplitude_and_mode_passes(car, mode, frequency, speed, damping, noise):
    amplitude = min(1.0, speed / (2.0 * np.pi * frequency)) * INCH
    test = recorded(car, sine_drive(car, frequency, amplitude, mode=mode, duration=5.0), damping=damping, noise=noise)
    check_rig_record(test.series, test.corners)


@pytest.mark.nightly
@settings(max_examples=8, deadline=None, derandomize=True)
@given(car=cars, which=st.integers(0, 7), damping=dampings, noise=st.booleans(), seed=st.integers(0, 99))
def test_a_correct_test_of_one_input_or_of_all_passes(car, which, damping, noise, seed):
    active = (car.inputs[which],) if which < len(car.corners) else ()
    drive = random_drive(car, seed, duration=6.0, active=active)
    test = recorded(car, drive, damping=damping, noise=noise, seed=seed)
    check_rig_record(test.series, test.corners)


@pytest.mark.repeated
@pytest.mark.parametrize("truth", TRUTHS)
def test_a_correct_bump_passes(truth):
    car = TRUTHS[truth]()
    test = recorded(car, bump_drive(car, period=3.0, duration=6.0), damping=20.74, noise=True)
    check_rig_record(test.series, test.corners)


@pytest.mark.repeated
@pytest.mark.parametrize(("truth", "damping"), [("quarter_car", 20.74), ("eight_post", 9.0)])
def test_every_sine_of_tables_4_4_and_6_2_passes_although_tires_lift_off(truth, damping):
    car = TRUTHS[truth]()
    tables = {"heave": (*HEAVE_SINES, *TABLE_4_4)} | ({"pitch": TILT_SINES, "roll": TILT_SINES} if car.geometry else {})
    for mode, table in tables.items():
        for frequency, amplitude in table:
            drive = sine_drive(car, frequency, amplitude * INCH, mode=mode, duration=5.0)
            test = recorded(car, drive, damping=damping, noise=True)
            check_rig_record(test.series, test.corners)


@cache
def shaken(truth):
    """Return a random test of each car, all actuators moving."""
    car = TRUTHS[truth]()
    return recorded(car, random_drive(car, 7, duration=8.0), damping=20.74, noise=True)


@pytest.mark.repeated
@pytest.mark.parametrize("quantity", CHECKED)
@pytest.mark.parametrize("truth", TRUTHS)
def test_a_channel_with_the_wrong_sign_is_reported_at_every_corner(truth, quantity):
    test = shaken(truth)
    assert test.corners
    for corner in test.corners:
        channel = f"{corner}.{quantity}" if corner else quantity
        turned = test.series.with_channel(channel, test.series.unit(channel), -test.series[channel])
        # The sign of a displacement is checked with the velocity: one of the two is wrong.
        named = channel.replace("displacement", "velocity")
        with pytest.raises(WrongSignError, match=f"channel '{named}'"):
            check_rig_record(turned, test.corners)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("quantity", ["hub_acceleration", "tire_force", "road", "force"])
@pytest.mark.parametrize("truth", ["seven_dof", "eight_post"])
def test_swapped_corners_are_reported_on_every_axle_and_side(truth, quantity):
    test = shaken(truth)
    for pair in (("lf", "rf"), ("lr", "rr"), ("lf", "lr")):
        one, other = (f"{corner}.{quantity}" for corner in pair)
        unit = test.series.unit(one)
        swapped = test.series.with_channel(one, unit, test.series[other]).with_channel(other, unit, test.series[one])
        with pytest.raises(SwappedCornersError, match=f"channel '({one}|{other})'"):
            check_rig_record(swapped, test.corners)


def test_a_tire_without_ground_contact_is_not_checked():
    """At 4 Hz, in resonance, the front wheels leave the pans for a third of the time (6.1.3: 0.7 in)."""
    car = TRUTHS["eight_post"]()
    test = recorded(car, sine_drive(car, 4.0, 0.7 * INCH, duration=5.0), damping=9.0, noise=False)
    force = test.series["lf.tire_force"]
    assert np.mean(force < force.min() + 1.0) > 0.25
    check_rig_record(test.series, test.corners)
