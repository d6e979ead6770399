"""Exact responses of known cars around a baseline damping."""

import numpy as np
import pytest

from eightpost.ident.vehicle.frequency_response import FrequencyResponse, response_of
from eightpost.units import convert
from eightpost.vehicle import add_port_damping, read_vehicle, shipped

BASELINE = convert(17.5, "lbf/(in/s)", "N.s/m")
FREQUENCY = np.arange(0.1, 20.0, 0.1)
MEASURED = ("velocity", "displacement", "tire_force", "ride_height", "hub_acceleration")


def _car(name):
    model = read_vehicle(shipped(name)).coupled()  # type: ignore[arg-type]
    ports = [n.removesuffix("force").rstrip(".") for n in model.input_names if n.rpartition(".")[2] == "force"]
    outputs = [n for n in model.output_names if n.rpartition(".")[2] in MEASURED]
    return add_port_damping(model, dict.fromkeys(ports, BASELINE)).select(outputs=outputs)


@pytest.fixture(scope="session")
def quarter_car():
    """Table 4.1 with the damper of Table 4.2's ideal column."""
    return _car("quarter_car")


@pytest.fixture(scope="session")
def seven_dof():
    """Table 5.1 with the same damper at every port."""
    return _car("seven_dof")


def noisy(model, size, seed, frequency=FREQUENCY):
    """Return a response with independent errors of `size` times each path's RMS, and their variance."""
    exact = response_of(model, frequency)
    rms = size * np.sqrt(np.mean(np.abs(exact.H) ** 2, axis=2, keepdims=True))
    generator = np.random.default_rng(seed)
    errors = np.sqrt(0.5) * (generator.standard_normal(exact.H.shape) + 1j * generator.standard_normal(exact.H.shape))
    variance = np.broadcast_to(rms**2, exact.H.shape)
    return FrequencyResponse(frequency, exact.H + rms * errors, exact.inputs, exact.outputs, None, None, variance)
