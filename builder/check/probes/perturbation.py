"""Perturbed values of variables."""

from __future__ import annotations

import random

from builder.check.description import Variable
from builder.check.probes.bench import amplitude, inside


def other_value(variable: Variable, draw: random.Random) -> float:
    """Return a random value in the range, within one amplitude (inputs) or 10 % (parameters) of the start value."""
    start = variable.number("start") or 0.0
    size = amplitude(variable) if variable.causality == "input" else (0.1 * abs(start) or 0.1)
    change = size * draw.uniform(-1.0, 1.0)
    if inside(variable, start + change) != start + change:
        change = -change  # at the end of the range, change in the other direction
    return inside(variable, start + change)


def change_of(variable: Variable) -> float:
    """Return a change that is small compared with the variable and large compared with rounding errors."""
    start = abs(variable.number("start") or 0.0)
    return 1e-3 * (amplitude(variable) if variable.causality == "input" else start or 0.1)
