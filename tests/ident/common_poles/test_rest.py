"""Velocities of a model come to rest under constant inputs, also if the system for that is singular."""

import numpy as np
import pytest

from eightpost.ident.vehicle.common_pole_fit import _bring_to_rest
from eightpost.vehicle.statespace import Channel, StateSpace


def model(C, names):
    A = np.array([[-1.0, 30.0, 0.0, 0.0], [-30.0, -1.0, 0.0, 0.0], [0.0, 0.0, -4.0, 70.0], [0.0, 0.0, -70.0, -4.0]])
    B = np.array([[1.0, 0.2], [0.5, -0.3], [0.1, 1.0], [-0.4, 0.6]])
    outputs = tuple(Channel(name, "m/s") for name in names)
    inputs = (Channel("lf.road", "m"), Channel("lf.force", "N"))
    return StateSpace(A, B, C, np.zeros((len(names), 2)), inputs, outputs, None, "two modes")


@pytest.mark.parametrize(
    "rows",
    [
        [[1.0, 0.3, 0.2, -0.5], [0.1, -0.4, 0.9, 0.7]],
        [[1.0, 0.3, 0.2, -0.5], [1.0, 0.3, 0.2, -0.5]],
        [[1.0, 0.3, 0.2, -0.5], [0.0, 0.0, 0.0, 0.0]],
    ],
    ids=["two velocities", "the same velocity twice", "a velocity that never moves"],
)
def test_velocities_have_no_response_to_constant_inputs(rows):
    car = model(np.array(rows), ("lf.velocity", "rf.velocity"))
    s = 2j * np.pi * np.linspace(0.5, 25.0, 50)
    still = _bring_to_rest(car, 4, s, np.ones((2, s.size)))
    response = still.C @ np.linalg.solve(still.A, still.B)
    assert np.abs(response).max() < 1e-12 * np.abs(car.C @ np.linalg.solve(car.A, car.B)).max() + 1e-14
