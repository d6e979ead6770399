"""Fixtures with rig tests of the dissertation's two cars, simulated once per session."""

import pytest

from eightpost.corners import CORNERS

from .rig_tests import rig


@pytest.fixture(scope="session")
def quarter_car():
    """Quarter car of Table 4.1, 100 s: a test with the baseline shock and one with another shock."""
    outputs = ("velocity", "tire_force", "ride_height", "hub_acceleration", "chassis_position")
    return rig("quarter_car", 100.0, {"road": 0.004, "aero_force": 400.0}, outputs)


@pytest.fixture(scope="session")
def seven_dof():
    """Seven-DOF car of Table 5.1, 100 s: a baseline test, then a test with another shock at each corner in turn."""
    sizes = {f"{corner}.road": 0.004 for corner in CORNERS}
    sizes |= {"heave_force": 1000.0, "roll_moment": 600.0, "pitch_moment": 1000.0}
    outputs = tuple(f"{corner}.{kind}" for kind in ("velocity", "tire_force") for corner in CORNERS)
    return rig("seven_dof", 100.0, sizes, (*outputs, "front.ride_height", "rear.ride_height"))
