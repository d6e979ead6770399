"""Unknown options are rejected by name; doubtful results are reported."""

from __future__ import annotations

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident import fit_shock
from eightpost.ident.shock.curve import _curve_coefficients, fitted_curve
from eightpost.ident.shock.result import interval_of, parameter_table
from eightpost.ident.shock.verdict import Parameter
from eightpost.shock import Lpf1


@pytest.fixture(scope="module")
def laggard(curve, law_record):
    """Return a record of a shock whose lag of 15 ms is beyond the dissertation's bounds."""
    return law_record(Lpf1(curve, 1.5e-2), 1)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"law": "lpf2"}, "unknown law 'lpf2'; it must be one of polylinear, lpf1"),
        ({"recipe": "fast"}, "unknown recipe 'fast'; it must be one of joint, boggs"),
        ({"gas": "none"}, "unknown gas treatment 'none'; it must be one of estimate, included, subtracted"),
    ],
)
def test_an_unknown_choice_is_refused(laggard, choice, message):
    with pytest.raises(ParameterError, match=message):
        fit_shock(laggard, **{"law": "lpf1", **choice})


def test_a_parameter_at_its_bound_is_reported(laggard):
    fit = fit_shock(laggard, "lpf1")
    assert fit.parameter("time_constant").at_bound == "upper"
    assert any("time_constant = 1" in warning and "at its upper bound" in warning for warning in fit.warnings)
    stated = fit.shock.fit["parameters"]["time_constant"]
    assert (stated["at_bound"], stated["interval_95"]) == ("upper", None)
    assert interval_of(fit.parameter("gas_preload")) == fit.parameter("gas_preload").interval
    assert np.isnan(fit.to_pandas().loc["time_constant", "low"])
    columns = [list(column.cells) for column in parameter_table(fit).columns]
    assert columns[2][columns[0].index("time_constant")] == "-"


@pytest.mark.parametrize(
    ("value", "bounds", "error", "bound"),
    [
        (197.0, (11.0, 199.5), 2e4, ""),
        (198.0, (11.0, 199.5), 2e4, "upper"),
        (11.1, (11.0, 199.5), None, "lower"),
        (11.2, (11.0, 199.5), None, ""),
        (0.9, (0.0, np.inf), 100.0, "lower"),
        (1.1, (0.0, np.inf), 100.0, ""),
        (0.0, (0.0, np.inf), None, "lower"),
    ],
)
def test_a_parameter_is_at_a_bound_within_1_percent_of_it_or_of_its_error_at_0(value, bounds, error, bound):
    assert Parameter("x", value, "N", error, bounds).at_bound == bound


@pytest.mark.nightly
def test_lpnl2_on_a_shock_without_fading_is_lpf1(curve, law_record):
    record = law_record(Lpf1(curve, 1.3e-3), 1)
    lpf1, lpnl2 = fit_shock(record, "lpf1"), fit_shock(record, "lpnl2")
    assert lpnl2.rms <= lpf1.rms * (1.0 + 1e-9)
    assert lpnl2.parameter("time_constant").value == pytest.approx(1.3e-3, rel=0.02)


def test_a_falling_curve_is_reported_with_its_velocities(basis, curve):
    coefficients = _curve_coefficients(curve)
    coefficients[15] -= 300.0
    _, warnings = fitted_curve(basis, coefficients, np.linspace(-0.8, 0.8, 500))
    assert any("not monotone" in warning and "0.372 to 0.388 m/s" in warning for warning in warnings)


def test_an_implausible_end_slope_is_replaced_by_a_robust_one(basis, curve):
    coefficients = _curve_coefficients(curve)
    coefficients[15:19] = coefficients[15], 900.0, 0.0, -500.0  # falls at the end
    found, warnings = fitted_curve(basis, coefficients, np.linspace(-0.8, 0.8, 500))
    assert found.compression_slope >= 0.0
    assert any("slope at 0.8 m/s, the end of the range" in warning for warning in warnings)
