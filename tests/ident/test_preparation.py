"""The preparation follows the record, and every departure from the dissertation's choices is reported."""

import numpy as np
import pytest

from eightpost.errors import ParameterError, TooShortError
from eightpost.ident import fit_shock
from eightpost.ident.shock import fit as fits
from eightpost.ident.shock.force import limits_for
from eightpost.ident.shock.runs import prepare, single_frequency
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1
from eightpost.signals import TimeSeries


def reported(changes, *words):
    return any(all(word in change for word in words) for change in changes)


@pytest.fixture(scope="module")
def record(curve, law_record):
    return law_record(Lpf1(curve, 1.3e-3), 1)


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
