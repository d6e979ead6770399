"""Which shocks a car takes, and where its tests end."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident.vehicle.common_poles import Ranges, swapping
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, StateSpace

from .conftest import BASELINE

CORNERS = ("lf", "rf", "lr", "rr")


@pytest.mark.parametrize(("name", "ports"), [("quarter_car", ("",)), ("seven_dof", CORNERS)])
def test_a_car_of_masses_and_springs_takes_any_shock(
    name: str, ports: tuple[str, ...], request: pytest.FixtureRequest
) -> None:
    found = swapping(request.getfixturevalue(name), dict.fromkeys(ports, BASELINE))
    assert found.softest is not None
    assert found.softest <= 0.02
    assert "any shocks" in found.said().lower()


def test_a_port_whose_force_pushes_the_wrong_way_is_told() -> None:
    # v' = -v - 20 v + F / 50 around 1000 N.s/m: the damper's force drives the motion.
    model = StateSpace(np.array([[-30.0]]), np.array([[0.02]]), np.array([[1.0]]), np.zeros((1, 1)),
                       (Channel("force", "N"),), (Channel("velocity", "m/s"),))  # fmt: skip
    found = swapping(model, {"": 1000.0})
    assert found.softest is None
    assert "not proved" in found.said()


def _simulated(speed: float, hz: float) -> TimeSeries:
    time = np.arange(4000) / 400.0
    return TimeSeries.from_channels(time, {"velocity": ("m/s", speed * np.sin(2.0 * np.pi * hz * time))})


def test_faster_and_higher_than_the_tests_is_called_extrapolated() -> None:
    ranges = Ranges((0.2, 16.0), {"velocity": (-0.4, 0.5)})
    assert ranges.beyond(_simulated(0.5, 4.0)) == ()
    assert "0.9" in ranges.beyond(_simulated(0.9, 4.0))[0]
    assert "16 Hz" in ranges.beyond(_simulated(0.4, 30.0))[0]
