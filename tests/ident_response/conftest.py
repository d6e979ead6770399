"""The two cars of the dissertation on a rig, simulated once per session."""

from __future__ import annotations

import pytest

from .rig_tests import Rig, rig


@pytest.fixture(scope="session")
def quarter_car() -> Rig:
    """Table 4.1, 100 s: the linear shock, then another."""
    outputs = ("velocity", "tire_force", "ride_height", "hub_acceleration", "chassis_position")
    return rig("quarter_car", 100.0, {"road": 0.004, "aero_force": 400.0}, outputs)


@pytest.fixture(scope="session")
def seven_dof() -> Rig:
    """Table 5.1, 100 s: the baseline, then another shock at one corner after the other."""
    sizes = {f"{corner}.road": 0.004 for corner in ("lf", "rf", "lr", "rr")}
    sizes |= {"heave_force": 1000.0, "roll_moment": 600.0, "pitch_moment": 1000.0}
    outputs = tuple(f"{corner}.{kind}" for kind in ("velocity", "tire_force") for corner in ("lf", "rf", "lr", "rr"))
    return rig("seven_dof", 100.0, sizes, (*outputs, "front.ride_height", "rear.ride_height"))
