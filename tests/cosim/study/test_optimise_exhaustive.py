"""Comparison of the search with the exhaustive study of the shipped bank: 2401 setups."""

from __future__ import annotations

from pathlib import Path

import moocore
import numpy as np
import pytest
from click.testing import CliRunner

from cosim.study.choice.optimise import optimise, scores_of
from cosim.study.table import StudyResult
from eightpost.__main__ import main

STUDY = Path(__file__).resolve().parents[3] / "examples" / "study.toml"

pytestmark = pytest.mark.nightly

TRADED = ("front ride height, RMS", "total tire force, RMS", "rf hub acceleration, RMS")


@pytest.fixture(scope="module")
def exhaustive(tmp_path_factory) -> StudyResult:
    folder = tmp_path_factory.mktemp("exhaustive")
    shown = CliRunner().invoke(main, ["study", str(STUDY), "-o", str(folder)])
    assert shown.exit_code == 0, shown.output
    return StudyResult.load(folder / "results.parquet")


@pytest.mark.parametrize("measure", [None, *TRADED, "aero number"])
@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_all_setups_is_found_within_250(exhaustive, measure, seed):
    names = () if measure is None else (measure,)
    found = optimise(
        exhaustive.study.space, lambda indices: scores_of(exhaustive, indices, names), evaluations=250, seed=seed
    )
    every = scores_of(exhaustive, exhaustive.setups, names)
    allowed = (every.violations <= 0.0).all(axis=1)
    assert found.best == exhaustive.setups[np.where(allowed, every.objectives[:, 0], np.inf).argmin()]


@pytest.mark.parametrize("measures", [TRADED[:2], TRADED])
@pytest.mark.parametrize("seed", range(3))
def test_the_trade_off_of_all_setups_is_found_within_400(exhaustive, measures, seed):
    found = optimise(
        exhaustive.study.space, lambda indices: scores_of(exhaustive, indices, measures), evaluations=400, seed=seed
    )
    every = scores_of(exhaustive, exhaustive.setups, measures).objectives
    worst = every.max(axis=0)
    reached, whole = (moocore.hypervolume(one, ref=worst) for one in (found.objectives[found.allowed], every))
    assert reached > 0.999 * whole
