"""The shipped records and shocks are the output of their scripts, small, readable and marked as synthetic."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from eightpost.rig import read_dyno_test
from eightpost.shock import read_shock
from eightpost.signals import Drivefile, parquet_header
from eightpost.virtual import BUILDS, track_drivefile

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = EXAMPLES / "data"


@pytest.mark.nightly
@pytest.mark.parametrize("build", ["A", "B", "C"])
def test_a_dynamometer_file_reads_without_notes(build):
    path = DATA / f"dyno_{build}.csv"
    assert path.read_text().startswith("SYNTHETIC")
    assert path.stat().st_size < 900_000
    test = read_dyno_test(path)
    assert set(test.series.names) == {"displacement", "velocity", "force", "temperature"}
    assert test.series.duration == pytest.approx(12.0)
    assert test.series.sample_rate == pytest.approx(2000.0)


def test_the_track_file_equals_its_generators_output_in_float32():
    path = DATA / "track.parquet"
    assert parquet_header(path)["note"].startswith("SYNTHETIC")
    assert path.stat().st_size < 600_000
    made = track_drivefile(11, duration=30.0, rate=500.0).series
    read = Drivefile.read(path).series
    assert read.names == made.names
    np.testing.assert_allclose(read.values, made.values.astype(np.float32), rtol=1e-6, atol=1e-9)


def test_there_is_a_shock_for_every_build_of_table_7_3():
    assert sorted(path.stem for path in (EXAMPLES / "bank").iterdir()) == sorted(b.replace("/", "_") for b in BUILDS)


@pytest.mark.nightly
def test_a_build_of_the_bank_is_reproduced_by_its_script(tmp_path):
    spec = importlib.util.spec_from_file_location("make_bank", EXAMPLES / "make_bank.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.make("B/B", 101 + BUILDS.index("B/B"), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["B_B.json"]
    shipped = EXAMPLES / "bank" / "B_B.json"
    velocities = np.linspace(-1.0, 1.0, 81)
    found, expected = (np.array([read_shock(path).law.curve.force(v) for v in velocities]) for path in (made, shipped))
    # Bits may differ between versions of numpy and scipy; the curve may not.
    assert np.abs(found - expected).max() < 5e-4 * np.ptp(expected)
    assert json.loads(shipped.read_text())["law"] == "lpnl2"
