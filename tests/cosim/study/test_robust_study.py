"""Draws run with FMUs, and uncertainty files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.study.choice.compare import usable_deviation, write_comparisons
from cosim.study.choice.rig_runs import Measured, comparisons
from cosim.study.choice.robust import Uncertainty, drawn_studies, leading, read_uncertainty, run_draws, spreads_of
from cosim.study.running.sweep import Sweep, run_study
from eightpost.errors import FileFormatError
from eightpost.verdict import Verdict

from .constructed import CORNERS, independent, result
from .coupled import InProcess, study

#: The static force of the stiff build has a standard deviation of 10 %.
STIFF = independent("stiff", {"compression_scale": (2.0, 0.2), "rebound_scale": (2.0, 0.2)})


@pytest.fixture(scope="module")
def exhaustive(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exhaustive")
    return folder, run_study(study(fmus), folder, InProcess())


def drawn_results(result, folder, part, count, setups, workers=None):
    """Return the results of setups with draws of one part."""
    sweep = Sweep(result.study, folder)
    return list(run_draws(result, sweep, workers or InProcess(), Uncertainty((part,)), setups, count))


@pytest.mark.nightly
def test_setups_without_an_uncertain_shock_have_no_spread(exhaustive):
    folder, nominal = exhaustive
    setups = leading(nominal, 25).tolist()
    draws = drawn_results(nominal, folder, STIFF, 2, setups)
    spread = next(s for s in spreads_of(nominal, draws, setups) if s.measure == "total tire force")
    stiff = np.array(["stiff" in nominal.study.space.setup(int(number)).builds.values() for number in spread.setups])
    moved = np.ptp(spread.draws, axis=0)
    assert (moved[~stiff] == 0.0).all()
    assert (moved[stiff] > 0.0).all()


def test_small_errors_change_a_measure_according_to_its_slope(fmus, exhaustive):
    """Two similar draws are compared with a finite difference of the study itself."""
    folder, nominal = exhaustive
    car = independent("middle", {"compression_scale": (1.0, 0.01)})
    baseline = nominal.study.baseline_setup.index
    draws = drawn_results(nominal, folder, car, 5, [baseline])
    scales = [drawn.study.bank["middle"].parameters["compression_scale"] for drawn in draws]
    levels = [drawn.values("total tire force")[0] for drawn in draws]
    slope = np.polyfit(scales, levels, 1)[0]
    bank = dict(nominal.study.bank)
    ends = []
    for scale in (0.99, 1.01):
        bank["middle"] = replace(bank["middle"], parameters={"compression_scale": scale, "rebound_scale": 1.0})
        changed = replace(nominal, study=replace(nominal.study, bank=bank))
        same = independent("soft", {"compression_scale": (0.5, 0.0)})
        ends.append(drawn_results(changed, folder, same, 2, [baseline])[0])
    difference = (ends[1].values("total tire force")[0] - ends[0].values("total tire force")[0]) / 0.02
    assert slope == pytest.approx(difference, rel=0.05)


def test_draws_that_were_run_are_not_run_again(exhaustive, tmp_path):
    _, nominal = exhaustive
    first, again = InProcess(), InProcess()
    for workers in (first, again):
        assert len(drawn_results(nominal, tmp_path, STIFF, 2, [0, 1], workers)) == 2
    assert len(first.ran) == 4
    assert again.ran == []


def test_there_are_no_draws_if_nothing_is_uncertain(exhaustive, tmp_path):
    _, nominal = exhaustive
    sweep = Sweep(nominal.study, tmp_path)
    assert list(run_draws(nominal, sweep, InProcess(), Uncertainty(), [0], 2)) == []


def test_the_draws_use_equivalent_vehicles_in_turn():
    made = result({"front": front}).study
    drawn = drawn_studies(made, [], draws=4, vehicles=[Path("second.fmu")])
    assert [s.vehicle.fmu.name for s in drawn] == ["car.fmu", "second.fmu", "car.fmu", "second.fmu"]


def front(digits: np.ndarray) -> np.ndarray:
    return 1.0 + digits.sum(axis=1)


def test_the_leading_setups_are_the_best_and_the_baseline():
    made = result({"front": front}, baseline=dict.fromkeys(CORNERS, "C/C"))
    assert leading(made, 1).tolist() == [0, 2400]


def test_an_uncertainty_file_is_read(tmp_path):
    path = tmp_path / "uncertain.toml"
    path.write_text(
        """schema = 1
vehicles = ["car_2.fmu"]
runs = 2
[[uncertain]]
part = "C/B"
correlation = [[1.0, -0.5], [-0.5, 1.0]]
[uncertain.parameters]
compression_scale = { value = 1.0, deviation = 0.02 }
time_constant = { value = 1e-3, deviation = 1e-4, lowest = 1e-6 }
[fits]
"C/C" = "C_C.json"
[run_to_run]
front = "0.01 in"
"""
    )
    found = read_uncertainty(path, result({"front": front}))
    (part,) = found.parts
    assert part.names == ("compression_scale", "time_constant")
    np.testing.assert_allclose(part.covariance, [[4e-4, -1e-6], [-1e-6, 1e-8]])
    assert found.fits == {"C/C": tmp_path / "C_C.json"}
    assert found.vehicles == (tmp_path / "car_2.fmu",)
    assert (found.run_to_run["front"], found.runs) == (pytest.approx(2.54e-4), 2)


def test_the_run_to_run_deviation_is_read_from_a_comparison(tmp_path):
    setups = np.array([0, 0, 100, 2000])
    made = result({"front": front, "rear": front})
    found = comparisons(made, Measured(setups, {n: np.array([1.0, 3.0, 5.0, 9.0]) for n in ("front", "rear")}, {}))
    write_comparisons(found, {"front": "m", "rear": "m"}, tmp_path / "comparison.json", Verdict())
    path = tmp_path / "uncertain.toml"
    path.write_text('schema = 1\ncompared = "comparison.json"\n[run_to_run]\nrear = 0.5\n')
    noise = read_uncertainty(path, made).run_to_run
    assert noise == {"front": pytest.approx(usable_deviation(np.sqrt(2.0), 1)), "rear": 0.5}


def test_a_comparison_without_repeated_runs_is_refused(tmp_path):
    made = result({"front": front})
    found = comparisons(made, Measured(np.array([0, 100, 2000]), {"front": np.array([1.0, 5.0, 9.0])}, {}))
    write_comparisons(found, {"front": "m"}, tmp_path / "comparison.json", Verdict())
    (tmp_path / "uncertain.toml").write_text('schema = 1\ncompared = "comparison.json"\n')
    with pytest.raises(FileFormatError, match="no setup was run twice"):
        read_uncertainty(tmp_path / "uncertain.toml", made)


def test_the_file_of_the_documentation_is_read(tmp_path):
    page = (Path(__file__).resolve().parents[3] / "docs" / "how_to" / "study_choice.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "uncertain.toml").write_text(block)
    found = read_uncertainty(tmp_path / "uncertain.toml", result({"front ride height, RMS": front}))
    assert [part.part for part in found.parts] == ["car"]
    assert set(found.fits) == {"C/B"}
    assert found.run_to_run["front ride height, RMS"] == pytest.approx(2.54e-5)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("schema = 2", "has schema 2"),
        ("schema = 1\nrun_to_run = 3", r"line 2: run_to_run"),
        ('schema = 1\n[fits]\n"D/D" = "d.json"', "no build 'D/D'"),
        ("schema = 1\n[run_to_run]\nfrnt = 1.0", "did you mean 'front'"),
        ('schema = 1\n[run_to_run]\nfront = "1 lbf"', "lbf"),
        ("schema = [", "cannot be read as TOML"),
        ('schema = 1\n[[uncertain]]\npart = "C/B"\ncorrelation = [[1.0, 0.5]]\n'
         "parameters = { time_constant = { value = 1.0, deviation = 1.0 } }", "matrix"),
    ],
)  # fmt: skip
def test_the_message_on_a_wrong_file_names_the_entry(tmp_path, text, what):
    path = tmp_path / "uncertain.toml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=what):
        read_uncertainty(path, result({"front": front}))
