"""A car whose model has two equal pairs of modes that share an eigenvector."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from eightpost.vehicle import Channel, IdentifiedVehicle, StateSpace, read_vehicle, shipped

#: Frequency [rad/s] and damping ratio of the seat, and of the head of its driver.
FREQUENCY, DAMPING = 2.0 * np.pi * 15.6, 0.068


def car_with_seat() -> IdentifiedVehicle:
    """Return the seven-DOF car with a seat on its chassis and a head on the seat, equal and too light to react.

    The head follows the seat as the seat follows the chassis, so the two pairs of modes have one eigenvector.
    """
    car = read_vehicle(shipped("seven_dof")).coupled()
    n, heave = len(car.A), car.C[car.output_names.index("heave")]
    one = np.array([[0.0, FREQUENCY], [-FREQUENCY, -2.0 * DAMPING * FREQUENCY]])
    A = block_diag(car.A, one, one)
    A[n + 1, :n] = FREQUENCY * heave
    A[n + 3, n] = FREQUENCY
    moved = np.append(np.zeros(n), FREQUENCY**2 * np.array([1.0, 0.0, -1.0, -2.0 * DAMPING]))
    outputs = (*car.outputs, Channel("driver.acceleration", "m/s2"))
    C = np.concatenate([np.pad(car.C, ((0, 0), (0, 4))), moved[None, :]])
    D = np.pad(car.D, ((0, 1), (0, 0)))
    model = StateSpace(A, np.pad(car.B, ((0, 4), (0, 0))), C, D, car.inputs, outputs, name="car with seat")
    return IdentifiedVehicle("car with seat", model)
