"""`eightpost rig` writes rig tests, reports them, and refuses invalid options."""

from __future__ import annotations

import os

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.rig import read_rig_test


def rig(*arguments):
    return CliRunner().invoke(main, ["-v", "virtual", "rig", *arguments])


def test_a_test_is_written_and_marked_as_synthetic(tmp_path, monkeypatch):
    """This includes systems that do not report the usable processors (Windows, macOS)."""
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    path = tmp_path / "quarter.parquet"
    result = rig(
        "--car", "quarter_car", "--test", "bump", "--duration", "4.2 s", "--shock", "20 lbf.s/in", "-o", str(path)
    )
    assert result.exit_code == 0, result.output
    assert "11 channels" in " ".join(result.output.split())
    conditions = read_rig_test(path).conditions
    assert conditions.shocks == ("20 lbf.s/in",)
    assert "SYNTHETIC" in conditions.synthetic


def test_a_single_test_without_its_actuator_is_refused(tmp_path):
    result = rig("--test", "single", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "--set only" in result.output


def test_one_shock_or_one_per_corner_is_required(tmp_path):
    result = rig("--shock", "demo:A", "--shock", "demo:B", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "once or 4 times" in result.output


def test_the_error_names_an_unknown_shock(tmp_path):
    result = rig("--shock", "demo:Z", "-o", str(tmp_path / "x.parquet"))
    assert result.exit_code == 2
    assert "demo:Z" in result.output


def test_shocks_are_reported_by_their_names(tmp_path):
    result = rig("--car", "quarter_car", "--test", "bump", "--duration", "4.2 s", "-o", str(tmp_path / "x.csv"))
    assert "shocks demo:A: 4.2 s" in result.output


@pytest.mark.nightly
def test_an_identification_has_a_baseline_and_an_alternate_test_for_each_corner(tmp_path):
    folder = tmp_path / "rig"
    result = rig("--program", "identification", "--duration", "5 s", "--shock", "20 lbf.s/in",
                 "--alternate", "9 lbf.s/in", "-o", str(folder))  # fmt: skip
    assert result.exit_code == 0, result.output
    names = ["alternate_lf", "alternate_lr", "alternate_rf", "alternate_rr", "baseline"]
    assert sorted(path.name for path in folder.iterdir()) == [f"{name}.parquet" for name in names]
    tests = {path.stem: read_rig_test(path) for path in folder.iterdir()}
    assert tests["alternate_rf"].conditions.shocks == ("20 lbf.s/in", "9 lbf.s/in", "20 lbf.s/in", "20 lbf.s/in")
    commands = [tests[name].series["lr.road_command"] for name in ("baseline", "alternate_lf")]
    assert (commands[0] == commands[1]).all()
    # Every test has its own noise and drift.
    seeds = {test.conditions.seed for test in tests.values()}
    assert len(seeds) == len(tests)


def test_a_program_does_not_start_with_a_missing_shock(tmp_path):
    folder = tmp_path / "rig"
    result = rig("--program", "identification", "--alternate", "demo:Z", "-o", str(folder))
    assert result.exit_code == 2
    assert "demo:Z" in result.output
    assert not folder.exists()


def test_a_program_does_not_replace_a_file_with_a_folder(tmp_path):
    path = tmp_path / "rig"
    path.write_text("mine")
    result = rig("--program", "bump", "-o", str(path))
    assert result.exit_code == 2
    assert "is a file" in result.output
    assert path.read_text() == "mine"


def test_a_single_test_needs_a_file_name(tmp_path):
    result = rig("--test", "bump", "-o", str(tmp_path / "rig"))
    assert result.exit_code == 2
    assert "a record ends in .parquet or .csv" in result.output
