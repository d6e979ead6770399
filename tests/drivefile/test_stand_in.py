"""The drive file of a lap of the 8-post stand-in with friction, noise and drift, from identification to pass eight."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.corners import CORNERS
from eightpost.signals import read_series
from eightpost.signals.formats import write_series

pytestmark = pytest.mark.nightly

TARGETS = [f"{corner}.{what}" for what in ("hub_acceleration", "displacement") for corner in CORNERS]


def eightpost(*words):
    shown = CliRunner().invoke(main, [str(word) for word in words])
    assert shown.exit_code == 0, shown.output


def test_eight_passes_reproduce_a_lap_on_a_road_that_the_rig_does_not_know(tmp_path):
    rig, car, lap = tmp_path / "rig", tmp_path / "car.json", tmp_path / "lap"
    run = ("--set", "duration=100 s", "--set", "seed=51", "--set", "run=510")
    eightpost("virtual", "rig", "--program", "identification", *run, "-o", rig)
    eightpost("identify", *sorted(rig.glob("*.parquet")), "-o", car, "--plot", "none")
    eightpost("virtual", "rig", "--test", "track", "--seed", 52, "--run", 520, "-o", tmp_path / "whole.parquet")
    whole = read_series(tmp_path / "whole.parquet")
    write_series(whole.select(TARGETS), tmp_path / "track.parquet")
    eightpost("drivefile", "start", tmp_path / "track.parquet", "--car", car, "-o", lap)
    eightpost("drivefile", "simulate", lap, "--seed", 530, "--passes", 8)
    last = json.loads((lap / "pass_08" / "errors.json").read_text())
    best = json.loads((lap / f"pass_{last['best']:02d}" / "errors.json").read_text())["channels"]
    errors = {
        what: np.sqrt(np.mean([best[f"{c}.{what}"] ** 2 for c in CORNERS]))
        for what in ("hub_acceleration", "displacement")
    }
    assert errors["hub_acceleration"] < 0.025
    assert errors["displacement"] < 0.01
    # Channels that were no targets agree too.
    record = read_series(lap / f"pass_{last['best']:02d}" / "rig.parquet").window(4.0, 35.0)
    track = whole.window(1.0, 32.0)
    for corner in CORNERS:
        name = f"{corner}.tire_force"
        assert record[name].std() == pytest.approx(track[name].std(), rel=0.01)
