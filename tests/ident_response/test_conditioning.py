"""Tests of residual fits, smoothing, zeroed paths and the number of feedback paths."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.frequency_response import (
    FrequencyResponse,
    HighResidual,
    LowResidual,
    Zeroed,
    ZeroPhaseSmoothing,
    condition,
    feedback_paths,
)
from eightpost.vehicle import Channel

F = np.arange(0.05, 40.0, 0.05)

#: Table 6.5, paths from the shock forces (LF, RF, LR, RR) that are not zeroed. The rows of the shock velocities are
#: printed with shifted cells; Table 6.6 follows if each shock is zeroed at the other corner of its side.
TABLE_6_5 = np.array([
    [1, 1, 0, 1], [1, 1, 1, 0], [0, 1, 1, 1], [1, 0, 1, 1],  # shock velocities
    [1, 0, 1, 1], [0, 1, 1, 1], [0, 1, 1, 1], [1, 0, 1, 1],  # tire forces
    [1, 1, 1, 1], [1, 1, 1, 1],  # ride heights
    [1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 0, 1, 1],  # hub accelerations
], dtype=bool)  # fmt: skip

TABLE_6_6 = np.array([
    [3, 2, 2, 2], [2, 3, 2, 2], [2, 2, 3, 2], [2, 2, 2, 3],
    [2, 2, 2, 3], [2, 2, 3, 2], [2, 2, 3, 2], [2, 2, 2, 3],
    [3, 3, 3, 3], [3, 3, 3, 3],
    [2, 2, 1, 1], [2, 2, 1, 1], [1, 1, 2, 2], [1, 1, 2, 2],
])  # fmt: skip


def _response(*paths: np.ndarray) -> FrequencyResponse:
    outputs = tuple(Channel(f"y{i}", "m") for i in range(len(paths)))
    return FrequencyResponse(F, np.stack(paths)[:, None, :], (Channel("u", "m"),), outputs)


def test_table_6_6_follows_from_table_6_5() -> None:
    np.testing.assert_array_equal(feedback_paths(TABLE_6_5, range(4)), TABLE_6_6)


def test_the_high_residual_continues_slope_and_phase_of_its_control_points() -> None:
    law = 7.0 * np.exp(0.5j) / F**2
    spoiled = np.where(F > 20.001, law * (1.0 + 0.5 * np.sin(20.0 * F)), law)
    spoiled[np.argmin(np.abs(F - 30.0))] = law[np.argmin(np.abs(F - 30.0))]
    treated = condition(_response(spoiled), HighResidual(20.0, 30.0))
    np.testing.assert_allclose(treated.H[0, 0], law, rtol=1e-9)


def test_the_low_residual_goes_on_with_slope_and_linear_phase() -> None:
    law = 0.3 * np.exp(1j * (0.4 - 0.7 * F)) * F**1.5
    spoiled = np.where(F < 0.999, 5.0, law)
    treated = condition(_response(spoiled), LowResidual(1.0, 4.0))
    np.testing.assert_allclose(treated.H[0, 0], law, rtol=1e-9)


def test_smoothing_removes_narrow_ripple_without_a_shift_in_frequency() -> None:
    smooth = np.exp(-((F - 10.0) ** 2) / 50.0) * np.exp(-0.1j * F)
    ripple = 1.0 + 0.05 * np.sin(2.0 * np.pi * F / 0.2)
    treated = condition(_response(smooth * ripple), ZeroPhaseSmoothing()).H[0, 0]
    inside = (F > 2.0) & (F < 38.0)
    assert np.abs(treated / smooth - 1.0)[inside].max() < 0.002


def test_only_the_given_paths_are_treated() -> None:
    one = np.ones(F.size, dtype=complex)
    treated = condition(_response(one, one), Zeroed(), paths=[("y1", "u")])
    np.testing.assert_array_equal(np.abs(treated.H).any(axis=2), [[True], [False]])


def test_control_points_outside_the_response_are_rejected() -> None:
    with pytest.raises(ParameterError, match="control points"):
        condition(_response(np.ones(F.size, dtype=complex)), HighResidual(20.0, 50.0))
