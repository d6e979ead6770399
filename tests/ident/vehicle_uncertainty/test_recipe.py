"""The recipe common-poles states the accuracy of setups: small for a linear car, larger for one with friction."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.preparation import prepare
from eightpost.ident.vehicle.common_poles import CommonPoles
from eightpost.ident.vehicle.experiment import experiment_of, find_baseline
from eightpost.ident.vehicle.trust import removable_tests
from eightpost.ident.vehicle.vehicle_fit import measure_table, worst_measures
from eightpost.virtual import NO_DRIFT, LinearDamper, RigSensors, random_drive, run_test, stand_in_truth

#: Two whole identifications; every change: what makes errors large in test_measured_levels.py, and that a car has them
#: in test_unusable.py.
pytestmark = pytest.mark.nightly

FRICTIONLESS = CommonPoles(friction=None, springs=None, samples=2)


def fitted(car):
    """Identify a car from a baseline test and one test for each corner with a softer damper there, 40 s each."""
    soft, firm, drive = LinearDamper(1576.0), LinearDamper(3632.0), random_drive(car, 3, duration=40.0)
    shocks = [[soft if corner == number - 1 else firm for corner in range(4)] for number in range(5)]
    perfect = RigSensors.perfect(relative=0.002)
    prepared = prepare(
        run_test(car, drive, row, seed=number, sensors=perfect, drift=NO_DRIFT) for number, row in enumerate(shocks)
    )
    baseline = find_baseline(prepared.records, prepared.corners, test=0)
    experiment = experiment_of(prepared.channels, baseline.damping)
    kept = [n for n in experiment.outputs if n.endswith(("velocity", "displacement", "tire_force"))]
    experiment = experiment.of(*kept)
    assert removable_tests(prepared.records, experiment.ports) == (0,)
    return FRICTIONLESS.identify(prepared.records, experiment)


@pytest.fixture(scope="module")
def fits():
    """The stand-in without and with friction, which the recipe here does not model."""
    car = stand_in_truth()
    return fitted(car.without_friction()), fitted(car)


def test_every_output_and_the_sum_of_the_tire_forces_have_an_uncertainty(fits):
    for fit in fits:
        assert set(fit.trust.measures) == {*fit.vehicle.state_space.output_names, "total_tire_force"}
        assert all(np.isfinite([one.common, one.own]).all() for one in fit.trust.measures.values())


def test_friction_that_the_model_does_not_have_makes_the_measures_uncertain(fits):
    smooth, rubbing = ([one.levels[0].spread for one in fit.trust.measures.values()] for fit in fits)
    assert all(one.common < 0.015 for one in fits[0].trust.measures.values())  # noise of short tests
    assert np.mean(rubbing) > 1.5 * np.mean(smooth)


def test_the_table_shows_the_worst_output_of_each_quantity(fits):
    trust = fits[1].trust
    worst = dict(worst_measures(trust))
    assert worst["velocity"].own == max(one.own for name, one in trust.measures.items() if name.endswith("velocity"))
    assert measure_table(trust).row_count == len(worst) == 4
