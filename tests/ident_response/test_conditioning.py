"""Tests of residual fits and smoothing of frequency responses."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.frequency_response import HighResidual, ZeroPhaseSmoothing

F = np.arange(0.05, 40.0, 0.05)


def test_the_high_residual_continues_slope_and_phase_of_its_control_points():
    law = 7.0 * np.exp(0.5j) / F**2
    spoiled = np.where(F > 20.001, law * (1.0 + 0.5 * np.sin(20.0 * F)), law)
    spoiled[np.argmin(np.abs(F - 30.0))] = law[np.argmin(np.abs(F - 30.0))]
    treated = HighResidual(20.0, 30.0).apply(F, spoiled)
    np.testing.assert_allclose(treated, law, rtol=1e-9)


def test_smoothing_removes_narrow_ripple_without_a_shift_in_frequency():
    smooth = np.exp(-((F - 10.0) ** 2) / 50.0) * np.exp(-0.1j * F)
    ripple = 1.0 + 0.05 * np.sin(2.0 * np.pi * F / 0.2)
    treated = ZeroPhaseSmoothing().apply(F, smooth * ripple)
    inside = (F > 2.0) & (F < 38.0)
    assert np.abs(treated / smooth - 1.0)[inside].max() < 0.002


def test_control_points_outside_the_response_are_rejected():
    with pytest.raises(ParameterError, match="control points"):
        HighResidual(20.0, 50.0).apply(F, np.ones(F.size, dtype=complex))
