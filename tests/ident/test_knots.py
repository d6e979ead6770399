"""A curve through knots rises everywhere, is linear in its slopes, and fits where polynomials do not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import (
    _COEFFICIENTS,
    CurveBasis,
    KnotBasis,
    curve_forces,
    split_coefficients,
    working_basis,
)
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1, StaticCurve

slopes_13 = arrays(np.float64, 13, elements=st.floats(0.0, 1e5, allow_subnormal=False))
RANGE = np.array([-0.8, 1.1])


@given(slopes_13, arrays(np.float64, 20, elements=st.floats(-2.0, 2.0)))
def test_the_matrix_times_the_slopes_is_the_curve_of_the_shock_file(slopes, velocity):
    basis = KnotBasis.of(RANGE)
    curve, size = basis.static_curve(slopes), 1e-12 * (1.0 + slopes.max())
    expected = [curve.force(v) for v in velocity.tolist()]
    np.testing.assert_allclose(curve_forces(curve, velocity), expected, rtol=1e-11, atol=size)
    inside = np.clip(velocity, *RANGE)
    np.testing.assert_allclose(basis.design(inside) @ slopes, curve_forces(curve, inside), rtol=1e-11, atol=size)


@given(slopes_13)
def test_the_force_rises_wherever_no_slope_is_negative(slopes):
    force = KnotBasis.of(RANGE).design(np.linspace(-1.5, 1.5, 501)) @ slopes
    assert np.diff(force).min() >= -1e-12 * (1.0 + np.ptp(force))


@pytest.mark.parametrize("cells", [1, 3, 6, 7, 12])
def test_any_number_of_cells_becomes_the_25_knots_of_a_shock_without_a_change_of_the_curve(cells):
    basis = KnotBasis.of(RANGE, cells=cells)
    slopes = np.random.default_rng(cells).uniform(0.0, 5000.0, basis.count)
    velocity, force, slope = basis.subdivided(slopes)
    assert velocity.size == force.size == slope.size == 25
    assert set(basis.knots) <= set(velocity.tolist())
    np.testing.assert_allclose(force, basis.design(velocity) @ slopes, atol=1e-9)


@pytest.fixture(scope="module")
def knee(law_record, rising):
    """A record of a valve that opens abruptly at 0.05 m/s, behind a lag; a polynomial of order 15 cannot follow it."""
    basis = KnotBasis((-1.2, -0.3, -0.06, -0.05, 0.0, 0.05, 0.06, 0.3, 1.2))
    slopes = np.array([900.0, 1000.0, 1100.0, 18000.0, 20000.0, 18000.0, 1200.0, 900.0, 800.0])
    return law_record(Lpf1(basis.static_curve(slopes), 1.5e-3), 1)


@pytest.fixture(scope="module")
def knee_fit(knee):
    return fit_shock(knee, "lpf1")


@pytest.fixture(scope="module")
def static_fit(digressive_record):
    return fit_shock(digressive_record(1), "polylinear")


def test_an_abrupt_knee_is_fitted_better_than_with_polynomials(knee, knee_fit):
    assert knee_fit.percent < 0.8 * fit_shock(knee, "lpf1", recipe="boggs").percent


def test_speeds_without_data_are_bridged_and_not_invented(digressive_record, static_fit):
    test = digressive_record(1)
    speed = np.abs(test.series["velocity"])
    gap = (speed > 0.25) & (speed < 0.5)
    assert gap.any()
    holed = DynoTest(test.series.at(np.flatnonzero(~gap)))
    found = fit_shock(holed, "polylinear").shock.law.curve
    velocity = np.linspace(-0.5, 0.5, 101)
    both = [curve_forces(curve, velocity) for curve in (found, static_fit.shock.law.curve)]
    assert np.abs(both[0] - both[1]).max() < 0.1 * np.abs(both[1]).max()


def test_the_end_slope_of_a_slow_run_is_not_that_of_its_few_fastest_samples(static_fit):
    curve = static_fit.shock.law.curve
    velocity, force = np.array(curve.knot_velocity), np.array(curve.knot_force)
    chords = np.diff(force)[[0, -1]] / np.diff(velocity)[[0, -1]]
    np.testing.assert_allclose([curve.rebound_slope, curve.compression_slope], chords, rtol=0.5)


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.integers(2, 12))
def test_a_bend_that_continues_through_the_last_two_cells_costs_nothing_and_a_straight_last_cell_does(low, high, cells):
    basis = KnotBasis.of(RANGE, cells=cells)
    knots = np.array(basis.knots)
    inner = np.sqrt(np.abs(knots[2:-2]))  # any slopes; the two knots at each end are on a line with the third
    slopes = np.concatenate(
        [inner[0] + low * (knots[:2] - knots[2]), inner, inner[-1] + high * (knots[-2:] - knots[-3])]
    )
    size = basis.speed * (1.0 + np.abs(slopes).max())
    end_rows = basis.penalty()[-2:]
    np.testing.assert_allclose(end_rows @ slopes, 0.0, atol=1e-12 * size)
    straight = slopes.copy()
    straight[[0, -1]] = straight[[1, -2]]
    expected = -3e-2 * basis.speed * np.array([low, high]) * np.diff(knots)[[0, -1]]
    np.testing.assert_allclose(end_rows @ straight, expected, atol=1e-12 * size)


def test_the_band_covers_the_curve_of_another_draw(digressive_record):
    one, other = (fit_shock(digressive_record(seed), "lpf1") for seed in (1, 2))
    inner = np.abs(one.band.velocity) < 0.5
    apart = np.abs(one.band.force - curve_forces(other.shock.law.curve, one.band.velocity))
    both = np.hypot(one.band.half_width, np.interp(one.band.velocity, other.band.velocity, other.band.half_width))
    assert (one.band.half_width > 0.0).all()
    assert np.mean((apart <= both)[inner]) > 0.8


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
    inner, compression, rebound = split_coefficients(np.concatenate([curve.inner, curve.compression, curve.rebound]))
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
