"""Stability of a car with any shocks, and the ranges of its tests."""

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.ident.vehicle.stability import closed_loop_stability, safe_slopes
from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace

from .conftest import BASELINE


@pytest.mark.parametrize(("name", "ports"), [("quarter_car", ("",)), ("seven_dof", CORNERS)])
def test_a_car_of_masses_and_springs_is_stable_with_any_shock(name, ports, request):
    found = safe_slopes(request.getfixturevalue(name), dict.fromkeys(ports, BASELINE))
    assert found.softest is not None
    assert found.softest <= 0.02
    assert "any shocks" in found.summary().lower()


def test_a_port_whose_force_acts_in_the_wrong_direction_is_reported():
    # v' = -v - 20 v + F / 50 around 1000 N.s/m: the damper's force drives the motion.
    model = StateSpace(np.array([[-30.0]]), np.array([[0.02]]), np.array([[1.0]]), np.zeros((1, 1)),
                       (Channel("force", "N"),), (Channel("velocity", "m/s"),))  # fmt: skip
    found = safe_slopes(model, {"": 1000.0})
    assert found.softest is None
    assert "not proved" in found.summary()


@pytest.mark.parametrize("in_the_loop", [False, True])
def test_only_a_growing_part_between_shock_force_and_velocity_makes_the_loop_unstable(quarter_car, in_the_loop):
    one, n = quarter_car, len(quarter_car.A)
    force, velocity = one.input_names.index("force"), one.output_names.index("velocity")
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, n] = one.A, 5.0
    B, C = np.vstack([one.B, np.zeros(len(one.inputs))]), np.hstack([one.C, np.zeros((len(one.outputs), 1))])
    B[n, force if in_the_loop else one.input_names.index("road")] = 1e-6
    C[velocity if in_the_loop else one.output_names.index("tire_force"), n] = 1.0
    model = StateSpace(A, B, C, one.D, one.inputs, one.outputs)
    assert closed_loop_stability(IdentifiedVehicle("car", model, {"": BASELINE})).stable is not in_the_loop
