"""The rig's programs contain the tests of 4.5.1, 6.1.3 and 6.1.5."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.units import convert
from eightpost.virtual import bump_test, identification_program, program, quarter_truth, seven_dof_truth, stand_in_truth
from eightpost.virtual.program import _random_length

INCH = convert(1.0, "in", "m")
CAR, QUARTER = stand_in_truth(), quarter_truth()


def names_of(name, car=CAR):
    return [test.name for test in program(name, car, 1)]


def test_identification_tests_share_one_drive_file_unless_draws_is_other():
    assert (_random_length(CAR), _random_length(QUARTER)) == (800.0, 120.0)
    same = [test.draw() for test in identification_program(CAR, 1, duration=2.0)]
    assert all(drivefile is same[0] for drivefile in same)
    other = [test.draw().series["lf.road"] for test in identification_program(CAR, 1, duration=2.0, draws="other")]
    assert not any(np.array_equal(a, b) for i, a in enumerate(other) for b in other[:i])


def test_the_sines_have_the_values_of_tables_6_2_and_4_4():
    printed = {"heave": (1, 2, 4, 6, 8, 10, 15, 20), "pitch": (1, 2, 3, 5, 6), "roll": (1, 2, 3, 5, 6)}
    assert names_of("sine") == [f"sine_{mode}_{f}hz" for mode, row in printed.items() for f in row]
    assert names_of("sine", QUARTER) == [f"sine_heave_{f}hz" for f in ("1", "2.8", "3.5", "5", "9", "12")]
    road = program("sine", CAR, 1)[9].draw().series["lf.road"]  # pitch, 2 Hz, 0.7 in
    assert np.abs(road).max() == pytest.approx(0.7 * INCH, rel=1e-3)


def test_each_rig_has_its_own_bump():
    for car, height, period, duration in ((CAR, 0.4, 10.0, 50.0), (QUARTER, 1.0, 20.0, 60.0)):
        series = bump_test(car).series
        road = series[car.named("road")[0]]
        assert np.ptp(road) == pytest.approx(height * INCH)
        assert series.duration == pytest.approx(duration)
        edges = series.time[:-1][np.diff(np.sign(road)) > 0]
        assert np.diff(edges) == pytest.approx(period, abs=0.01)


def test_the_spring_rating_has_four_modes_and_four_single_actuators():
    assert names_of("static") == [f"static_{k}" for k in ("heave", "pitch", "roll", "warp", "lf", "rf", "lr", "rr")]
    with pytest.raises(ParameterError, match="lacks the actuators"):
        program("static", seven_dof_truth(), 1)


def test_all_contains_every_program_that_the_rig_can_run():
    parts = ("identification", "single", "sine", "bump", "static", "track")
    assert names_of("all") == [name for part in parts for name in names_of(part)]
    assert len(set(names_of("all"))) == len(names_of("all"))
    assert not [name for name in names_of("all", QUARTER) if name.startswith(("static", "track"))]
    with pytest.raises(ParameterError, match="no program 'sines'; there are identification"):
        program("sines", CAR, 1)
