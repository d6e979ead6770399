"""A vehicle with a motion that grows is refused by name, rate and frequency before it becomes an FMU."""

from __future__ import annotations

import numpy as np
import pytest

from builder.product import vehicle_product
from eightpost.errors import FmuError
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, read_vehicle, shipped

STABLE = read_vehicle(shipped("quarter_car")).with_damper()


def car(growth, frequency=0.0, damping=0.0):
    """Return the quarter car with a pair that grows at a rate [1/s] beside it; `damping` is its baseline."""
    omega = 2.0 * np.pi * frequency
    A = np.block([[STABLE.A, np.zeros((4, 2))], [np.zeros((2, 4)), np.array([[growth, omega], [-omega, growth]])]])
    B, C = np.vstack([STABLE.B, np.ones((2, 3))]), np.hstack([STABLE.C, 1e-3 * np.ones((9, 2))])
    model = StateSpace(A, B, C, STABLE.D, STABLE.inputs, STABLE.outputs, name="growing")
    return IdentifiedVehicle("growing", model, {} if damping is None else {"": damping})


def test_dampers_that_are_removed_count():
    """The identified car has the damper of Table 4.1; a baseline that claims a hundredfold leaves a car that grows."""
    rate = read_vehicle(shipped("quarter_car")).parameters.damping
    assert IdentifiedVehicle("car", STABLE, {"": rate}).instability() is None
    assert "without dampers" in IdentifiedVehicle("car", STABLE, {"": 100.0 * rate}).instability()


def test_an_unstable_car_becomes_no_fmu():
    with pytest.raises(FmuError, match=r"'growing' is not stable: with its baseline dampers, a motion of 15\.6 Hz"):
        vehicle_product(car(900.0, 15.6), "growing")
    assert vehicle_product(car(-1.0, 15.6), "shrinking").interface.names("input") == ("force", "road", "aero_force")


@pytest.mark.parametrize(("without", "stable"), [(50.0, True), (200.0, False)])
def test_identification_finds_a_car_that_only_dampers_keep_from_growing_fast(without, stable):
    """One state with `x' = (w - k s) x` for dampers of s times the baseline: stable from s = 0.25 on."""
    inputs, outputs = (Channel("force", "N"),), (Channel("velocity", "m/s"),)
    one = np.ones((1, 1))
    model = StateSpace(-900.0 * one, -one, one, 0.0 * one, inputs, outputs)
    found = closed_loop_stability(IdentifiedVehicle("car", model, {"": 900.0 + without}))
    assert found.stable is stable
    if not stable:
        assert found.growth == pytest.approx(without)
        assert found.worst == {"": 0.0}
        assert found.summary() == "UNSTABLE: with dampers of port 0 N.s/m a motion grows at a rate of 2e+02 1/s"
