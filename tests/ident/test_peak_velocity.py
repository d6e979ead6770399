"""A peak-velocity table becomes a curve that passes through its points and does not oscillate between them."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.ident import fit_peak_velocity
from eightpost.rig import PeakVelocityTable
from eightpost.shock import read_shock, write_shock

SPEED = np.array([0.0254, 0.0508, 0.1016, 0.127, 0.1905, 0.254])


@pytest.fixture
def table():
    return PeakVelocityTable(SPEED, 2e3 * np.tanh(SPEED / 0.08) + 500.0 * SPEED, -1500.0 * np.tanh(SPEED / 0.05))


def test_the_curve_meets_the_points_and_reports_the_error(table):
    shock = fit_peak_velocity(table)
    curve = shock.law.curve
    found = np.array([[curve.force(v), curve.force(-v)] for v in SPEED.tolist()])
    error = np.abs(found - np.column_stack([table.compression, table.rebound])).max()
    assert error < 15.0
    assert shock.fit["greatest_error_at_points [N]"] == pytest.approx(error)
    assert "monotone interpolant" in shock.fit["changes"][0]


def test_the_curve_does_not_oscillate_between_the_points(table):
    curve = fit_peak_velocity(table).law.curve
    force = np.array([curve.force(v) for v in np.linspace(-0.254, 0.254, 500).tolist()])
    assert np.diff(force).min() > -1e-3 * np.ptp(force)


def test_it_is_a_shock_file_like_any_other(table, tmp_path):
    write_shock(fit_peak_velocity(table, name="build 3"), tmp_path / "s.json")
    assert read_shock(tmp_path / "s.json").name == "build 3"


def test_a_row_that_falls_is_reported():
    bad = PeakVelocityTable(SPEED, np.array([500.0, 900.0, 700.0, 1100.0, 1200.0, 1300.0]), -9000.0 * SPEED)
    assert any("0.1016" in warning for warning in fit_peak_velocity(bad).fit["warnings"])


@pytest.mark.parametrize("speed", [[0.1, 0.1], [0.2, 0.1], [0.0, 0.1], [0.1, np.nan], [0.1]])
def test_an_invalid_table_is_rejected(speed):
    with pytest.raises(InputError):
        PeakVelocityTable(np.array(speed), np.ones(len(speed)), -np.ones(len(speed)))
