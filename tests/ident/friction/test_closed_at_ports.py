"""An identified car with shock laws at its ports, compared with the rig on another drive with other shocks."""

from __future__ import annotations

import pytest

from eightpost.ident.validation.comparison import rig_record
from eightpost.ident.validation.vehicles import validate_vehicle
from eightpost.ident.vehicle.common_poles import CommonPoles
from eightpost.ident.vehicle.port_search import FrictionSearch
from eightpost.shock import Polylinear, StaticCurve
from eightpost.virtual import NO_DRIFT, LinearDamper, RigSensors, random_drive, run_test

from .conftest import BASELINE, COULOMB, rubbing_car

#: A damper that no test of the identification had.
FIRM = 1.5 * BASELINE


def _law(rate):
    """Return the law F = rate v."""
    speed = 0.4
    outer = (rate * speed, rate * speed, 0.0, 0.0)
    inner = (rate * speed, *[0.0] * 14)
    return Polylinear(StaticCurve(inner, outer, tuple(-c for c in outer), speed, 0.01, 5.0, 5.0, rate, rate))


@pytest.fixture(scope="module")
def unseen():
    """Return a test of the same car on another drive with a firmer damper."""
    car = rubbing_car(COULOMB)
    drive = random_drive(car, 91, duration=30.0)
    return run_test(car, drive, (LinearDamper(FIRM),), seed=91, sensors=RigSensors.perfect(), drift=NO_DRIFT)


@pytest.fixture(scope="module")
def fit(rubbing, experiment):
    """Return the vehicle identified from the tests with friction."""
    search = FrictionSearch(velocities=(0.01,), reaches=())
    return CommonPoles(friction=search, springs=None, samples=0).identify(rubbing, experiment)


def test_laws_at_the_ports_give_the_levels_of_the_rig_only_with_friction(fit, unseen):
    record = rig_record(unseen, fit.vehicle.state_space)
    (case,) = validate_vehicle(fit, [record], shocks={"": _law(FIRM)}).cases
    assert case.shocks == "shock laws, ports closed"
    assert case.without_friction is not None
    assert max(abs(one.level) for one in case.judged) < 0.01
    assert max(one.error for one in case.judged) < 0.1
    names = {one.name for one in case.judged}
    assert max(abs(one.level) for one in case.without_friction if one.name in names) > 0.03


def test_a_wrong_law_at_the_port_gives_wrong_levels(fit, unseen):
    record = rig_record(unseen, fit.vehicle.state_space)
    (case,) = validate_vehicle(fit, [record], shocks={"": _law(0.5 * FIRM)}).cases
    assert max(abs(one.level) for one in case.judged) > 0.1
