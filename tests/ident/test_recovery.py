"""Fits recover known shocks from their records."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.ident import evaluate, fit_shock
from eightpost.ident.shock.curve import curve_forces
from eightpost.shock import Lpf1, Lpnl2


def curve_error(found, truth):
    """Return the RMS error of the curve over its fitted range, in percent of the true curve's RMS."""
    velocity = np.linspace(-found.rebound_speed, found.compression_speed, 500)
    true = curve_forces(truth, velocity)
    return 100.0 * np.sqrt(np.mean((curve_forces(found, velocity) - true) ** 2) / np.mean(true**2))


@pytest.fixture(scope="module")
def knots(curve, law_record):
    """A curve through the knots that a fit uses, so that a law with it is inside the class of the fit."""
    return fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1").shock.law.curve


def test_lpf1_inside_the_class(knots, law_record):
    fit = fit_shock(law_record(Lpf1(knots, 1.3e-3), 1), "lpf1")
    assert curve_error(fit.shock.law.curve, knots) < 0.5
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)
    assert fit.percent < 0.2
    assert not fit.warnings


def test_lpf1_of_a_smooth_curve_is_found(curve, law_record):
    fit = fit_shock(law_record(Lpf1(curve, 1.3e-3), 1), "lpf1")
    assert fit.converged
    assert curve_error(fit.shock.law.curve, curve) < 1.5
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)
    assert fit.percent < 1.0
    assert not fit.warnings


@pytest.mark.nightly
def test_lpnl2_of_a_smooth_curve_is_found(curve, law_record):
    fit = fit_shock(law_record(Lpnl2(curve, 1.3e-3, 400.0, 1600.0), 2), "lpnl2")
    assert curve_error(fit.shock.law.curve, curve) < 1.5
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)
    assert fit.parameter("lag_full_force").value == pytest.approx(400.0, abs=40.0)
    assert fit.parameter("lag_zero_force").value == pytest.approx(1600.0, rel=0.03)
    assert fit.percent < 1.0


def test_the_held_out_error_is_under_one_percent(digressive_record):
    fit = fit_shock(digressive_record(4), "lpf1")
    held_out = evaluate(fit.shock, digressive_record(5))
    assert held_out.percent < 1.0
    assert held_out.beyond < 0.01
    assert fit.parameter("time_constant").value == pytest.approx(1.7e-3, rel=0.03)


def test_evaluating_on_the_fitted_record_gives_the_fit_error(curve, law_record):
    test = law_record(Lpf1(curve, 1.3e-3), 1)
    fit = fit_shock(test, "lpf1", gas="included")
    assert evaluate(fit.shock, test).rms == pytest.approx(fit.rms, rel=1e-9)


def test_the_end_slopes_are_positive_and_the_range_is_the_measured_one(curve, law_record):
    test = law_record(Lpf1(curve, 1.3e-3), 1)
    found = fit_shock(test, "lpf1").shock.law.curve
    assert found.compression_slope >= 0.0
    assert found.rebound_slope >= 0.0
    inside = test.series.window(0.88, 10.12)["velocity"]
    assert found.compression_speed == pytest.approx(inside.max(), abs=3e-3)
    assert found.rebound_speed == pytest.approx(-inside.min(), abs=3e-3)
    assert found.force(0.0) == 0.0
