"""The design matrix is the scalar curve, and its working basis is well conditioned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eightpost.ident.shock.curve import (
    _COEFFICIENTS,
    CurveBasis,
    _curve_coefficients,
    curve_forces,
    split_coefficients,
    working_basis,
)
from eightpost.shock import StaticCurve

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
coefficients_23 = arrays(np.float64, _COEFFICIENTS, elements=numbers)
speeds = st.floats(0.02, 1.0)


def built(coefficients, speed, reach):
    inner, compression, rebound = split_coefficients(coefficients)
    return StaticCurve(inner, compression, rebound, speed, speed / 30.0, reach, reach, 500.0, 700.0)


@given(coefficients_23, speeds, arrays(np.float64, 20, elements=st.floats(-2.5, 2.5)))
def test_the_matrix_times_the_coefficients_is_the_scalar_curve(coefficients, speed, shares):
    curve, velocity = built(coefficients, speed, 2.5 * speed), shares * speed
    matrix = CurveBasis(speed, speed / 30.0).design(velocity)
    assert matrix.shape == (20, 23)
    expected = [curve.force(v) for v in velocity.tolist()]
    size = np.abs(matrix) @ np.abs(coefficients) + 1.0
    assert np.max(np.abs(matrix @ coefficients - expected) / size) < 1e-12


@given(coefficients_23, speeds, arrays(np.float64, 20, elements=st.floats(-6.0, 6.0)))
def test_the_curve_for_arrays_is_the_scalar_curve_beyond_the_fitted_range_too(coefficients, speed, shares):
    curve, velocity = built(coefficients, speed, 2.0 * speed), shares * speed
    expected = np.array([curve.force(v) for v in velocity.tolist()])
    np.testing.assert_allclose(curve_forces(curve, velocity), expected, rtol=1e-11, atol=1e-11)


def test_coefficients_come_back(curve):
    inner, compression, rebound = split_coefficients(_curve_coefficients(curve))
    assert (inner, compression, rebound) == (curve.inner, curve.compression, curve.rebound)


@pytest.mark.parametrize(
    ("straight", "free"), [((), 23), (("compression",), 19), (("rebound",), 19), (("compression", "rebound"), 15)]
)
def test_a_side_without_data_continues_the_inner_polynomial_straight(basis, straight, free):
    ties = basis.ties(straight)
    assert ties.shape == (23, free)
    curve = built(ties @ np.random.default_rng(1).normal(size=free), basis.transition_speed, 1.0)
    for side, sign in (("compression", 1.0), ("rebound", -1.0)):
        cubic = getattr(curve, side)
        inner = np.polyval((*curve.inner[::-1], 0.0), sign)
        assert (abs(cubic[0] - inner) < 1e-12) == (cubic[2:] == (0.0, 0.0)) == (side in straight)


def test_the_working_basis_is_orthogonal_where_raw_powers_are_hopeless(basis):
    velocity = 0.25 * np.random.default_rng(0).standard_normal(18000)
    raw = basis.design(velocity)
    in_metres = raw[:, :15] * basis.transition_speed ** np.arange(1, 16)
    working = working_basis(basis, velocity, np.eye(23))
    # Powers of m/s: beyond double precision's reach for normal equations. Scaled: 1e5. Working basis: 1.
    assert np.linalg.cond(in_metres) > 1e8
    assert np.linalg.cond(raw / np.linalg.norm(raw, axis=0)) > 1e4
    assert np.linalg.cond(working.columns) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(working.columns, raw @ working.to_curve)


def test_a_direction_without_data_is_left_out(basis):
    slow = np.linspace(-0.2, 0.2, 2000)
    working = working_basis(basis, slow, np.eye(23))
    assert working.columns.shape[1] <= 15
    assert np.isfinite(working.to_curve).all()
