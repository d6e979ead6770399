"""The lag of whole records agrees with the scalar law's, and its sensitivity is its derivative by tau."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eightpost.ident.shock.simulation import RowFilter, lag, lag_sensitivity
from eightpost.shock.law import advance
from eightpost.signals import lowpass

forces = arrays(np.float64, 40, elements=st.floats(-3000.0, 3000.0, allow_subnormal=False))


def stepped(static, time_constant, step):
    lagged = [static[0]]
    for start, end in pairwise(static):
        lagged.append(advance(lagged[-1], start, end, time_constant, step))
    return np.array(lagged)


@given(forces, st.floats(1e-4, 5e-2), st.floats(1e-4, 1e-2))
def test_the_filter_is_the_scalar_law_stepped(static, time_constant, step):
    expected = stepped(static.tolist(), time_constant, step)
    np.testing.assert_allclose(lag(static, time_constant, step), expected, rtol=1e-12, atol=1e-12 * 3000.0)


def test_each_column_is_lagged_independently():
    columns = np.random.default_rng(0).normal(size=(300, 4))
    together = lag(columns, 1.3e-3, 5e-4)
    for column, lagged in zip(columns.T, together.T, strict=True):
        np.testing.assert_allclose(lagged, lag(column, 1.3e-3, 5e-4), rtol=1e-14)


@pytest.mark.parametrize("time_constant", [1e-4, 1.3e-3, 2e-2])
def test_the_sensitivity_is_the_central_difference(time_constant):
    static = 1000.0 * np.random.default_rng(2).normal(size=500)
    small = 1e-5 * time_constant
    expected = (lag(static, time_constant + small, 5e-4) - lag(static, time_constant - small, 5e-4)) / (2 * small)
    found = lag_sensitivity(static, lag(static, time_constant, 5e-4), time_constant, 5e-4)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(("rate", "cutoff"), [(120.0, 45.0), (300.0, 50.0), (3000.0, 50.0)])
def test_the_rows_are_those_of_the_low_pass(rate, cutoff):
    values = np.cumsum(np.random.default_rng(5).normal(size=(2, 3000)), axis=1)
    inside = np.zeros(3000, dtype=bool)
    inside[400:2500] = True
    rows = RowFilter.of(inside, rate, cutoff)
    expected = lowpass(values, rate, cutoff)[:, rows.rows]
    # Frequencies above half the rate of the rows are left out, where the low-pass leaves 1e-5 of them.
    np.testing.assert_allclose(rows(values), expected, atol=1e-5 * np.abs(values).max())
