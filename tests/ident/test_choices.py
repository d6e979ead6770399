"""Unknown options are rejected by name; doubtful results are reported."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eightpost.errors import InputError, ParameterError
from eightpost.ident import fit_shock
from eightpost.ident.shock.dynamics import NoLag
from eightpost.ident.shock.force import limits_for
from eightpost.ident.shock.result import interval_of, parameter_table
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1, Port, StaticCurve
from eightpost.signals import TimeSeries


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


few = settings(max_examples=3, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)


@pytest.fixture(scope="module")
def record(curve, law_record):
    return law_record(Lpf1(curve, 1.3e-3), 1)


@few
@given(start=st.floats(10.6, 50.0), length=st.floats(0.5, 20.0))
def test_a_segment_outside_the_record_is_refused(record, start, length):
    with pytest.raises(InputError, match="must lie within the record"):
        fit_shock(record, "lpf1", segment=(start, start + length))


def slow_test() -> DynoTest:
    """Return a record at 1 Hz, as of a file with ms labelled s."""
    t = np.arange(1500.0)
    x, v = 0.02 * np.sin(0.02 * t), 4e-4 * np.cos(0.02 * t)
    channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", 100.0 + 1e6 * v)}
    return DynoTest(TimeSeries.from_channels(t, channels))


@pytest.mark.parametrize(
    ("law", "recipe"), [("lpf1", "joint"), ("lpnl2", "joint"), ("lpf1", "boggs"), ("lpnl2", "boggs")]
)
def test_a_record_that_is_too_slow_for_a_lag_is_refused_with_advice(law, recipe):
    with pytest.raises(ParameterError, match=r"sampled at 1 Hz.*If time is in ms but labelled s"):
        fit_shock(slow_test(), law, recipe=recipe, segment=(20.0, 1400.0))


class WithoutLag(NoLag):
    """Dynamics that give the law a time constant of zero."""

    def values(self, theta):
        return np.array([0.0])


def test_parameters_that_their_law_refuses_end_in_advice():
    outer = (100.0, 50.0, 0.0, 0.0), (-100.0, -50.0, 0.0, 0.0)
    curve = StaticCurve((100.0, *[0.0] * 14), *outer, 0.1, 0.01, 0.5, 0.5, 100.0, 100.0)
    dynamics = WithoutLag(limits_for(np.array([-100.0, 100.0]), 1000.0), Lpf1)
    with pytest.raises(ParameterError, match=r"is not valid: time_constant must be positive.*--set segment"):
        dynamics.law(curve, Port(), np.empty(0))
