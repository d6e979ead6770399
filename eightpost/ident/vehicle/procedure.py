"""Verdict rules on the rig tests of an identification: long and large enough, tires on the ground, always the same car.

The rules read the records only, so that they are the same for every recipe.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.agreement import LIMITS, Agreement, Change, compare_tests
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.verdict import Grade, Reason, Rules, listed

ABOUT = "rig tests"

#: Equations per unknown that a response needs in a band, and width of the band [Hz] up to which the response of a car
#: hardly varies in it.
_EQUATIONS, _WIDEST = 4.5, 0.6

#: Friction relative to the RMS of the shock force, and share of the time in which a shock is slower than it slides,
#: above which friction holds the car [1].
_RUBS, _STICKS = 0.3, 0.4

#: Velocity below which a shock hardly slides [m/s].
_SLOW = 0.006

#: Share of its mean load below which a tire has lifted [1]; shares of the time that matter, and that are too many [1].
_LIFTED, _SHORTLY, _OFTEN = 0.01, 0.001, 0.01

RULES = Rules()

SHORT = RULES.add("short tests", ABOUT, Grade.LIMITED,
    condition="the inputs can be separated only in bands wider than "
    f"{_WIDEST:g} Hz: {_EQUATIONS:g} (1 + inputs / tests) / duration",
    why="resonances of the body are as narrow, so that noise and leakage become errors of the response",
    remedy="repeat the tests with at least the stated duration",
)  # fmt: skip
HELD = RULES.add("friction holds the car", ABOUT, Grade.NOT_USABLE,
    condition=f"at a wheel, friction is above {100 * _RUBS:g} % of the RMS of the shock force, and the shock is slower "
    f"than {1e3 * _SLOW:g} mm/s for more than {100 * _STICKS:g} % of the time",
    why="a car that sticks is another car than one that slides",
    remedy="repeat the tests with larger roads, as large as those of the track",
)  # fmt: skip
OFTEN_LIFTED = RULES.add("tires often leave the ground", ABOUT, Grade.NOT_USABLE,
    condition=f"a tire is at {100 * _LIFTED:g} % of its mean load or less for more than {100 * _OFTEN:g} % of a test",
    why="the model has no tires that lift, and takes what they do for softer tires",
    remedy="repeat the tests with smaller roads",
)  # fmt: skip
LIFTED = RULES.add("tires leave the ground", ABOUT, Grade.LIMITED,
    condition=f"the same for more than {100 * _SHORTLY:g} % of a test",
    why="the model has no tires that lift, and takes what they do for softer tires",
    remedy="repeat the tests with smaller roads",
)  # fmt: skip
_COMPARED = (
    "which is more than six standard deviations (docs/how_to/rig_data.md): "
    + "; ".join(f"{name} {{{name}}}" for name in LIMITS)
)
OTHER_CAR = RULES.add("the car changed much", ABOUT, Grade.NOT_USABLE,
    condition="a quantity of the car differs by more than six standard deviations, and by at least: "
    + ", ".join(f"{name} {100 * limit.unusable:g} %" for name, limit in LIMITS.items()),
    why="the model is that of no car: the change becomes false damping, or an error of every response",
    remedy="restore the car, and repeat these tests",
)  # fmt: skip
CHANGED = RULES.add("the car changed", ABOUT, Grade.LIMITED,
    condition="the same from test to test by at least: "
    + ", ".join(f"{name} {100 * limit.tests:g} %" for name, limit in LIMITS.items())
    + "; or from the first to the second half of a test by at least: "
    + ", ".join(f"{name} {100 * limit.halves:g} %" for name, limit in LIMITS.items()),
    why="the model is a mean of several cars, and differences between setups contain those of the car",
    remedy="restore the car, and repeat these tests",
)  # fmt: skip
