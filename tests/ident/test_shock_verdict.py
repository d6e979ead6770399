"""The verdict of a fit follows from its errors and from the strokes of its records, within the range that it states."""

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest

from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import CrossValidation, HeldOutErrors
from eightpost.ident.shock.runs import StrokeRange, prepare_runs, strokes
from eightpost.ident.shock.verdict import peak_velocity_validity, shock_validity
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


def verdict(percent=0.6, held_out=0.5, trouble="", motions=THREE_TESTS, static=20.0):
    held = None if held_out is None else HeldOutErrors("quarters", held_out)
    found = shock_validity(
        *judged_records(*motions), percent=percent, static=static, held_out=held, trouble=trouble, conditions={}
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
    assert "12.1 %, limit 12 %" in found.decisive[0].figure


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
    found = shock_validity(tests, runs, percent=0.1, static=5.0, held_out=None, trouble="", conditions={}).verdict
    assert (late in found.reasons) is is_reported


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
