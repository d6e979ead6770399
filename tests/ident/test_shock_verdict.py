"""The verdict of a fit follows from its errors and from the strokes of its records, within the range that it states."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.verdicts.cases import Rig, sine
from benchmarks.verdicts.dampers import Damper
from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import CrossValidation, HeldOutErrors
from eightpost.ident.shock.runs import StrokeRange, prepare_runs, strokes
from eightpost.ident.shock.verdict import error_at_low_speeds, peak_velocity_validity, shock_validity
from eightpost.rig.dyno_test import DynoTest
from eightpost.rig.faults import fault
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade

RATE = 250.0


def sines(*motions, seconds=3.0):
    """Return one record of sines (stroke [m], frequency [Hz]), one after the other, of a linear damper with gas."""
    lengths = [round(max(1, round(seconds * f)) / f * RATE) for _, f in motions]
    x = [
        0.5 * s * (1.0 - np.cos(2 * np.pi * f * np.arange(n) / RATE))
        for (s, f), n in zip(motions, lengths, strict=True)
    ]
    x = np.concatenate(x)
    v = np.gradient(x, 1.0 / RATE)
    force = 3000.0 * v + 1500.0 * x + 200.0 + 2.0 * np.random.default_rng(1).standard_normal(x.size)
    channels = {"displacement": ("m", x), "velocity": ("m/s", v), "force": ("N", force)}
    return DynoTest(TimeSeries.from_channels(np.arange(x.size) / RATE, channels))


TWO_TESTS = ((0.02, 1.0), (0.01, 3.0))
THREE_TESTS = (*TWO_TESTS, (0.015, 2.0))


@lru_cache
def judged_records(*motions):
    tests = [sines(motion) for motion in motions]
    return tests, prepare_runs(tests)


def verdict(percent=0.6, held_out=0.5, trouble="", motions=THREE_TESTS, static=20.0, low_speeds=(0.0, 0.0)):
    held = None if held_out is None else HeldOutErrors("quarters", held_out)
    found = shock_validity(
        *judged_records(*motions), percent=percent, static=static, level=14.2, low_speeds=low_speeds, held_out=held,
        trouble=trouble, conditions={},
    )  # fmt: skip
    return found.verdict


@pytest.mark.parametrize(
    ("percent", "held_out", "grade"),
    [
        (0.6, 2.5, Grade.USABLE),
        (0.6, 2.51, Grade.LIMITED),
        (2.51, 0.5, Grade.LIMITED),
        (0.6, 15.0, Grade.LIMITED),
        (0.6, 15.01, Grade.NOT_USABLE),
        (15.01, 0.5, Grade.NOT_USABLE),
        (2.4, None, Grade.USABLE),
        (2.6, None, Grade.LIMITED),
    ],
)
def test_the_grade_is_that_of_the_larger_one_of_residual_and_held_out_error(percent, held_out, grade):
    found = verdict(percent, held_out)
    assert found.grade is grade
    larger = "held-out error" if (held_out or 0.0) > percent else "residual"
    assert larger in found.reasons[0].figure


def test_a_usable_fit_says_within_which_strokes_speeds_and_frequencies():
    (reason,) = verdict().reasons
    assert reason.rule == "small error"
    assert "strokes of 10 to 20 mm, peak speeds of 0.063 to 0.094 m/s, 1 to 3 Hz" in reason.figure


@pytest.mark.parametrize("motions", [((0.05, 0.5),), ((0.02, 1.0), (0.01, 1.2))], ids=str)
def test_a_test_of_one_frequency_with_a_wide_loop_is_at_most_usable_within_limits(motions):
    found = verdict(0.1, 0.1, motions=motions, static=12.1)
    assert found.grade is Grade.LIMITED
    assert [reason.rule for reason in found.decisive] == ["one frequency"]
    assert "12.1 %, limit 12 %; level at rest known to +-14 N; strokes" in found.decisive[0].figure


def test_a_test_of_one_frequency_with_a_narrow_loop_is_usable_if_it_is_not_two_sines():
    found = verdict(0.1, 0.1, motions=((0.05, 0.5),), static=12.0)
    assert found.grade is Grade.USABLE
    assert [reason.rule for reason in found.reasons] == ["small error", "narrow loop"]
    assert verdict(2.6, 0.1, motions=((0.05, 0.5),), static=5.0).grade is Grade.LIMITED
    pair = verdict(0.1, 0.1, motions=((0.02, 1.0), (0.01, 1.2)), static=5.0)
    assert [reason.rule for reason in pair.decisive] == ["two sines"]


@pytest.mark.parametrize(("low", "is_reported"), [(0.0067, True), (0.0066, False), (None, True)])
def test_a_late_force_counts_if_it_turns_a_tenth_of_the_force_or_is_not_known_again(low, is_reported, monkeypatch):
    late = fault("late force", "late", "by 12 ms").reason("a")
    tests, runs = judged_records(*THREE_TESTS)
    tests = [replace(test, reasons=(late,)) for test in tests]
    frequency = StrokeRange.of(runs.prepared).frequency[1]
    assert frequency == pytest.approx(3.0, rel=0.02)
    lag = None if low is None else SimpleNamespace(low=low * 2.4 / frequency)
    monkeypatch.setattr("eightpost.ident.shock.verdict.force_lag", lambda _: lag)
    errors = {"percent": 0.1, "static": 5.0, "level": None, "low_speeds": (0.0, 0.0), "held_out": None}
    found = shock_validity(tests, runs, **errors, trouble="", conditions={}).verdict
    assert (late in found.reasons) is is_reported


def test_a_law_that_is_wrong_at_low_speeds_is_at_most_usable_within_limits():
    (reason,) = verdict(low_speeds=(5.01, -0.03)).decisive
    assert (reason.rule, reason.grade) == ("low speeds", Grade.LIMITED)
    assert "5 % of the force at -0.03 m/s, limit 5 %" in reason.figure
    assert verdict(low_speeds=(5.0, -0.03)).grade is Grade.USABLE


def test_the_error_at_low_speeds_is_the_largest_median_residual_of_a_stroke_over_the_force_there_without_gas():
    time = np.arange(4000) / 1000.0
    velocity = np.sin(2.0 * np.pi * time)
    gas, force = np.full(time.size, 500.0), 1000.0 * velocity
    off = np.where((velocity < -0.04) & (velocity >= -0.08), 6.0, 0.0) + np.where(velocity > 0.5, 100.0, 0.0)
    off[np.argmin(np.abs(velocity - 0.06))] = 1e4  # an outlier
    measured = TimeSeries.from_channels(time, {"velocity": ("m/s", velocity), "force": ("N", force + gas)})
    predicted = TimeSeries.from_channels(time, {"force": ("N", force + gas + off), "gas_force": ("N", gas)})
    percent, where = error_at_low_speeds(measured, predicted)
    assert percent == pytest.approx(10.0, rel=0.05)  # 6 N of an RMS of about 60 N
    assert where == pytest.approx(-0.0566, rel=0.01)


def test_a_record_with_few_samples_at_low_speeds_has_no_error_there():
    time = np.arange(150) / 100.0
    wave = np.sign(np.sin(2.0 * np.pi * time + 0.1))
    measured = TimeSeries.from_channels(time, {"velocity": ("m/s", wave), "force": ("N", wave)})
    predicted = TimeSeries.from_channels(time, {"force": ("N", 0.0 * wave), "gas_force": ("N", 0.0 * wave)})
    assert error_at_low_speeds(measured, predicted) == (0.0, 0.0)


def test_two_sines_need_a_third_run():
    assert [reason.rule for reason in verdict(motions=TWO_TESTS).decisive] == ["two sines"]
    assert verdict(motions=(*TWO_TESTS, TWO_TESTS[0])).grade is Grade.USABLE
    stepped = [sines(*TWO_TESTS)]
    assert not prepare_runs(stepped * 2).are_two_sines


def test_a_small_error_is_never_not_usable():
    assert verdict(trouble="the step is too small").grade is Grade.LIMITED
    assert [reason.rule for reason in verdict(trouble="the step is too small").decisive] == ["fit not converged"]


def test_two_sines_of_one_peak_speed_are_two_tests():
    _, runs = judged_records(*TWO_TESTS)
    speeds = [speed for speed, _ in runs.motions]
    assert max(speeds) <= 1.51 * min(speeds)
    assert [frequency for _, frequency in runs.motions] == pytest.approx([1.0, 3.0], rel=0.02)
    assert not runs.has_one_motion and not runs.has_repeated_motions


def test_a_repeated_motion_is_found_by_speed_and_frequency():
    _, repeated = judged_records((0.02, 1.0), (0.021, 1.05))
    assert repeated.has_one_motion and repeated.has_repeated_motions
    _, faster = judged_records((0.02, 1.0), (0.04, 1.0))
    assert not faster.has_one_motion and not faster.has_repeated_motions


def test_strokes_have_length_speed_and_duration_without_the_incomplete_ends():
    time = np.arange(2000) / 500.0
    length, speed, duration = strokes(0.2 * np.sin(2 * np.pi * time + 1.0), 1.0 / 500.0)
    assert length == pytest.approx(np.full(7, 0.4 / (2 * np.pi)), rel=1e-3)
    assert speed == pytest.approx(np.full(7, 0.2), rel=1e-4)
    assert duration == pytest.approx(np.full(7, 0.5), abs=0.003)


def test_a_record_of_one_stroke_and_its_return_counts_them():
    velocity = np.concatenate([np.full(100, 0.1), np.full(50, -0.2)])
    length, speed, duration = strokes(velocity, 0.01)
    assert (length.tolist(), speed.tolist()) == (pytest.approx([0.1, 0.1]), [0.1, 0.2])
    assert duration == pytest.approx([1.0, 0.5])


def test_the_only_complete_stroke_of_a_record_counts_alone():
    velocity = np.concatenate([np.full(30, -0.3), np.full(100, 0.1), np.full(50, -0.2)])
    assert strokes(velocity, 0.01).T.tolist() == [pytest.approx([0.1, 0.1, 1.0])]


@pytest.mark.parametrize(("short", "ends"), [(1, (0.02, 0.05)), (2, (0.004, 0.05))])
def test_the_range_leaves_out_a_tenth_of_the_time_at_either_end(short, ends):
    record = sines((0.06, 1.0), *[(0.004, 1.0)] * short, *[(0.05, 1.0)] * 7, *[(0.02, 1.0)] * 3, seconds=1.0)
    tested = StrokeRange.of(prepare_runs([record], segment=(0.0, 10.9 + short)).prepared)
    assert tested.stroke == pytest.approx(ends, rel=0.05)
    assert tested.has_one_frequency


def test_a_table_of_peak_velocities_has_no_lag_and_is_within_limits():
    conditions = {"velocity_range [m/s]": [-0.25, 0.25]}
    found = peak_velocity_validity(percent=0.1, points=9, doubts=(), conditions=conditions, origin="a").verdict
    assert found.grade is Grade.LIMITED
    assert [reason.rule for reason in found.decisive] == ["no lag known"]
    assert "peak speeds up to 0.25 m/s" in found.reasons[1].figure


@pytest.mark.slow
def test_a_fit_passes_its_errors_to_the_verdict_and_to_the_band():
    fit = fit_shock(sines(*TWO_TESTS), "polylinear")
    assert fit.verdict.grade is Grade.USABLE
    assert (
        fit.held_out is not None and f"{max(fit.held_out.percent, fit.percent):.3g} %" in fit.verdict.reasons[0].figure
    )
    error = 0.01 * fit.held_out.percent * fit.deviation
    assert fit.band.half_width.min() >= error > 0.0
    assert fit.band.half_width.max() < 1.5 * error


class _Constant:
    """A fit that predicts a constant force."""

    def __init__(self, runs):
        self.runs = runs

    def refitted_rows(self, weights):
        return np.full(weights.size, self.runs.target.mean())


def test_the_error_of_a_quarter_is_over_the_variance_of_its_run():
    _, runs = judged_records((0.05, 0.25))
    errors = CrossValidation(_Constant(runs)).errors(np.ones(runs.target.size))
    assert np.mean(errors.pieces) == pytest.approx(1.0, rel=0.02)


@pytest.mark.slow
def test_lpnl2_on_a_digressive_shock_is_wrong_at_low_speeds_and_the_default_law_is_not():
    damper = Damper(laminar=(12e3, 12e3), blow_off=(500.0, 500.0), opened=(500.0, 500.0), stiffness=5e6, friction=10.0)
    rig = Rig(rate=500.0, corner=500.0, noise=2e-3, resolution=1e-4, has_velocity=True, has_temperature=False)
    random = np.random.default_rng(5)
    motions = [sine(0.025, speed / (2.0 * np.pi * 0.025), 4.0) for speed in (0.05, 0.13, 0.25, 0.4)]
    records = [rig.record(random, damper, x) for x in motions]
    rules = {law: [reason.rule for reason in fit_shock(records, law).verdict.reasons] for law in (None, "lpnl2")}
    assert {law: "low speeds" in found for law, found in rules.items()} == {None: False, "lpnl2": True}
