"""Report of a fit on itself: nonlinear springs, lifted tires, standard deviations."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.ident.vehicle.common_poles import CommonPoles, Excitation
from eightpost.ident.vehicle.port_search import (
    FrictionEstimate,
    FrictionSearch,
    SpringSearch,
    about_loads,
    about_tests,
    nonlinear_spring_sentence,
    port_springs,
)
from eightpost.ident.vehicle.trust import ForceEstimate
from eightpost.progress import reported_to
from eightpost.signals import TimeSeries
from eightpost.vehicle import (
    Bristle,
    Channel,
    Friction,
    IdentifiedVehicle,
    StateSpace,
    add_port_damping,
    read_vehicle,
    shipped,
)

from .conftest import rig_tests

#: Progression p of the spring force k s (1 + p s) [1/m], and its rate k [N/m].
PROGRESSION = 2.0
RATE = 1280.0 * 4.4482216152605 / 0.0254


def test_the_summary_of_the_friction_has_its_law_its_force_and_what_remains():
    forces, residual = {"": ForceEstimate(80.0, 1.5)}, {"velocity": 0.2, "tire_force": 0.4}
    creeping = FrictionEstimate({"": Friction(80.0, 0.012)}, forces, residual)
    assert creeping.summary() == (
        "Friction at the ports (+- two standard deviations): port 80.0 +- 3.0 N; "
        "it creeps (tanh, friction velocity 12 mm/s); 30 % of the residual remains."
    )
    sticking = FrictionEstimate({"lf": Friction(bristle=Bristle(80.0, 1e-4, 1.15))}, {"lf": forces[""]}, {"y": 0.9})
    assert sticking.summary().endswith(
        "lf 80.0 +- 3.0 N; it sticks (bristle, reach 0.1 mm, static over sliding force 1.15); "
        "90 % of the residual remains."
    )
    assert FrictionEstimate({"": Friction()}, forces, residual).summary().startswith("No significant friction")


@pytest.fixture(scope="module")
def progressive():
    """Return the tests of a car with a progressive spring and without friction."""
    return rig_tests(0.0, 40, progression=PROGRESSION)


def test_the_force_of_a_progressive_spring_is_found(progressive, experiment):
    found = SpringSearch().find(progressive, experiment)[""]
    travel = progressive[0]["displacement"]
    expected = RATE * PROGRESSION * float(np.mean(np.square(travel - travel.mean())))
    assert found.value == pytest.approx(expected, rel=0.1)
    assert found.is_significant
    assert "not linear" in (nonlinear_spring_sentence({"": found}) or "")


def test_more_steps_of_the_search_change_the_force_by_less_than_a_tenth_of_its_deviation(progressive, experiment):
    found, settled = (
        search.find(progressive, experiment)[""]
        for search in (SpringSearch(seconds=20.0), SpringSearch(20.0, iterations=6))
    )
    assert abs(found.value - settled.value) < 0.1 * settled.deviation


@pytest.mark.slow
def test_the_estimates_of_friction_and_springs_are_the_kept_ones(
    rubbing, progressive, experiment, monkeypatch, unchanged
):
    monkeypatch.setattr("eightpost.progress._INTERVAL", np.inf)
    shares = []
    search = FrictionSearch((0.003, 0.012, 0.05), (3e-5, 1e-4, 3e-4), (20.0, 40.0))
    with reported_to(lambda done, _total: shares.append(round(done, 3))):
        found = search.find(rubbing, experiment)
    creeping = replace(search, reaches=()).find(rubbing, experiment)
    springs = SpringSearch(seconds=30.0).find(progressive, experiment)
    parts = {"found": found, "creeping": creeping, "springs": springs}
    says = {"progress": np.array(shares), "says": found.summary(), "acts": found.acts, "sticks": found.sticks}
    loads = {"aero_force": 2000.0}
    law = Friction(bristle=Bristle(80.0, 1e-4, 1.15), spring=2e5)
    car = IdentifiedVehicle("car", add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": 3000.0}),
                            {"": 3000.0}, friction={"": law})  # fmt: skip
    moved = {"tests": about_tests(car, loads).friction, "loads": about_loads(car, loads).friction}
    unchanged({**parts, **says, "port": port_springs(springs, progressive, ("",)), "moved": moved}, relative=1e-3)


def test_a_linear_spring_is_not_reported_as_nonlinear(smooth, experiment):
    assert nonlinear_spring_sentence(SpringSearch().find(smooth, experiment)) is None


def test_records_without_travel_give_no_result_on_springs(smooth, experiment):
    blind = [test.select(name for name in test.names if name != "displacement") for test in smooth]
    outputs = [name for name in experiment.outputs if name != "displacement"]
    assert SpringSearch().find(blind, experiment.of(*outputs)) == {}


def _explained(tests, experiment, samples=6):
    search = FrictionSearch(velocities=(0.01,), reaches=())
    trust = CommonPoles(friction=search, samples=samples).identify(tests, experiment).trust
    assert trust is not None
    return trust


@pytest.mark.nightly
def test_tires_that_lift_are_detected_with_the_mean_load_removed_from_the_records(smooth, experiment):
    lowest = min(float(test["tire_force"].min()) for test in smooth)
    for load, lifts in ((-1.02 * lowest, False), (-lowest, True)):
        flags = _explained(smooth, replace(experiment, means={"tire_force": load}), samples=0).flags
        assert ("lift-off" in flags) is lifts
    assert "lift-off" not in _explained(smooth, experiment, samples=0).flags


def test_a_drive_weights_responses_by_its_spectrum():
    """Compare a sine through a gain of 3 with one through a gain of 1: its RMS is three times as large."""
    time = np.arange(2000) / 100.0
    test = TimeSeries.from_channels(time, {"road": ("m", np.sin(2.0 * np.pi * 5.0 * time))})
    drive = Excitation.of(test, ("road",), (1.0, 20.0))
    A, B = np.array([[-1.0]]), np.zeros((1, 2))
    model = StateSpace(A, B, np.zeros((3, 1)), np.array([[1.0, 0.0], [3.0, 0.0], [0.0, 0.0]]),
                       (Channel("road", "m"), Channel("force", "N")),
                       (Channel("a", "m"), Channel("b", "m"), Channel("velocity", "m/s")))  # fmt: skip
    rms = drive.rms(model, {"": 1000.0})
    np.testing.assert_allclose(rms[:, 1] / rms[:, 0], 3.0)
