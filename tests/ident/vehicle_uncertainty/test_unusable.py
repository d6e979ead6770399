"""A vehicle that cannot be simulated is not usable, whatever its fit: its file says so."""

import pytest

from eightpost.ident.vehicle import common_poles
from eightpost.ident.vehicle.common_poles import CommonPoles
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.trust import UNUSABLE
from eightpost.ident.vehicle.vehicle_fit import with_validity
from eightpost.verdict import Grade
from tests.ident.friction.conftest import BASELINE, rig_tests

EXPERIMENT = Experiment("corner", ("road", "aero_force"), ("force",), ("velocity", "tire_force"), {"": BASELINE})
QUICK = CommonPoles(samples=2, friction=None, springs=None)


@pytest.mark.nightly
def test_a_vehicle_of_which_every_model_was_rejected_is_not_usable(monkeypatch):
    monkeypatch.setattr(common_poles, "fault_in_simulation", lambda _vehicle, _tests: "it diverges")
    fit = with_validity(QUICK.identify(rig_tests(0.0, 20), EXPERIMENT))
    assert sum("was rejected: it diverges" in note for note in fit.notes) == 2
    assert "No model could be used" in fit.trust.flags[UNUSABLE]
    assert fit.trust.flags[UNUSABLE] in fit.notes
    assert fit.vehicle.validity.verdict.grade is Grade.NOT_USABLE
