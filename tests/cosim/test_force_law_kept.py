"""Forces and derivatives of shocks as force laws along a fixed motion, kept number by number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from cosim import ExtrapolatedForce, ForceLaw, HeldForce
from eightpost.errors import InputError
from eightpost.shock import LAWS

CORNERS = ("lf", "rr")
STEP = 2e-3
TIME = STEP * np.arange(40)


def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and displacements of two corners."""
    phase = np.array([0.0, 0.9])
    return 0.4 * np.sin(60.0 * t + phase), -0.4 / 60.0 * np.cos(60.0 * t + phase)


@pytest.mark.parametrize("name", LAWS)
def test_forces_and_derivatives_of_a_law_are_unchanged(
    name: str, fmus: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    parameters = {"lf": {"rebound_scale": 1.3, "gas_stiffness": 900.0}, "rr": {"gas_preload": 40.0}}
    forces, tried, slopes = [], [], []
    with ForceLaw([fmus[name]] * 2, corners=CORNERS, parameters=parameters) as law:
        forces.append(law.start(0.0, *motion(0.0)))
        for t in TIME[1:].tolist():
            tried.append(law.force(t - 0.5 * STEP, *motion(t - 0.3 * STEP)))
            slopes.append(np.stack(law.jacobian(t, *motion(t))))
            forces.append(law.accept(t, *motion(t)))
        again = law.accept(TIME[-1], *motion(TIME[-1]))
        with pytest.raises(InputError, match="before"):
            law.force(TIME[-1] - STEP, *motion(0.0))
    unchanged({"forces": np.array(forces), "tried": np.array(tried), "again": again}, relative=1e-6)
    unchanged(np.array(slopes), "slopes", relative=1e-4)


@pytest.mark.parametrize("kind", [HeldForce, ExtrapolatedForce])
def test_forces_that_are_held_over_a_step_are_unchanged(
    kind: type[HeldForce | ExtrapolatedForce], fmus: Mapping[str, Path], unchanged: Callable[..., None]
) -> None:
    found = {}
    for name in ("polylinear", "lpnl2"):
        with kind([fmus[name]] * 2, corners=CORNERS) as loop:
            forces = [loop.start(0.0, *motion(0.0))]
            forces += [loop.step(t, STEP, *motion(t)) for t in TIME.tolist()]
        found[name] = np.array(forces)
    unchanged(found, relative=1e-6)


@pytest.mark.parametrize("changed", ["time", "velocity", "displacement", "nothing"])
def test_a_point_that_was_tried_is_accepted_as_it_is_only_at_its_own_time_and_motion(
    changed: str, fmus: Mapping[str, Path]
) -> None:
    with ForceLaw(fmus["lpnl2"]) as law:
        forces = []
        for is_tried in (False, True):
            law.start(0.0, 0.05, 0.001)
            if is_tried:
                time, velocity, travel = 2e-3 * (changed != "time") + 1e-3, 0.12, 0.002
                law.force(time, velocity + 0.1 * (changed == "velocity"), travel + 0.01 * (changed == "displacement"))
            forces.append(law.accept(3e-3, 0.12, 0.002))
        assert forces[0] == forces[1]
