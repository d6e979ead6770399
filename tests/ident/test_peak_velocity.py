"""A peak-velocity table becomes a curve that passes through its points and does not oscillate between them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from eightpost.errors import DataError, InputError
from eightpost.ident import fit_peak_velocity
from eightpost.ident.shock.curve import curve_forces, curve_through
from eightpost.ident.shock.peak_velocity import fit_tables
from eightpost.rig import PeakVelocityTable
from eightpost.shock import read_shock, write_shock
from eightpost.virtual.shocks import demo_damper

SPEED = np.array([0.0254, 0.0508, 0.1016, 0.127, 0.1905, 0.254])


@pytest.fixture
def table():
    return PeakVelocityTable(SPEED, 2e3 * np.tanh(SPEED / 0.08) + 500.0 * SPEED, -1500.0 * np.tanh(SPEED / 0.05))


@lru_cache
def dense_truth(build):
    """Return velocities [m/s] and static forces [N] of a virtual shock."""
    velocity = np.linspace(-1.0, 1.0, 401)
    return velocity, np.array([demo_damper(build).static_force(v) for v in velocity.tolist()])


def points_of(build, count, noise, seed, spacing):
    """Return velocities and forces of a table with some noise, as a share of the standard deviation of the force."""
    dense, truth = dense_truth(build)
    speed = np.linspace(0.0, 1.0, count + 1)[1:] ** spacing
    velocity = np.concatenate([-speed[::-1], [0.0], speed])
    force = np.interp(velocity, dense, truth)
    force += noise * np.std(truth) * np.random.default_rng(seed).standard_normal(force.size)
    return velocity, np.where(velocity == 0.0, 0.0, force)


def errors_of(build, *options):
    """Return the errors [% of the range of force] of the curve and of PCHIP through the same points, at 401 speeds."""
    dense, truth = dense_truth(build)
    velocity, force = points_of(build, *options)
    curve, _ = curve_through(velocity, force)
    size = np.ptp(truth) / 100.0
    return (curve_forces(curve, dense) - truth) / size, (PchipInterpolator(velocity, force)(dense) - truth) / size


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
@pytest.mark.parametrize("count", [2, 3, 5, 8, 12])
def test_with_up_to_12_speeds_the_error_is_that_of_pchip_through_the_same_points(count, noise):
    for build in "ABC":
        for seed, spacing in enumerate([1.0, 1.5, 2.0]):
            _, force = points_of(build, count, noise, seed, spacing)
            if (np.diff(force) > 0.0).all():  # PCHIP through points that fall has negative slopes
                ours, pchip = errors_of(build, count, noise, seed, spacing)
                np.testing.assert_allclose(ours, pchip, atol=1e-9)


@pytest.mark.repeated
@pytest.mark.parametrize("count", [13, 16, 20, 40])
def test_with_more_speeds_the_error_exceeds_pchips_by_less_than_a_thousandth_of_the_range(count):
    for build in "ABC":
        for seed, (spacing, noise) in enumerate([(1.0, 0.0), (2.0, 0.0), (1.5, 0.005)]):
            ours, pchip = (np.sqrt(np.mean(one**2)) for one in errors_of(build, count, noise, seed, spacing))
            assert ours < pchip + 0.1


def test_points_that_rise_give_a_curve_that_rises():
    for count in (4, 12, 30):
        speed = np.linspace(0.0, 1.0, count + 1)[1:]
        velocity = np.concatenate([-speed[::-1], [0.0], speed])
        steps = np.random.default_rng(count).exponential(100.0, velocity.size)
        force = np.cumsum(steps) - np.cumsum(steps)[count]
        curve, _ = curve_through(velocity, force)
        assert np.diff(curve_forces(curve, np.linspace(-1.0, 1.0, 4001))).min() >= -1e-9


def test_the_curve_meets_the_points_and_reports_the_error(table):
    shock = fit_peak_velocity(table)
    curve = shock.law.curve
    found = np.array([[curve.force(v), curve.force(-v)] for v in SPEED.tolist()])
    error = np.abs(found - np.column_stack([table.compression, table.rebound])).max()
    assert error < 1e-9
    assert shock.fit["greatest_error_at_points [N]"] == pytest.approx(error, abs=1e-9)
    assert "monotone interpolant" in shock.fit["changes"][0]


def test_it_is_a_shock_file_like_any_other(table, tmp_path):
    write_shock(fit_peak_velocity(table, name="build 3"), tmp_path / "s.json")
    assert read_shock(tmp_path / "s.json").name == "build 3"


@pytest.mark.parametrize(
    ("gas", "preload", "at_rest", "note"),
    [("estimate", 120.0, 0.0, "but of the gas preload"), ("included", 0.0, 0.0, "left out of the shock"),
     ("subtracted", 0.0, 120.0, "")],
)  # fmt: skip
def test_the_gas_force_of_a_table_is_a_preload_is_left_out_or_belongs_to_the_valves(table, gas, preload, at_rest, note):
    table = replace(table, gas_force=120.0, gas_source="the column gas")
    shock = fit_peak_velocity(table, gas=gas)
    assert shock.law.port.gas_preload == preload
    points = curve_forces(shock.law.curve, np.append(SPEED, -SPEED))
    assert points == pytest.approx(np.append(table.compression, table.rebound) + at_rest, abs=1e-6)
    notes = [text for text in shock.fit["changes"] if "gas force of 120 N, found from the column gas" in text]
    assert [note in text for text in notes] == ([True] if note else [])
    assert len(shock.fit["warnings"]) == (gas == "estimate")


def test_a_force_at_rest_against_the_gas_and_rows_that_fall_are_warnings(table):
    pulled = fit_peak_velocity(replace(table, rest_force=-800.0)).fit["warnings"]
    assert len(pulled) == 1 and "the force at zero speed is -800 N, although gas pushes" in pulled[0]
    falling = replace(table, rebound=table.rebound + np.where(np.arange(6) == 3, 900.0, 0.0))
    (found,) = fit_peak_velocity(falling).fit["warnings"]
    assert found.startswith("rebound falls towards 0.127 m/s (-581.5 N): the curve is held level there and ")


def test_each_setting_of_a_file_has_its_own_shock_file(table, tmp_path):
    tables = [replace(table, clicks=clicks) for clicks in ("C 4 / R 7", None)]
    fitted = fit_tables(tables, tmp_path / "shock.json", name="front", build="new")
    assert [one.path.name for one in fitted] == ["shock_C_4_R_7.json", "shock_setting.json"]
    first, second = (read_shock(one.path) for one in fitted)
    assert (first.name, second.name) == ("front C 4 / R 7", "front")
    assert first.conditions["build"] == "new"
    (alone,) = fit_tables(tables[:1], tmp_path / "one.json")
    assert (alone.path.name, read_shock(alone.path).name) == ("one.json", "C 4 / R 7")


def test_a_curve_is_held_level_where_the_table_falls_and_the_change_is_stated():
    """900 and 700 N become their mean, 800 N."""
    bad = PeakVelocityTable(SPEED, np.array([500.0, 900.0, 700.0, 1100.0, 1200.0, 1300.0]), -9000.0 * SPEED)
    shock = fit_peak_velocity(bad)
    assert [shock.law.curve.force(v) for v in (0.0508, 0.07, 0.1016)] == pytest.approx([800.0] * 3)
    assert shock.fit["warnings"] == [
        "compression falls towards 0.1016 m/s (700 N): the curve is held level there and differs from the "
        "table by up to 100 N, 4.4 % of the largest force; check these rows"
    ]
    assert shock.fit["greatest_error_at_points [N]"] == pytest.approx(100.0)


def test_forces_of_the_wrong_sign_are_held_at_zero():
    bad = PeakVelocityTable(SPEED, np.array([-50.0, 10.0, 300.0, 400.0, 500.0, 600.0]), -9000.0 * SPEED)
    curve = fit_peak_velocity(bad).law.curve
    assert (curve.force(SPEED[0]), curve.force(SPEED[1])) == pytest.approx((0.0, 10.0))


def test_a_table_without_any_force_is_refused():
    for forces in (0.0 * SPEED, 9e-7 + 0.0 * SPEED):
        with pytest.raises(DataError, match="all forces are 0 N"):
            fit_peak_velocity(PeakVelocityTable(SPEED, forces, 0.0 * SPEED))


@st.composite
def any_tables(draw):
    count = draw(st.integers(2, 14))
    speed = np.cumsum(draw(st.lists(st.floats(1e-3, 0.2), min_size=count, max_size=count)))
    forces = st.lists(st.floats(-3000.0, 3000.0), min_size=count, max_size=count)
    return PeakVelocityTable(speed, *(np.array(draw(forces)) for _ in range(2)))


@settings(max_examples=10, deadline=None)
@given(any_tables())
def test_any_table_gives_a_curve_that_nowhere_falls_and_is_within_the_stated_error_or_is_refused(table):
    try:
        shock = fit_peak_velocity(table)
    except InputError:
        return
    curve, stated = shock.law.curve, shock.fit["greatest_error_at_points [N]"]
    found = [curve_forces(curve, sign * table.speed) for sign in (1.0, -1.0)]
    assert np.abs(found - np.array([table.compression, table.rebound])).max() <= stated + 1e-9
    force = curve_forces(curve, np.linspace(-curve.rebound_speed, curve.compression_speed, 2001))
    assert np.diff(force).min() >= -1e-9 * np.ptp(force)


@pytest.mark.parametrize("speed", [[0.1, 0.1], [0.2, 0.1], [0.0, 0.1], [0.1, np.nan], [0.1]])
def test_an_invalid_table_is_rejected(speed):
    with pytest.raises(InputError):
        PeakVelocityTable(np.array(speed), np.ones(len(speed)), -np.ones(len(speed)))
