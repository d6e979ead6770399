"""Tests of dampers and springs at the shock ports: exact, or rejected if the conversion would not be exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.vehicle import (
    CORNERS,
    Friction,
    IdentifiedVehicle,
    QuarterCar,
    add_port_damping,
    add_port_stiffness,
    discretise,
    read_vehicle,
    shipped,
)

CASES = {
    "quarter_car": lambda car: {"": car.damping},
    "seven_dof": lambda car: dict(zip(CORNERS, car.damping, strict=True)),
}


def assert_same(found, expected):
    for name in ("A", "B", "C", "D"):
        matrix = getattr(expected, name)
        np.testing.assert_allclose(getattr(found, name), matrix, atol=1e-12 * np.abs(matrix).max())


@pytest.mark.parametrize("name", CASES)
def test_a_damper_at_the_port_equals_the_damper_of_the_equations(name):
    vehicle = read_vehicle(shipped(name))
    assert_same(add_port_damping(vehicle.coupled(), CASES[name](vehicle.parameters)), vehicle.with_damper())


@pytest.mark.parametrize("name", CASES)
def test_the_baseline_damping_of_an_identified_vehicle_is_removed(name):
    vehicle = read_vehicle(shipped(name))
    identified = IdentifiedVehicle("found", vehicle.with_damper(), CASES[name](vehicle.parameters))
    assert_same(identified.coupled(), vehicle.coupled())
    assert identified.with_damper() == vehicle.with_damper()


def test_a_vehicle_without_baseline_damping_is_coupled_without_change():
    model = read_vehicle(shipped("quarter_car")).coupled()
    assert IdentifiedVehicle("found", model).coupled() is model


def test_a_spring_at_the_port_equals_a_stiffer_spring_of_the_equations():
    vehicle = read_vehicle(shipped("quarter_car"))
    stiffer = replace(vehicle.parameters, suspension_stiffness=vehicle.parameters.suspension_stiffness + 7000.0)
    names = [n for n in vehicle.coupled().output_names if n != "spring_force"]
    found = add_port_stiffness(vehicle.coupled(), {"": 7000.0}).select(outputs=names)
    assert_same(found, stiffer.coupled().select(outputs=names))


@pytest.mark.parametrize("baseline", [{}, {"": 900.0}])
def test_a_car_with_a_progressive_spring_is_coupled_about_the_state_without_loads(baseline):
    """The spring is k1 d + k2 d^2; the identified model has its slope k1 + 2 k2 d at the travel d of the tests."""
    k1, k2, travel = 30e3, 4e5, 0.02
    tests = QuarterCar(300.0, 40.0, k1 + 2.0 * k2 * travel, 220e3, baseline.get("", 0.0))
    law = Friction(spring=k2, mean_travel=travel)
    names = [n for n in tests.coupled().output_names if n != "spring_force"]
    identified = tests.with_damper().select(outputs=names)
    car = IdentifiedVehicle("found", identified, baseline, friction={"": law})
    expected = QuarterCar(300.0, 40.0, k1, 220e3).coupled()
    assert_same(car.coupled(), expected.select(outputs=names))
    assert car.with_damper() == identified
    unloaded = car.unloaded()
    assert unloaded.friction == {"": Friction(spring=k2)}
    assert unloaded.unloaded() is unloaded
    assert unloaded.coupled() == car.coupled()


@pytest.mark.parametrize(("add", "place", "message"), [
    (add_port_stiffness, (1, 0), "a shock displacement must depend on the state alone"),
    (add_port_damping, (0, 2), "velocity has a direct term in force"),
])  # fmt: skip
def test_displacements_and_velocities_with_direct_terms_are_rejected(add, place, message):
    model = read_vehicle(shipped("quarter_car")).with_damper()
    direct = model.D.copy()
    direct[place] = 1e-3
    with pytest.raises(ParameterError, match=message):
        add(replace(model, D=direct), {"": 1000.0})


def test_discrete_models_and_unknown_ports_are_rejected():
    model = read_vehicle(shipped("quarter_car")).with_damper()
    with pytest.raises(ParameterError, match="continuous model only"):
        add_port_damping(discretise(model, 0.01), {"": 1000.0})
    with pytest.raises(ParameterError, match=r"unknown input 'lf\.force'"):
        add_port_damping(model, {"lf": 1000.0})
    with pytest.raises(ParameterError, match="no force input"):
        IdentifiedVehicle("found", model, {"lf": 1000.0})
