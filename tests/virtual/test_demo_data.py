"""The shipped data are the output of their script, small, readable and marked as synthetic."""

from pathlib import Path

import numpy as np
import pytest

from eightpost.rig import read_dyno_test
from eightpost.signals import Drivefile, parquet_header
from eightpost.units import convert
from eightpost.virtual import demo_damper, measure, random_multisine, track_drivefile

DATA = Path(__file__).parents[2] / "examples" / "data"


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


@pytest.mark.nightly
def test_a_dynamometer_file_equals_its_generators_output_within_rounding():
    made = measure(demo_damper("A"), random_multisine(1, duration=12.0), seed=1)
    read = read_dyno_test(DATA / "dyno_A.csv").series
    np.testing.assert_allclose(read["force"], made["force"], atol=convert(0.1, "lbf", "N") * 1.01)
    np.testing.assert_allclose(read["displacement"], made["displacement"], atol=convert(1e-4, "in", "m") * 1.01)


def test_the_track_file_equals_its_generators_output_in_float32():
    path = DATA / "track.parquet"
    assert parquet_header(path)["note"].startswith("SYNTHETIC")
    assert path.stat().st_size < 600_000
    made = track_drivefile(11, duration=30.0, rate=500.0).series
    read = Drivefile.read(path).series
    assert read.names == made.names
    np.testing.assert_allclose(read.values, made.values.astype(np.float32), rtol=1e-6, atol=1e-9)
