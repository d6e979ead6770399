"""Known properties of a record are recovered by its validation."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import MissingChannelError, ParameterError, TooShortError
from eightpost.ident.validation.records import dyno_record
from eightpost.ident.validation.shock_tests import (
    Loop,
    evaluate,
    residual_of,
    validate_bump,
    validate_random,
    validate_sine,
    validate_static,
)
from eightpost.rig.dyno_test import DynoTest

from .conftest import INCH, bump_path, dragged, record, shock_of, sine_path, static_path


def test_the_true_law_leaves_the_noise(lagged, random_test):
    found = validate_random(lagged, dyno_record(random_test(1)))
    # Noise: 1 N, and 0.5 mm/s times up to 7 kN.s/m of damping; the 50 Hz low-pass of 1 kHz leaves 5 % of their power.
    assert found.rms < 0.6
    assert found.percent < 0.1
    assert found.prediction.offset == pytest.approx(0.0, abs=0.05)


def test_a_residual_is_coherent_with_the_velocity_where_a_lag_is_left_out(lagged, static_curve, random_test):
    test = dyno_record(random_test(1))
    without, with_lag = validate_random(static_curve, test).residual, validate_random(lagged, test).residual
    excited = (without.frequency >= 5.0) & (without.frequency <= 25.0)
    assert without.coherence[excited].min() > 0.7
    assert without.share > 0.6
    assert np.median(with_lag.coherence[excited]) < with_lag.threshold
    assert with_lag.share < 0.15


def test_the_threshold_is_passed_by_one_frequency_in_twenty_of_unrelated_signals(lagged, random_test):
    found = evaluate(lagged, random_test(1))
    passed = []
    for seed in range(12):
        noise = np.random.default_rng(seed).standard_normal(len(found.measured))
        force = found.measured["force"] + noise
        unrelated = replace(found, predicted=found.predicted.with_channel("force", "N", force))
        residual = residual_of(unrelated)
        passed.append(residual.coherence > residual.threshold)
    assert 0.02 < np.mean(passed) < 0.09


def test_a_loop_of_a_lagging_linear_damper_has_its_known_area_and_width():
    """F = C v behind tau: amplitude C A w / sqrt(1 + (w tau)^2), lagging by atan(w tau)."""
    damping, amplitude, omega, tau = 3000.0, 0.01, 40.0, 2e-3
    phase = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    gain, lag = damping * amplitude * omega / np.hypot(1.0, omega * tau), np.arctan(omega * tau)
    loop = Loop(amplitude * np.sin(phase), amplitude * omega * np.cos(phase), gain * np.cos(phase - lag))
    assert loop.energy == pytest.approx(np.pi * amplitude * gain * np.cos(lag), rel=1e-4)
    assert loop.hysteresis == pytest.approx(2.0 * gain * np.sin(lag), rel=1e-3)
    assert loop.compression_peak == pytest.approx(gain, rel=1e-5)


@pytest.mark.parametrize(("rate", "drag"), [(700.0, 20.0), (0.0, 0.0), (1500.0, 60.0)])
def test_a_known_drag_and_rate_come_out_of_a_static_test(truth, rate, drag):
    path = static_path()
    extra = dragged(path, drag) + (rate - 700.0) * (path - path[0])
    found = validate_static(shock_of(truth), dyno_record(record(truth, path, 100.0, extra=extra), kind="static"))
    assert len(found.holds) == 7
    assert [hold.direction for hold in found.holds] == ["start", *3 * ["compression"], *3 * ["rebound"]]
    for measured in (found.gas_rate, found.compression_rate, found.rebound_rate):
        assert measured == pytest.approx(rate, abs=5.0)
    assert found.seal_drag == pytest.approx(drag, abs=0.3)
    assert found.predicted_rate == pytest.approx(700.0, abs=5.0)


def test_the_error_at_rest_is_the_drag_that_a_law_has_no_memory_of(lagged, static_test):
    found = validate_static(lagged, dyno_record(static_test))
    assert found.rms == pytest.approx(20.0 * np.sqrt(6.0 / 7.0), abs=0.3)


def test_short_holds_are_averaged_over_their_second_half(truth, lagged):
    path = static_path(hold=6.0)
    found = validate_static(lagged, dyno_record(record(truth, path, 100.0, extra=dragged(path, 20.0)), kind="static"))
    assert found.seal_drag == pytest.approx(20.0, abs=0.3)
    assert found.settling == pytest.approx(3.0, abs=0.3)


def test_a_static_test_needs_holds_and_displacement(lagged, random_test, static_test):
    with pytest.raises(ParameterError, match="holds"):
        validate_static(lagged, dyno_record(random_test(1), kind="static"))
    with pytest.raises(MissingChannelError):
        validate_static(lagged, dyno_record(DynoTest(static_test.series.select(("velocity", "force"))), kind="static"))


def test_the_true_law_meets_the_peaks_of_a_bump(lagged, bump_test):
    found = validate_bump(lagged, dyno_record(bump_test))
    up, down = found.events
    assert (up.speed > 0.0, down.speed < 0.0) == (True, True)
    assert abs(up.speed) == pytest.approx(30.0 * INCH, rel=0.15)
    assert all(abs(event.peak_error) < 0.5 for event in found.events)
    assert found.percent < 0.7


def test_the_low_pass_of_the_random_test_would_round_off_a_bump(lagged, bump_test):
    """A curve of a low-passed velocity is not the low-passed force, so bumps need a higher cutoff frequency."""
    narrow = validate_bump(lagged, dyno_record(bump_test), cutoff=50.0)
    assert narrow.percent > 3.0
    assert max(abs(event.peak_error) for event in narrow.events) > 1.0


def test_a_law_that_is_a_tenth_too_stiff_is_a_tenth_over_at_the_peak(truth, bump_test):
    stiff = replace(truth, port=replace(truth.port, compression_scale=1.1))
    up, down = validate_bump(shock_of(stiff), dyno_record(bump_test)).events
    static = truth.port.gas_preload
    assert up.predicted_peak - static == pytest.approx(1.1 * (up.measured_peak - static), rel=0.02)
    assert down.peak_error == pytest.approx(0.0, abs=1.5)


def test_every_bump_of_a_record_is_judged(truth, lagged):
    path = np.concatenate([bump_path(), bump_path()])
    found = validate_bump(lagged, dyno_record(record(truth, path, 2000.0)))
    assert [event.start for event in found.events] == pytest.approx([0.97, 1.97, 3.97, 4.97], abs=0.01)
    assert [event.speed > 0.0 for event in found.events] == [True, False, True, False]
    assert all(abs(event.peak_error) < 0.5 for event in found.events)


def test_only_the_bumps_within_a_segment_are_judged(truth, lagged):
    twice = dyno_record(record(truth, np.concatenate([bump_path(), bump_path()]), 2000.0))
    found = validate_bump(lagged, twice, segment=(1.5, 4.9))
    assert [event.start for event in found.events] == pytest.approx([1.97, 3.97], abs=0.01)
    with pytest.raises(ParameterError, match=r"no motion .* from 0 to 0\.9 s; give another --set segment"):
        validate_bump(lagged, twice, segment=(0.0, 0.9))


def test_only_the_holds_within_a_segment_are_judged(lagged, static_test):
    series = static_test.series
    later = DynoTest(replace(series, time=series.time + 100.0))
    for test in (static_test, later):
        found = validate_static(lagged, dyno_record(test, kind="static"), segment=(22.0, 95.0))
        assert [hold.direction for hold in found.holds] == ["start", "compression", "compression"]
    with pytest.raises(ParameterError, match=r"holds .* from 0 to 20 s; .*; give another --set segment"):
        validate_static(lagged, dyno_record(static_test, kind="static"), segment=(0.0, 20.0))


def test_periods_next_to_a_rest_are_judged_only_where_the_low_pass_does_not_ring(truth, lagged):
    """It rings for 6 / 50 Hz = 0.12 s; after both ends and the first period, two of four periods are left."""
    path = np.pad(sine_path(0.5, 5.0), 2000, mode="edge")
    found = validate_sine(lagged, dyno_record(record(truth, path, 2000.0)))
    time, period = found.prediction.measured.time, 0.2 * np.pi
    assert time[-1] - time[0] == pytest.approx(2.0 * period, abs=0.001)
    assert time[-1] == pytest.approx(1.0 + 4.0 * period - 0.12, abs=0.02)


def test_only_the_periods_within_a_segment_are_judged(truth, lagged):
    path = sine_path(0.5, 5.0, periods=8)
    extra = np.where(np.arange(path.size) < 2.5 * 2000, 100.0, 0.0)
    sine = dyno_record(record(truth, path, 2000.0, extra=extra))
    assert validate_sine(lagged, sine).rms > 30.0
    found = validate_sine(lagged, sine, segment=(2.7, 4.0))
    time = found.prediction.measured.time
    assert found.rms < 1.0
    assert (time[0], time[-1]) == pytest.approx((4.0 - 0.4 * np.pi, 4.0), abs=0.001)
    with pytest.raises(TooShortError, match=r"moves for 0\.5 s between 1 and 1\.5 s, less than one period"):
        validate_sine(lagged, sine, segment=(1.0, 1.5))


def test_a_motion_ratio_of_the_car_is_not_applied_to_the_dynamometer(truth, lagged, random_test):
    geared = shock_of(replace(truth, port=replace(truth.port, motion_ratio=0.7)))
    assert evaluate(geared, random_test(1)).rms == evaluate(lagged, random_test(1)).rms


def test_a_sine_validation_of_something_else_is_refused(lagged, random_test):
    with pytest.raises(ParameterError, match="no single frequency"):
        validate_sine(lagged, dyno_record(random_test(1), kind="sine"))
