"""Power of measures above the band in which a vehicle was identified."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.study.measures import AboveBand, Filtered, Measure, above_band, band_ends, power_above
from cosim.study.running.sweep import run_study
from cosim.study.verdict import ABOVE_BAND, WITHIN_BAND, study_verdict
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Verdict

RATE = 250.0
TIME = np.arange(5000) / RATE


def sines(low: float, high: float) -> np.ndarray:
    return low * np.sin(2.0 * np.pi * 5.0 * TIME) + high * np.sin(2.0 * np.pi * 40.0 * TIME)


@pytest.mark.nightly
@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_the_share_above_is_that_of_the_sines_power(low, high):
    found = power_above(sines(low, high)[np.newaxis], RATE, 16.0)
    assert found == pytest.approx(high**2 / (low**2 + high**2), abs=1e-3)


def test_nothing_is_above_for_a_constant():
    assert power_above(np.full((1, 100), 3.0), RATE, 16.0) == 0.0


def run() -> Filtered:
    channels = {"car.a": ("m", sines(1.0, 1.0)), "car.b": ("m", sines(1.0, -1.0)), "lf.force": ("N", sines(0.0, 1.0))}
    return Filtered(TimeSeries.from_channels(TIME, channels))


def test_a_sum_in_which_the_high_frequencies_cancel_has_none_above():
    total, apart = Measure("sum", ("car.a", "car.b")), Measure("joint", ("car.a", "car.b"), "joint_rms")
    found = above_band(run(), (total, apart), {"car.a": 16.0, "car.b": 20.0}, start=1.0)
    assert found["sum"].share == pytest.approx(0.0, abs=1e-9)
    assert found["joint"].share == pytest.approx(0.5, abs=1e-3)
    assert {one.high for one in found.values()} == {16.0}


def test_a_band_that_ends_at_the_vehicles_band_removes_the_power_above():
    measure = Measure("a", ("car.a",))
    whole, limited = (above_band(run(), (m,), {"car.a": 16.0}, 1.0)["a"] for m in
                      (measure, replace(measure, band=(0.5, 16.0))))  # fmt: skip
    assert whole.share == pytest.approx(0.5, abs=1e-3)
    assert limited.share < 1e-3


def test_channels_without_a_band_and_statistics_without_power_are_left_out():
    measures = (Measure("force", ("lf.force",)), Measure("mean", ("car.a",), "mean"))
    assert above_band(run(), measures, {"car.a": 16.0}, 1.0) == {}


def test_the_ends_are_those_that_the_vehicle_states():
    ranges = (Range("lf.velocity", "frequency", 0.1, 24.0, "Hz"), Range("lf.force", "amplitude", -1.0, 1.0, "N"))
    assert band_ends(Validity(Verdict(()), ranges).to_json(), "car") == {"car.lf.velocity": 24.0}
    assert band_ends(None, "car") == {}


@pytest.mark.repeated
@pytest.mark.parametrize(("share", "rule"), [(0.24, ABOVE_BAND), (0.02, WITHIN_BAND)])
def test_the_verdict_names_the_measures_and_their_shares(small_study, here, tmp_path, share, rule):
    study = small_study(corners=dict.fromkeys(small_study().corners, ("soft",)))
    result = run_study(study, tmp_path, here)
    assert result.provenance.above_band == {}  # a vehicle of stated parameters has no band
    made_by = replace(result.provenance, above_band={study.measures[0].name: AboveBand(16.0, share)})
    judged = replace(result, provenance=made_by)
    judged.save(tmp_path / "results.parquet")
    again = type(result).load(tmp_path / "results.parquet")
    reason = next(one for one in study_verdict(again).reasons if one.about == rule.about)
    assert reason.rule == rule.name
    assert f"{study.measures[0].name} {share:.0%} above 16 Hz" in reason.figure
    assert rule.grade is (Grade.LIMITED if share > 0.1 else Grade.USABLE)
