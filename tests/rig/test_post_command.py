"""`eightpost rig` writes a rig test, says what it did, and refuses what it cannot do."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.rig.post import read_rig_test


def rig(*arguments):
    return CliRunner().invoke(main, ["rig", *arguments])


@pytest.mark.slow
def test_a_test_is_written_and_says_that_it_is_synthetic(tmp_path):
    path = tmp_path / "quarter.parquet"
    result = rig(
        "--car", "quarter_car", "--test", "bump", "--duration", "4.2 s", "--shock", "20 lbf.s/in", "-o", str(path)
    )
    assert result.exit_code == 0, result.output
    assert "11 channels" in result.output
    conditions = read_rig_test(path).conditions
    assert conditions.shocks == ("20 lbf.s/in",)
    assert "SYNTHETIC" in conditions.synthetic


def test_a_single_test_without_its_actuator_is_refused(tmp_path):
    result = rig("--test", "single", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "--only" in result.output


def test_shocks_are_one_for_all_or_one_per_corner(tmp_path):
    result = rig("--shock", "demo:A", "--shock", "demo:B", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "once or 4 times" in result.output


def test_an_unknown_shock_is_named(tmp_path):
    result = rig("--shock", "demo:Z", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "demo:Z" in result.output
