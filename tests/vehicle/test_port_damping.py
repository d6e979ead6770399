"""Tests of dampers at the shock ports: exact, or rejected if the conversion would not be exact."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.vehicle import (
    CORNERS,
    IdentifiedVehicle,
    add_port_damping,
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


def test_velocities_with_direct_terms_are_rejected():
    model = read_vehicle(shipped("quarter_car")).with_damper()
    broken = model.D.copy()
    broken[0, 2] = 1e-3
    bad = type(model)(model.A, model.B, model.C, broken, model.inputs, model.outputs)
    with pytest.raises(ParameterError, match="velocity has a direct term in force"):
        add_port_damping(bad, {"": 1000.0})


def test_discrete_models_and_unknown_ports_are_rejected():
    model = read_vehicle(shipped("quarter_car")).with_damper()
    with pytest.raises(ParameterError, match="continuous model only"):
        add_port_damping(discretise(model, 0.01), {"": 1000.0})
    with pytest.raises(ParameterError, match=r"unknown input 'lf\.force'"):
        add_port_damping(model, {"lf": 1000.0})
    with pytest.raises(ParameterError, match="no force input"):
        IdentifiedVehicle("found", model, {"lf": 1000.0})
