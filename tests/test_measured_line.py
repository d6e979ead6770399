"""The whole workflow with measured records (fit, build, check, couple), if EIGHTPOST_DATA names their folder."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cosim
from builder.build import build
from builder.check import check
from eightpost.corners import CORNERS
from eightpost.ident import fit_shock
from eightpost.rig import read_dyno_test
from eightpost.shock import write_shock
from eightpost.signals import Drivefile

ROOT = Path(__file__).parents[1]
DATA = os.environ.get("EIGHTPOST_DATA")
RECORDS = {
    "ohlins/ohlins_t1_3_3_24_24_s5_n10_100psi.csv": (),
    "ohlins/ohlins_t1_1_1_18_18_s5_n10_50psi.csv": ("force",),
    "labcontrol/labcontrol_ensaio1.csv": (),
}


#: Groups of checks whose result depends on the numbers of an FMU.
NUMBERS = ("static", "simulation", "reset", "steps", "initial_dependencies", "dependencies", "derivatives", "ports")


@pytest.mark.nightly
@pytest.mark.skipif(not DATA, reason="EIGHTPOST_DATA does not name the folder of measured records")
@pytest.mark.parametrize("record", RECORDS)
def test_a_measured_shock_becomes_an_fmu_that_damps_the_car(record, tmp_path):
    """The FMU of the first is checked where its numbers matter; other FMUs of this law pass all checks elsewhere."""
    assert DATA is not None
    fit = fit_shock(read_dyno_test(Path(DATA) / record, flip=RECORDS[record]), "lpf1")
    assert fit.percent < 40.0
    # The records are of small dampers, which a car would use with a motion ratio; this test is about the curve.
    write_shock(replace(fit.shock, name="measured"), tmp_path / "shock.json")
    build([tmp_path / "shock.json", ROOT / "examples" / "car.toml"], tmp_path)
    if record == next(iter(RECORDS)):
        assert {finding.rule.identifier for finding in check(tmp_path / "shock.fmu", groups=NUMBERS).findings} == {
            "platforms"
        }
    system = cosim.System.load(
        {"car": tmp_path / "car.fmu"} | dict.fromkeys(CORNERS, tmp_path / "shock.fmu"),
        [cosim.Bond.between(f"car.{c}", c) for c in CORNERS],
    )
    drive = Drivefile.read(ROOT / "examples" / "data" / "track.parquet")
    result = cosim.run(system, cosim.Scenario(3.0, drive, record_step=0.002, settling=1.0), step=1e-3)
    assert result.converged
    for corner in CORNERS:
        series = result.settled()
        power = series[f"{corner}.force"] - series[f"{corner}.force"].mean()
        assert np.mean(power * series[f"car.{corner}.velocity"]) > 0.0, "the shock must take energy out of the car"
