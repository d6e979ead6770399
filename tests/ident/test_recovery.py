"""Fits recover known shocks from their records."""

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


def test_lpf1_inside_the_class(knots, law_record):
    fit = fit_shock(law_record(Lpf1(knots, 1.3e-3), 1), "lpf1")
    assert curve_error(fit.shock.law.curve, knots) < 0.5
    assert fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)
    assert fit.percent < 0.2
    assert not fit.warnings


def test_lpf1_of_a_smooth_curve_is_found(smooth_fit, curve, law_record):
    found = smooth_fit.shock.law.curve
    assert smooth_fit.converged
    assert curve_error(found, curve) < 1.5
    assert smooth_fit.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)
    assert smooth_fit.percent < 1.0
    assert not smooth_fit.warnings
    inside = law_record(Lpf1(curve, 1.3e-3), 1).series.window(0.88, 10.12)["velocity"]
    assert (found.rebound_speed, found.compression_speed) == pytest.approx((-inside.min(), inside.max()), abs=3e-3)
    assert min(found.rebound_slope, found.compression_slope) >= 0.0


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
