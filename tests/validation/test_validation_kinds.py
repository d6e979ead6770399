"""The kind of a record is recognised from its motion."""

import numpy as np
import pytest

from eightpost.ident.validation.records import dyno_record, recognise_motion
from eightpost.rig.dyno_test import DynoTest

from .conftest import record, sine_path


@pytest.mark.parametrize(("amplitude", "velocity"), [(1.0, 6.0), (1.0, 30.0), (0.25, 10.0), (0.1, 10.0)])
def test_a_sine_of_table_3_3_is_a_sine_of_its_frequency(sine_test, amplitude, velocity):
    seen = recognise_motion(sine_test(amplitude, velocity))
    assert seen.kind == "sine"
    assert seen.frequency == pytest.approx(velocity / (2.0 * np.pi * amplitude), rel=2e-3)


def test_the_multisine_is_random(random_test):
    assert recognise_motion(random_test(1)).kind == "random"


def test_steps_with_long_holds_are_static(static_test):
    assert recognise_motion(static_test).kind == "static"


def test_a_fast_step_is_a_bump(bump_test):
    assert recognise_motion(bump_test).kind == "bump"


@pytest.mark.parametrize("name", ["static_test", "bump_test"])
def test_the_velocity_is_integrated_if_displacement_was_not_measured(request, name):
    test = request.getfixturevalue(name)
    assert recognise_motion(DynoTest(test.series.select(("velocity", "force")))).kind == name.partition("_")[0]


def test_one_period_is_no_sine_test(truth):
    assert recognise_motion(record(truth, sine_path(0.5, 5.0, periods=1), 2000.0)).kind != "sine"


def test_a_given_kind_takes_precedence_over_the_recognised_one(sine_test):
    record = dyno_record(sine_test(0.1, 5.0), kind="random")
    assert (record.kind, record.reason) == ("random", "given by the user")
