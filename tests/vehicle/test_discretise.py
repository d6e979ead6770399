"""Tests of discrete models against scipy and python-control."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.signal import cont2discrete

from eightpost.errors import ParameterError
from eightpost.vehicle import discretise, read_vehicle, shipped

MODELS = [read_vehicle(shipped(name)).with_damper() for name in ("quarter_car", "seven_dof")]
MATRICES = ("A", "B", "C", "D")


def assert_same(found, expected):
    for name, matrix in zip(MATRICES, expected, strict=True):
        np.testing.assert_allclose(getattr(found, name), matrix, rtol=1e-9, atol=1e-11 * np.abs(matrix).max())


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("step", [1e-4, 0.002, 0.01])
def test_zero_order_hold_agrees_with_scipy_and_python_control(model, step):
    found = discretise(model, step)
    matrices = tuple(getattr(model, name) for name in MATRICES)
    assert_same(found, cont2discrete(matrices, step, "zoh")[:4])
    witness = control.c2d(model.to_control(), step, "zoh")
    assert_same(found, tuple(getattr(witness, name) for name in MATRICES))
    assert (found.dt, found.inputs, found.outputs) == (step, model.inputs, model.outputs)


def test_first_order_hold_is_exact_for_straight_lines():
    model = MODELS[0]
    t = np.arange(0.0, 0.5, 0.005)
    u = np.interp(t, [0.0, 0.1, 0.3, 0.5], [0.0, 0.01, -0.01, 0.0]) * np.array([[1.0], [1e4], [5e4]])
    expected = control.forced_response(model.to_control(), t, u).outputs
    found = control.forced_response(discretise(model, 0.005, "first").to_control(), t, u).outputs
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("step", "hold", "message"), [(0.0, "zero", "above zero"), (0.01, "second", "choose 'zero' or 'first'")]
)
def test_invalid_steps_and_holds_are_rejected(step, hold, message):
    with pytest.raises(ParameterError, match=message):
        discretise(MODELS[0], step, hold)


def test_a_discrete_model_is_rejected():
    with pytest.raises(ParameterError, match="already discrete"):
        discretise(discretise(MODELS[0], 0.01), 0.01)
