"""The measured records in EIGHTPOST_DATA, which cannot be shipped, are read as described in their README."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from eightpost.errors import WrongSignError
from eightpost.rig import read_dyno_test, read_peak_velocity

FOLDER = os.environ.get("EIGHTPOST_DATA")
pytestmark = pytest.mark.skipif(not FOLDER, reason="EIGHTPOST_DATA does not name the folder of measured records")

OHLINS = [
    "ohlins_t1_1_1_18_18_s1_n10_150psi.csv",
    "ohlins_t1_1_1_18_18_s5_n10_150psi.csv",
    "ohlins_t1_1_1_18_18_s5_n10_50psi.csv",
    "ohlins_t1_3_3_18_18_s5_n100_50psi.csv",
]


def measured(folder: str, name: str) -> Path:
    path = Path(FOLDER or "") / folder / name
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    return path


@pytest.mark.nightly
@pytest.mark.parametrize("name", OHLINS)
def test_the_18_18_runs_have_the_wrong_sign_and_are_read_if_flipped(name):
    path = measured("ohlins", name)
    with pytest.raises(WrongSignError, match=rf"{name}.*is -0\.9\d\d"):
        read_dyno_test(path)
    test = read_dyno_test(path, flip=("force",))
    assert "temperature" in test.series
    assert np.ptp(test.series["displacement"]) == pytest.approx(0.037, abs=0.002)
    assert test.series.sample_rate == pytest.approx(300.0, rel=1e-3)


def test_the_24_24_run_has_the_correct_sign():
    test = read_dyno_test(measured("ohlins", "ohlins_t1_3_3_24_24_s5_n10_100psi.csv"))
    # 26 to 151 mm/s at the ends of the set; this one is nominally 5 in/s.
    assert np.abs(test.series["velocity"]).max() == pytest.approx(0.127, rel=0.1)


@pytest.mark.repeated
@pytest.mark.parametrize("name", ["ensaio.vali.1", "ensaio1", "ensaio8.2"])
def test_the_magneto_rheological_damper_is_read_with_its_measured_velocity(name):
    test = read_dyno_test(measured("labcontrol", f"labcontrol_{name}.csv"))
    assert test.derived == ()
    assert test.series.sample_rate == pytest.approx(100.0)


def test_the_lag_of_the_undocumented_force_filter_is_reported():
    test = read_dyno_test(measured("ohlins", "ohlins_t1_3_3_24_24_s5_n10_100psi.csv"))
    (reason,) = (reason for reason in test.reasons if reason.rule == "late force")
    assert re.match(r"by 2\d\.\d ms \(2\d\.\d to 3\d ms\)", reason.figure)


@pytest.mark.nightly
@pytest.mark.parametrize("name", OHLINS[:2])
def test_a_gas_force_that_is_negative_after_flipping_the_force_is_reported(name):
    test = read_dyno_test(measured("ohlins", name), flip=("force",))
    assert [reason.rule for reason in test.reasons][:1] == ["negative force at standstill"]
    other_way = read_dyno_test(measured("ohlins", name), flip=("displacement",))
    assert not any(reason.rule == "negative force at standstill" for reason in other_way.reasons)


def test_the_manufacturers_curves_are_read_as_a_table_per_setting():
    tables = read_peak_velocity(measured("ohlins", "ohlins_vendor_FV_curves_digitised.csv"))
    assert len(tables) == 11
    stiffest = next(table for table in tables if table.clicks == "LS0_HS4")
    # The last points of the two digitised curves: 719 N and -618 N at 0.25 m/s.
    assert stiffest.compression.max() == pytest.approx(719.0, rel=0.01)
    assert stiffest.rebound.min() == pytest.approx(-618.0, rel=0.01)
