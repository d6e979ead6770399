"""Measured records, if EIGHTPOST_DATA names their folder; none of them is part of the project."""

import os
from pathlib import Path

import pytest

from eightpost.errors import WrongSignError
from eightpost.ident import evaluate, fit_shock
from eightpost.rig.dyno_test import read_dyno_test

FOLDER = os.environ.get("EIGHTPOST_DATA")
pytestmark = pytest.mark.skipif(not FOLDER, reason="EIGHTPOST_DATA does not name the folder of measured records")
DATA = Path(FOLDER or ".")
RECORDS = (
    "ohlins/ohlins_t1_1_1_18_18_s5_n10_150psi.csv",
    "ohlins/ohlins_t1_1_1_18_18_s5_n10_50psi.csv",
    "ohlins/ohlins_t1_1_1_18_18_s1_n10_150psi.csv",
    "ohlins/ohlins_t1_3_3_24_24_s5_n10_100psi.csv",
    "labcontrol/labcontrol_ensaio.vali.1.csv",
    "labcontrol/labcontrol_ensaio8.2.csv",
    "labcontrol/labcontrol_ensaio1.csv",
)


def read(name):
    """Read a record; the force of the 18-18 runs is positive in extension."""
    try:
        return read_dyno_test(DATA / name)
    except WrongSignError:
        return read_dyno_test(DATA / name, flip=("force",))


#: Records of every day: two valvings of one make, and a damper of another laboratory.
DAILY = (RECORDS[0], RECORDS[3], RECORDS[6])
EVERY = [pytest.param(name, marks=() if name in DAILY else pytest.mark.nightly) for name in RECORDS]


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_dynamic_laws_beat_the_static_one_and_the_curve_does_not_fall(name):
    record = read(name)
    # Plain least squares, because RMS errors are compared; down-weighting outliers would increase them.
    fits = {law: fit_shock(record, law, robust="none") for law in ("polylinear", "lpf1", "lpnl2")}
    assert fits["polylinear"].rms > 1.5 * fits["lpf1"].rms
    assert fits["lpnl2"].rms <= 1.001 * fits["lpf1"].rms
    for fit in fits.values():
        assert fit.changes
        assert not any("not monotone" in warning for warning in fit.warnings)


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("law", ["polylinear", "lpf1", "lpnl2"])
def test_the_dissertation_recipe_runs_too(name, law):
    assert fit_shock(read(name), law, recipe="boggs").percent < 100.0


@pytest.mark.nightly
def test_another_run_is_predicted_better_with_a_lag():
    """ensaio8.2 predicts ensaio.vali.1 (the same damper, another day): 24 % static, 21 % LPF1, 19 % LPNL2."""
    first, other = read("labcontrol/labcontrol_ensaio8.2.csv"), read("labcontrol/labcontrol_ensaio.vali.1.csv")
    errors = {law: evaluate(fit_shock(first, law).shock, other).percent for law in ("polylinear", "lpf1", "lpnl2")}
    assert errors["lpnl2"] < errors["lpf1"] < errors["polylinear"] < 30.0
