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


@pytest.mark.parametrize(
    ("words", "name", "what"),
    [
        (["--test", "single"], "x.parquet", "--set only"),
        (["--shock", "demo:A", "--shock", "demo:B"], "x.parquet", "once or 4 times"),
        (["--shock", "demo:Z"], "x.parquet", "demo:Z"),
        (["--program", "identification", "--alternate", "demo:Z"], "rig", "demo:Z"),
        (["--test", "bump"], "rig", "a record ends in .parquet or .csv"),
    ],
)
def test_a_wrong_option_is_refused_before_the_first_test(tmp_path, words, name, what):
    result = rig(*words, "-o", str(tmp_path / name))
    assert result.exit_code == 2 and what in result.output
    assert not list(tmp_path.iterdir())


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
