"""Port springs at another mean load than that of the tests: the stiffness and the travel of the true car there."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.ident.vehicle import plan
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.port_search import about_loads, about_tests
from eightpost.ident.vehicle.simulation import bristle_force, direction, with_port_laws
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, LinearStepper, QuarterCar
from eightpost.vehicle import friction as port_friction
from eightpost.vehicle.compiled import deflections

#: Spring of the true car: k1 d + k2 d^2.
K1, K2 = 30e3, 4e5


def travel(load):
    """Return the compression of the true spring under a load."""
    return (np.sqrt(K1**2 + 4.0 * K2 * load) - K1) / (2.0 * K2)


def car_about(load):
    """Return the car as tests with this mean load find it."""
    model = QuarterCar(300.0, 40.0, K1 + 2.0 * K2 * travel(load), 220e3, 1500.0).with_damper()
    return IdentifiedVehicle("car", model, {"": 1500.0}, friction={"": Friction(20.0, 0.004, spring=K2)})


@pytest.mark.parametrize("load", [0.0, 400.0, 1200.0, -400.0])
def test_the_mean_travel_of_the_tests_is_that_of_the_true_spring(load):
    found = about_tests(car_about(load), {"aero_force": load})
    assert found.friction[""] == Friction(20.0, 0.004, spring=K2, mean_travel=pytest.approx(travel(load), rel=1e-9))
    assert replace(found, friction={}) == replace(car_about(load), friction={})


@pytest.mark.parametrize("tested", [0.0, 800.0])
@pytest.mark.parametrize("used", [0.0, 300.0, 1500.0])
def test_a_study_at_another_mean_load_starts_at_the_true_travel_with_the_true_stiffness(tested, used):
    car = about_tests(car_about(tested), {"aero_force": tested})
    model = car.coupled()
    stepper = LinearStepper(model.A, model.B, model.C, model.D)
    ports = port_friction.named_ports(stepper, (model.input_names, model.output_names), [""], [""])
    none = np.zeros(1)
    spring = port_friction.PortFriction(ports, none, none + 1.0, spring=np.array([car.friction[""].spring]))
    places = [
        (ports.displacement @ port_friction.equilibrium(stepper, spring, np.array([0.0, load, 0.0])))[0]
        for load in (used, used + 1e-3)
    ]
    assert places[0] == pytest.approx(travel(used), rel=1e-9)
    assert 1e-3 / (places[1] - places[0]) == pytest.approx(K1 + 2.0 * K2 * travel(used), rel=1e-4)


@pytest.mark.parametrize("tested", [0.0, 800.0])
def test_a_car_about_the_loads_of_a_drive_is_the_one_that_tests_with_these_loads_find(tested):
    car = about_tests(car_about(tested), {"aero_force": tested})
    for used in (0.0, 300.0, 1500.0, tested):
        found, expected = about_loads(car, {"aero_force": used}), car_about(used)
        assert found.friction == expected.friction
        np.testing.assert_allclose(found.state_space.A, expected.state_space.A, rtol=1e-8, atol=1e-8)
    assert about_loads(replace(car, friction={}), {"aero_force": 300.0}).state_space == car.state_space


def test_a_car_without_a_state_without_loads_is_unchanged():
    """The force in extension, k1 d - k2 d^2, is at most k1^2 / 4 k2."""
    model = QuarterCar(300.0, 40.0, K1, 220e3, 1500.0).with_damper()
    car = IdentifiedVehicle("car", model, {"": 1500.0}, friction={"": Friction(spring=K2)})
    assert about_tests(car, {"aero_force": 1.01 * K1**2 / (4.0 * K2)}) is car


def test_a_car_without_springs_is_unchanged():
    car = replace(car_about(0.0), friction={"": Friction(20.0)})
    assert about_tests(car, {"aero_force": 500.0}) is car


@dataclass(frozen=True)
class Fit:
    """The part of a fit that matters here."""

    vehicle: IdentifiedVehicle
    notes: tuple[str, ...] = ()

    def identify(self, _records, _experiment):
        """Return the fit as a recipe does."""
        return self


def test_the_mean_loads_of_the_baseline_test_are_those_of_the_identified_car(monkeypatch):
    """The means of roads and shock forces depend on where their sensors are zero, and are left out."""
    means = {"road": 0.3, "aero_force": 800.0, "force": 250.0, "tire_force": 3000.0}
    experiment = Experiment("car", ("road", "aero_force"), ("force",), ("velocity",), {"": 1500.0}, means=means)
    monkeypatch.setattr(plan, "recipe", lambda _name: Fit(car_about(800.0)))
    monkeypatch.setattr(plan, "with_validity", lambda fit, _reasons: fit)
    monkeypatch.setattr(plan, "reasons_of_tests", lambda *_given: ())
    prepared, baseline = SimpleNamespace(records=[None], reasons=()), SimpleNamespace(order=(0,))
    found = plan.IdentificationPlan(prepared, baseline, experiment).identify("common-poles")
    assert found.vehicle.friction[""].mean_travel == pytest.approx(travel(800.0), rel=1e-9)
    unknown = plan.IdentificationPlan(prepared, baseline, replace(experiment, means={})).identify("common-poles")
    assert unknown.vehicle == car_about(800.0)


RATE, LAW = 500.0, Bristle(80.0, 1e-4, 1.15, 0.01)
TIME = np.arange(0.0, 20.0, 1.0 / RATE)
VELOCITY = 0.05 * np.sin(2 * np.pi * 1.3 * TIME) + 0.03 * np.sin(2 * np.pi * 9.7 * TIME)


def record():
    displacement = np.concatenate(([0.0], np.cumsum(0.5 * (VELOCITY[1:] + VELOCITY[:-1])) / RATE))
    channels = {"force": ("N", 300.0 * VELOCITY), "velocity": ("m/s", VELOCITY), "displacement": ("m", displacement)}
    return TimeSeries.from_channels(TIME, channels)


def test_the_signal_is_that_of_a_fine_simulation_below_half_the_rate():
    fine = np.arange(TIME.size * 40) / (40.0 * RATE)
    velocity = 0.05 * np.sin(2 * np.pi * 1.3 * fine) + 0.03 * np.sin(2 * np.pi * 9.7 * fine)
    exact = np.fft.rfft(LAW.force_at(deflections(velocity, 1.0 / (40.0 * RATE), LAW)))[: TIME.size // 2] / 40.0
    found = np.fft.rfft(bristle_force(VELOCITY, RATE, LAW))[: TIME.size // 2]
    band = slice(0, TIME.size // 10)  # 50 Hz
    assert np.linalg.norm(found[band] - exact[band]) < 2e-3 * np.linalg.norm(exact[band])


def test_a_bristle_of_another_force_has_a_signal_in_proportion():
    np.testing.assert_allclose(
        bristle_force(VELOCITY, RATE, LAW), 80.0 * bristle_force(VELOCITY, RATE, Bristle(1.0, 1e-4, 1.15)), rtol=1e-12
    )


def test_friction_bristle_and_spring_are_added_to_the_shock_force():
    series, law = record(), Friction(20.0, 0.01, LAW, 1e5)
    creeping, sticking = 20.0 * direction(VELOCITY, RATE, 0.01), bristle_force(VELOCITY, RATE, LAW)
    expected = series["force"] + creeping + sticking + 1e5 * series["displacement"] ** 2
    np.testing.assert_array_equal(with_port_laws(series, {"": law})["force"], expected)


@pytest.mark.parametrize("rate", [2500.0, 4000.0])
def test_a_fast_record_is_not_resampled(rate):
    v = VELOCITY[:4000]
    np.testing.assert_array_equal(bristle_force(v, rate, LAW), LAW.force_at(deflections(v, 1.0 / rate, LAW)))
