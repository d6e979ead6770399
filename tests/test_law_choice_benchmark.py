"""The benchmark of the choice of the law counts choices with and without the level of another run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.law_choice import Chosen, Errors, choices_table, gains_table, summary
from benchmarks.shock_records import Case
from benchmarks.shock_rows import shape_rms
from benchmarks.single_speed import Outcome, report
from eightpost.rig import DynoTest
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade

pytestmark = pytest.mark.nightly

LPNL2_POLYNOMIAL, LPNL2_KNOTS, HYSTERESIS = ("lpnl2", "polynomial"), ("lpnl2", "knots"), ("hysteresis", "knots")


def run():
    """Return a record; what it contains does not matter."""
    time = np.arange(100) / 100.0
    channels = {name: (unit, np.sin(7.0 * time)) for name, unit in (("velocity", "m/s"), ("force", "N"))}
    return DynoTest(TimeSeries.from_channels(time, channels))


def choice(case, shape=None):
    raw = {LPNL2_POLYNOMIAL: 20.0, LPNL2_KNOTS: 18.0, HYSTERESIS: 19.0}
    return Chosen(case, None, Errors(raw, HYSTERESIS), Errors(shape, HYSTERESIS) if shape else None, 1.0,
                  Grade.LIMITED, is_one_speed=True)  # fmt: skip


@given(gain=st.floats(0.01, 100.0), offset=st.floats(-1e3, 1e3), seed=st.integers(0, 99))
def test_the_error_of_a_laws_shape_ignores_offset_and_level_and_nothing_else(gain, offset, seed):
    measured, noise = np.random.default_rng(seed).standard_normal((2, 300))
    noise -= noise.mean()
    about = measured - measured.mean()
    noise -= about * (noise @ about) / (about @ about)
    shape = measured + 0.1 * noise
    # The best gain projects the measured force on the prediction: the error is what is perpendicular to it.
    expected = np.std(measured) * 0.1 * np.std(noise) / np.hypot(np.std(measured), 0.1 * np.std(noise))
    assert shape_rms(gain * shape + offset, measured) == pytest.approx(expected, rel=1e-6)
    assert shape_rms(np.full(300, offset), measured) == pytest.approx(np.std(measured))


def test_only_a_measured_run_that_is_not_fitted_has_a_level_of_its_own():
    one, other = run(), run()
    assert Case("another run", (one,), other).is_run_to_run
    assert not Case("a third of the run", (one, other), other).is_run_to_run
    assert not Case("configuration 5", (one,), other, configuration=5).is_run_to_run


def test_choices_and_gains_are_counted_with_and_without_the_level_of_another_run():
    test = run()
    shape = {LPNL2_POLYNOMIAL: 10.0, LPNL2_KNOTS: 8.0, HYSTERESIS: 5.0}
    found = [choice(Case("another run", (test,), replace(test)), shape), choice(Case("a third", (test,), test))]
    table, lines = choices_table(found), summary(found).splitlines()
    assert [line.split(" | ")[-2] for line in table.splitlines()[2:]] == ["5.6", "0.0", "5.6"]
    assert table.splitlines()[2].endswith("| usable within limits, single speed |")
    assert any(line.endswith("Of 1 choices whose error is above 10 % on the held-out record, 0 had the verdict usable.")
               for line in lines)  # fmt: skip
    assert "best offset and gain: 1 of 2 choices (50 %)" in lines[0]
    assert "their level: 0 of 2 choices (0 %)" in lines[1]
    (gain_free,) = [line for line in lines if "2 measured cases, other runs with their best offset and gain" in line]
    assert "0.95, 0.50, .., 0.72 (median)" in gain_free
    assert [line.split(" | ")[-2:] for line in gains_table(found).splitlines()[2:]] == [
        ["-50", "-38 |"],
        ["-5", "+6 |"],
    ]


def test_on_one_speed_the_choices_of_both_groups_and_the_change_by_knots_are_counted_largest_first():
    chosen = {"all laws": HYSTERESIS, "without Hysteresis": LPNL2_KNOTS}
    first = Outcome("faster", {LPNL2_POLYNOMIAL: 10.0, LPNL2_KNOTS: 12.0, HYSTERESIS: 10.4}, chosen)
    second = Outcome("faster", {LPNL2_POLYNOMIAL: 20.0, LPNL2_KNOTS: 10.0, HYSTERESIS: 15.0}, chosen)
    assert [first.excess(group) for group in chosen] == pytest.approx([0.04, 0.2])
    assert first.change("lpnl2") == pytest.approx(0.2)
    assert first.change("hysteresis") is None
    rows = [line.strip("| ").split(" | ") for line in report([first, second]).splitlines()]
    assert rows[2][:3] == ["faster", "all laws", "1 of 2"]
    assert rows[2][3] == "50, 4, .., 27 (median), .., 4"
    assert rows[3][1:3] == ["without Hysteresis", "1 of 2"]
    assert ["faster", "LPNL2", "1 of 2", "20, -50, .., -15 (median), .., -50"] in [row[:4] for row in rows]
