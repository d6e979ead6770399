"""Tests of the virtual dynamometer and their drive files, by name (dissertation 3.2.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.rig.multisine import random_multisine
from eightpost.rig.sines import sine_tests
from eightpost.rig.steps import bump, static_steps

if TYPE_CHECKING:
    from eightpost.signals.drivefile import Drivefile

#: Length of the random test [s].
RANDOM_DURATION = 30.0


def program(*, seed: int) -> dict[str, Drivefile]:
    """Return all tests of 3.2.3 by name. There are two random tests: one to fit, and another draw to validate.

    Args:
        seed: Seed of the phases of the first random test; the second test uses the next seed.
    """
    tests = {
        "random": random_multisine(seed, duration=RANDOM_DURATION),
        "random_validation": random_multisine(seed + 1, duration=RANDOM_DURATION),
    }
    tests |= {f"sine_{test.name}": test.drivefile for test in sine_tests()}
    return tests | {"static": static_steps(), "bump": bump()}
