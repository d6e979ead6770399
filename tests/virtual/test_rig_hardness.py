"""Linear models predict the 8-post stand-in inaccurately, and only because of its friction."""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eightpost.virtual import stand_in_truth


def _beside(name):
    """Import a module from this folder, which is not a package."""
    spec = importlib.util.spec_from_file_location(f"eightpost_tests_{name}", Path(__file__).with_name(f"{name}.py"))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


best_linear = _beside("best_linear")

#: From soft to hard at all corners, and front against rear; baseline and alternate are 20 and 9 lbf.s/in.
SETUPS = [(20, 20, 20, 20), (9, 9, 9, 9), (30, 30, 30, 30), (12, 12, 25, 25), (28, 28, 12, 12), (10, 30, 10, 30)]


def car_with(friction):
    return stand_in_truth() if friction == "on" else stand_in_truth().without_friction()


@cache
def model_of(friction, record):
    return best_linear.linear_model(car_with(friction), duration=record)


def error_of(friction, *, lap_seed, duration, record):
    """Return the RMS of the relative errors [%] over all measures and setups."""
    model = model_of(friction, record)
    errors = best_linear.relative_errors(car_with(friction), model, SETUPS, seed=lap_seed, duration=duration)
    assert errors.shape == (len(SETUPS), 15)
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.nightly
@pytest.mark.parametrize(("friction", "least", "most"), [("on", 2.5, 8.0), ("off", 0.0, 0.5)])
def test_the_best_linear_model_is_inaccurate_with_friction_and_accurate_without(friction, least, most):
    assert least <= error_of(friction, lap_seed=1, duration=12.0, record=100.0) < most


@pytest.mark.nightly
@pytest.mark.parametrize("lap_seed", [1, 2, 3])
@pytest.mark.parametrize(("friction", "least", "most"), [("on", 2.5, 8.0), ("off", 0.0, 0.5)])
def test_longer_records_on_whole_laps_give_the_same_conclusion(friction, least, most, lap_seed):
    assert least <= error_of(friction, lap_seed=lap_seed, duration=33.0, record=300.0) < most
