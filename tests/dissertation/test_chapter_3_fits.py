"""Statements about the fits of chapter 3 are true of errors that were made so, and false of others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_3_fits as chapter
from eightpost.signals import TimeSeries
from eightpost.virtual import sine_tests

from .conftest import claims

LAWS = ("polylinear", "lpf1", "lpnl2")
EFFORT = replace(QUICK, configurations=(1, 5, 6, 9))


def errors(monkeypatch, static, gain=0.4, less=0.05):
    """Set the errors of Polylinear by configuration, and what LPF1 and LPNL2 gain."""
    shares = {"polylinear": 1.0, "lpf1": 1.0 - gain, "lpnl2": (1.0 - gain) * (1.0 - less)}
    monkeypatch.setattr(chapter, "_error", lambda number, law: static[number] * shares[law])


def test_errors_of_the_laws_are_compared_by_configuration(monkeypatch, plots):
    errors(monkeypatch, {1: 30.0, 5: 40.0, 6: 50.0, 9: 20.0})
    found = chapter.figure_3_18(EFFORT)
    assert set(claims(found).values()) == {True}
    assert found.claims["dynamic"][1].startswith("40 to 40 % less")
    assert found.claims["lpnl2"][1].startswith("5.0 to 5.0 % less")
    assert found.claims["largest"][1] == "the two largest errors are those of 6, 5"
    assert found.claims["smallest"][1] == "the smallest error is that of 9"
    errors(monkeypatch, {1: 60.0, 5: 10.0, 6: 50.0, 9: 20.0}, gain=0.19, less=-0.01)
    assert set(claims(chapter.figure_3_18(EFFORT)).values()) == {False}
    assert chapter.table_3_5(EFFORT).values["lpf1/configuration 9"] == pytest.approx(16.2)


def test_errors_of_fits_are_relative_to_the_force_and_to_polylinear(monkeypatch):
    rms = {"polylinear": 40.0, "lpf1": 30.0, "lpnl2": 10.0}
    fits = {name: SimpleNamespace(rms=value, deviation=200.0, seconds=2.0) for name, value in rms.items()}
    monkeypatch.setattr(chapter, "fitted", lambda number, name: fits[name] if number == 1 else None)
    assert [chapter._percent(name) for name in LAWS] == [20.0, 15.0, 5.0]
    assert [chapter._reduction(name) for name in LAWS] == [0.0, 25.0, 75.0]


def sines(monkeypatch, low, high):
    """Set errors: the laws spread at the lowest frequency, and LPNL2 differs from Polylinear at the highest."""
    tests = sine_tests()
    ends = {
        size: (min(own), max(own))
        for size in {one.amplitude for one in tests}
        if (own := [one.frequency for one in tests if one.amplitude == size])
    }

    def error(number, law):
        one = tests[number]
        first, last = ends[one.amplitude]
        factor = 1.0 + (low if one.frequency == first and law == "lpf1" else 0.0)
        factor -= high if one.frequency == last and law == "lpnl2" else 0.0
        return SimpleNamespace(rms=100.0 * factor)

    monkeypatch.setattr(chapter, "_sine", error)


@pytest.mark.parametrize(("low", "high", "expected"), [(0.49, 0.01, (True, True)), (0.51, -0.01, (False, False))])
def test_laws_agree_at_the_lowest_frequency_of_each_amplitude_and_lpnl2_is_better_at_the_highest(
    low, high, expected, monkeypatch, plots
):
    sines(monkeypatch, low, high)
    found = chapter.figure_3_20(QUICK)
    assert tuple(claims(found).values()) == expected
    assert found.claims["low"][1] == f"spread {', '.join([f'{100 * low:.0f}'] * 4)} % for 1, 0.5, 0.25, 0.1 in"
    assert [plot.title for plot in plots] == ["1 in", "0.5 in", "0.25 in", "0.1 in"]


def test_settling_is_the_longest_time_in_which_a_hold_in_compression_is_over_1_lb_from_its_average():
    """Forces of 10 and 50 N decay with 1 s; 1 lb is 4.448 N."""
    time = np.arange(2001) / 100.0
    force = np.where(time < 10.0, 10.0 * np.exp(-(time - 2.0).clip(0.0)), 50.0 * np.exp(-(time - 12.0).clip(0.0)))
    holds = [
        SimpleNamespace(direction="compression", start=3.0, stop=9.0, force=0.0),
        SimpleNamespace(direction="rebound", start=13.0, stop=19.0, force=0.0),
    ]
    found = SimpleNamespace(series=TimeSeries.from_channels(time, {"force": ("N", force)}), holds=holds, settling=1.0)
    assert chapter._settling(found) == pytest.approx(np.log(10.0 / 4.448), abs=0.011)
    holds[1].direction = "compression"
    assert chapter._settling(found) == pytest.approx(np.log(50.0 / 4.448), abs=0.011)


def static(rate, offset, settling=0.0):
    holds = [SimpleNamespace(displacement=0.01 * k, force=100.0 + rate * 0.01 * k) for k in range(4)]
    return SimpleNamespace(holds=holds, gas_rate=rate, hysteresis=offset)


@pytest.mark.parametrize(("soft", "holds"), [(900.0, True), (1100.0, False)])
def test_the_gas_rate_rises_with_the_pressure(soft, holds, monkeypatch, plots):
    found = {number: static(1000.0 + number, 6.0) for number in (3, 7, 11)}
    found |= {1: static(soft, 12.0), 5: static(100.0, None), 9: static(100.0, 12.0)}
    monkeypatch.setattr(chapter, "_static", found.__getitem__)
    result = chapter.figure_3_23(QUICK)
    assert claims(result) == {"pressure": holds}
    assert result.values["rate"] == pytest.approx(1007.0)
    assert result.values["rise"] == pytest.approx(3.0 * 0.0254 * 1007.0)
    assert result.values["offset"] == pytest.approx((3 * 6.0 + 12.0 + 0.0 + 12.0) / 6.0)
    assert plots[0].lines[3].y == pytest.approx([0.0, 10.03, 20.06, 30.09])


def bumps(monkeypatch, peak, rms):
    """Set the errors of the bump: peaks of both ramps, and the root mean square of each law."""
    time = np.arange(500) / 100.0
    rows = TimeSeries.from_channels(time, {"velocity": ("m/s", time), "force": ("N", 2.0 * time)})
    events = [
        SimpleNamespace(start=1.0, stop=2.0, peak_error=5.0),
        SimpleNamespace(start=3.0, stop=4.0, peak_error=peak),
    ]
    prediction = SimpleNamespace(measured=rows, predicted=rows)
    monkeypatch.setattr(
        chapter, "_bump", lambda law: SimpleNamespace(events=events, prediction=prediction, rms=rms.get(law))
    )


def test_peaks_of_a_bump_are_predicted_within_15_percent(monkeypatch, plots):
    for peak in (-14.9, -15.1):
        bumps(monkeypatch, peak, {})
        claim = chapter.figure_3_24(QUICK).claims["good"]
        assert claim[0] is (peak > -15.0) and claim[1].endswith(f"LPNL2 rebound {peak:+.1f} %")
    shown = plots[0].lines[0].x
    assert (shown[0], shown[-1]) == (pytest.approx(0.98), pytest.approx(2.02))


@pytest.mark.parametrize(("better", "holds"), [(8.0, True), (9.0, False)])
def test_lpnl2_predicts_a_bump_better_than_polylinear(better, holds, monkeypatch):
    bumps(monkeypatch, 0.0, {"polylinear": 9.0 * 4.44822162, "lpnl2": better * 4.44822162})
    claim = chapter.figure_3_25(QUICK).claims["lpnl2"]
    assert claim == (holds, f"RMS error {better:.3g} lbf, Polylinear 9 lbf")
