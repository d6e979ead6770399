"""Unknown options are rejected by name; doubtful results are reported."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eightpost.errors import InputError, ParameterError, TooShortError
from eightpost.ident import fit_shock
from eightpost.ident.shock import fit as fits
from eightpost.ident.shock.dynamics import NoLag
from eightpost.ident.shock.force import limits_for
from eightpost.ident.shock.result import interval_of, parameter_table
from eightpost.ident.shock.runs import prepare, single_frequency
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


def reported(changes, *words):
    return any(all(word in change for word in words) for change in changes)


def test_the_dissertations_record_is_used_unchanged(record):
    prepared = prepare(record)
    assert prepared.changes == ()
    assert prepared.cutoff == 50.0
    inside = prepared.record.time[prepared.inside]
    assert (inside[0], inside[-1]) == pytest.approx((1.0, 10.0), abs=1e-6)


def test_a_100_hz_record_lowers_the_cutoff(curve, law_record):
    fit = fit_shock(law_record(Lpf1(curve, 1.5e-2), 1, rate=100.0), "lpf1")
    assert reported(fit.changes, "cutoff", "50", "40")
    assert reported(fit.changes, "longest tau 50 ms")
    assert reported(fit.changes, "shortest tau 1 ms")
    assert fit.parameter("time_constant").value == pytest.approx(1.5e-2, rel=0.1)


def test_a_side_without_data_beyond_the_transition_continues_straight_at_no_cost(record, monkeypatch):
    with_cubics = fit_shock(record, "polylinear", recipe="boggs").percent
    monkeypatch.setattr(fits, "TRANSITION_SPEED", 1.5)
    monkeypatch.setattr(fits, "_SLOW", 0.0)
    fit = fit_shock(record, "polylinear", recipe="boggs")
    assert reported(fit.changes, "straight line", "compression: 0 samples")
    assert reported(fit.changes, "straight line", "rebound")
    assert fit.shock.law.curve.compression[2:] == (0.0, 0.0)
    assert fit.percent < 1.01 * with_cubics


@pytest.mark.nightly
def test_seconds_count_from_the_start_of_the_record(record):
    late = TimeSeries(record.series.time + 700.0, record.series.values, record.series.names, record.series.units)
    early, shifted = fit_shock(record, "lpf1"), fit_shock(DynoTest(late), "lpf1")
    assert shifted.rms == pytest.approx(early.rms, rel=1e-6)


def test_an_uneven_record_is_resampled(record):
    series = record.series.window(0.0, 3.0)
    time = series.time + 1e-2 * np.sin(3.0 * series.time)
    assert reported(prepare(DynoTest(TimeSeries(time, series.values, series.names, series.units))).changes, "resampled")


def test_a_spike_of_the_force_is_replaced_and_counted_and_nothing_else_is(record):
    series = record.series.window(0.0, 4.0)
    clean = DynoTest(series)
    predicted = prepare(clean).record["force"]
    assert fits.without_spikes(clean, prepare(clean), predicted) == (clean, 0)
    force = series["force"].copy()
    force[4000] += 2.0 * float(np.std(force))
    spiked = DynoTest(series.with_channel("force", "N", force))
    found, count = fits.without_spikes(spiked, prepare(spiked), predicted)
    assert count == 1
    assert np.abs(found.series["force"] - series["force"]).max() < 0.02 * np.std(force)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"segment": (5.0, 20.0)}, "0 to 10.5 s"),
        ({"segment": (5.0, 4.0)}, "from 5 to 4"),
        ({"cutoff": 900.0}, "0.4 of the record's 2000 Hz"),
        ({"cutoff": -1.0}, "between 0"),
    ],
)
def test_an_option_that_does_not_suit_is_refused(record, option, message):
    with pytest.raises(ParameterError, match=message):
        fit_shock(record, "lpf1", **option)


def test_too_few_samples_are_refused(record):
    with pytest.raises(TooShortError, match="samples"):
        fit_shock(record, "lpf1", segment=(3.0, 3.04))


def test_a_single_sine_is_recognised_and_its_stiffness_not_guessed(curve):
    time = np.arange(6000) / 500.0
    displacement = 0.018 * np.sin(2 * np.pi * 1.1 * time)
    velocity = 2 * np.pi * 1.1 * 0.018 * np.cos(2 * np.pi * 1.1 * time)
    force = np.array([curve.force(v) for v in velocity])
    channels = {"velocity": ("m/s", velocity), "force": ("N", force), "displacement": ("m", displacement)}
    test = DynoTest(TimeSeries.from_channels(time, channels))
    assert single_frequency(velocity, 500.0) == pytest.approx(1.1, rel=1e-4)
    assert single_frequency(velocity[:900], 500.0) == pytest.approx(1.1, rel=2e-3)  # two periods, bins of 0.56 Hz
    fit = fit_shock(test, "lpf1")
    assert reported(fit.changes, "one sine of 1.1 Hz", "cannot be distinguished")
    assert fit.shock.law.port.gas_stiffness == 0.0


def test_limits_are_the_dissertation_ones_for_its_record():
    force = np.array([-500.0, 500.0]) * 4.4482216
    limits = limits_for(force, 2000.0)
    assert limits.time_constant == (1e-4, 1e-2)
    assert limits.force == pytest.approx((44.48, 4448.2), rel=1e-4)
    assert limits.lag_changes == ()
