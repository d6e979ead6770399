"""Searches of constructed banks whose best setups are known from exhaustive evaluation."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import moocore
import numpy as np
import pytest
from click.testing import CliRunner

from cosim.study.choice.optimise import Scores, Search, optimise, scores_of, search_study
from cosim.study.definition import Constraint, SetupSpace, Term
from cosim.study.running.leaders import pareto_front
from cosim.study.running.sweep import Sweep, run_study
from cosim.study.table import StudyResult
from eightpost.__main__ import main
from eightpost.api.study_folder import StudyFolder
from eightpost.corners import CORNERS
from eightpost.errors import InputError

from .constructed import result
from .coupled import COUPLING, TRACK, InProcess, study

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")
SPACE = SetupSpace(dict.fromkeys(CORNERS, BUILDS))


def responses(seed: int, count: int) -> np.ndarray:
    """Return responses (2401, count) with main effects, weaker interactions of two corners, and noise."""
    generator = np.random.default_rng(seed)
    levels, values = SPACE.digits(SPACE.indices), np.zeros((2401, count))
    for m in range(count):
        for corner in range(4):
            values[:, m] += 2.0 * generator.normal() * generator.normal(size=7)[levels[:, corner]]
        for a, b in combinations(range(4), 2):
            values[:, m] += 0.4 * generator.normal(size=(7, 7))[levels[:, a], levels[:, b]]
        values[:, m] += 0.1 * generator.normal(size=2401)
    return values


class Bank:
    """Bank with tabulated responses that counts how often each setup was run."""

    def __init__(self, objectives: np.ndarray, violations: np.ndarray | None = None) -> None:
        self.objectives = objectives
        self.violations = np.zeros((objectives.shape[0], 0)) if violations is None else violations
        self.runs = np.zeros(objectives.shape[0], dtype=int)

    def __call__(self, indices: np.ndarray) -> Scores:
        np.add.at(self.runs, indices, 1)
        return Scores(self.objectives[indices], self.violations[indices])


@pytest.mark.repeated(2)
@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_2401_setups_is_found_within_400(seed):
    bank = Bank(responses(seed, 1))
    found = optimise(SPACE, bank, evaluations=400, seed=seed)
    assert found.best == int(bank.objectives.argmin())


def test_no_setup_is_run_twice_and_no_more_than_allowed():
    bank = Bank(responses(0, 2))
    found = optimise(SPACE, bank, evaluations=150)
    assert bank.runs.max() == 1
    assert bank.runs.sum() == found.indices.size == 150


def test_a_quarter_of_the_bank_shows_the_trade_off_of_two_measures():
    bank = Bank(responses(2, 2))
    worst = bank.objectives.max(axis=0)
    found = optimise(SPACE, bank, evaluations=600)
    front, whole = (moocore.hypervolume(one, ref=worst) for one in (bank.objectives[found.front], bank.objectives))
    assert front > 0.98 * whole


def test_the_best_setup_that_keeps_the_constraints_is_found():
    objectives = responses(3, 2)
    limit = np.quantile(objectives[:, 1], 0.2)
    bank = Bank(objectives[:, :1], (objectives[:, 1:] - limit) / abs(limit))
    allowed = np.flatnonzero(objectives[:, 1] <= limit)
    found = optimise(SPACE, bank, evaluations=500)
    assert found.best == allowed[objectives[allowed, 0].argmin()]


def test_a_setup_that_fails_is_never_the_best():
    objectives = responses(4, 1)
    best = objectives[:, 0].argsort()[:2]
    objectives[best[0]] = np.nan
    assert optimise(SPACE, Bank(objectives), evaluations=400).best == best[1]


def test_without_an_allowed_setup_there_is_no_best_one():
    found = optimise(SPACE, Bank(responses(5, 1), np.ones((2401, 1))), evaluations=60)
    assert found.best is None
    assert found.front.size == 0


def test_a_space_no_larger_than_the_evaluations_is_evaluated_completely():
    bank = Bank(responses(6, 1))
    found = optimise(SPACE, bank, evaluations=2401)
    assert found.status == "every setup was evaluated"
    assert (bank.runs == 1).all()


def test_the_first_generation_has_the_start_setups_and_every_build_at_every_corner():
    found = optimise(SPACE, Bank(responses(7, 1)), evaluations=21, population=21, start=(1200,))
    assert found.indices[0] == 1200
    for digits in SPACE.digits(found.indices).T:
        assert set(digits) == set(range(7))


def test_corners_that_are_alike_stay_alike_in_a_very_large_space():
    many = tuple(f"build {n}" for n in range(400))
    space = SetupSpace(dict.fromkeys(CORNERS, many), alike=(("lf", "rf"), ("lr", "rr")))

    def distance(indices: np.ndarray) -> Scores:
        digits = space.digits(indices)
        assert (digits[:, 0] == digits[:, 1]).all()
        assert (digits[:, 2] == digits[:, 3]).all()
        return Scores(np.abs(digits - 200).sum(axis=1, keepdims=True).astype(float), np.zeros((indices.size, 0)))

    found = optimise(space, distance, evaluations=200)
    assert found.objectives[:, 0].min() < found.objectives[:20, 0].min()


def test_a_search_needs_two_evaluations():
    with pytest.raises(InputError, match="two evaluations or more"):
        optimise(SPACE, Bank(responses(0, 1)), evaluations=1)


# ==== Pareto fronts compared with their definition ===================================================================


def by_definition(values: np.ndarray) -> np.ndarray:
    beaten = [any((other <= row).all() and (other < row).any() for other in values) for row in values]
    return ~np.array(beaten)


@pytest.mark.parametrize("responses", [1, 3])
def test_the_front_agrees_with_its_definition(responses):
    values = np.random.default_rng(responses).integers(0, 6, size=(150, responses)).astype(float)
    np.testing.assert_array_equal(pareto_front(values), by_definition(values))


def test_equal_setups_are_on_the_front_together():
    assert pareto_front(np.array([[1.0, 2.0], [1.0, 2.0], [2.0, 2.0]])).tolist() == [True, True, False]


# ==== Searches of studies: runs of the FMUs, none twice, and constraints =============================================


@pytest.fixture(scope="module")
def exhaustive(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exhaustive")
    return folder, run_study(study(fmus), folder, InProcess())


def test_a_search_runs_the_fmus_as_the_exhaustive_study_does(fmus, exhaustive, tmp_path):
    _, whole = exhaustive
    assert whole.provenance.above_band == {}  # a vehicle of stated parameters has no band
    table, found = search_study(Sweep(study(fmus), tmp_path), InProcess(), COUPLING, Search(evaluations=15))
    assert found.best == whole.setups[whole.ranking()[0]]
    rows = np.searchsorted(whole.setups, table.setups)
    np.testing.assert_array_equal(table.values("front ride height"), whole.values("front ride height")[rows])


def test_a_repeated_search_runs_nothing_again(fmus, tmp_path):
    first, again = InProcess(), InProcess()
    _, found = search_study(Sweep(study(fmus), tmp_path), first, COUPLING, Search(evaluations=8))
    _, repeated = search_study(Sweep(study(fmus), tmp_path), again, COUPLING, Search(evaluations=8))
    assert found.indices[0] == study(fmus).baseline_setup.index
    assert len(first.ran) == len(set(first.ran)) == 8
    assert again.ran == []
    np.testing.assert_array_equal(found.indices, repeated.indices)


def test_ctrl_c_during_a_request_keeps_the_completed_setups(fmus, tmp_path):
    class Interrupted(InProcess):
        def rows(self, study, coupling, chunks, stop):
            yield next(iter(super().rows(study, coupling, chunks, stop)))
            raise KeyboardInterrupt

    made, after = study(fmus), InProcess()
    numbers = made.space.indices.tolist()[:12]
    with pytest.raises(KeyboardInterrupt):
        Sweep(made, tmp_path).request(Interrupted(), COUPLING, numbers)
    found = Sweep(made, tmp_path).request(after, COUPLING, numbers)
    assert after.ran == numbers[8:] and found.setups.tolist() == numbers  # eight setups are a batch


def test_a_search_for_several_measures_gives_the_front_of_the_evaluated_setups(fmus, exhaustive):
    folder, _ = exhaustive
    names = ("total tire force", "front ride height")
    table, found = search_study(Sweep(study(fmus), folder), InProcess(), COUPLING, Search(names, 20))
    values = np.stack([table.values(name) for name in names], axis=1)
    best = [not any((other <= row).all() and (other < row).any() for other in values) for row in values]
    assert found.front.tolist() == table.setups[best].tolist()


def front(digits: np.ndarray) -> np.ndarray:
    return digits.sum(axis=1) - 6.0


def test_scores_have_the_order_of_the_requested_setups():
    made = result({"front": front}, objective=(Term("front", 2.0, "m"),))
    indices = np.array([8, 0, 2400])
    np.testing.assert_allclose(scores_of(made, indices).objectives[:, 0], [2.0 * -4.0, 2.0 * -6.0, 2.0 * 18.0])


def test_a_failed_setup_has_no_objective_and_breaks_every_constraint():
    made = result({"front": front}, failed=(5,), constraints=(Constraint("front", at_most=100.0),))
    scores = scores_of(made, np.array([4, 5]))
    assert np.isfinite(scores.objectives[:, 0]).tolist() == [True, False]
    assert (scores.violations[:, 0] > 0.0).tolist() == [False, True]


# ==== `eightpost optimise`: output, files and exit codes =============================================================

TEXT = """
schema = 1
name = "three builds, front and rear alike"
families = ["numbers"]
settling = "0.5 s"
baseline = "middle"
alike = [["lf", "rf"], ["lr", "rr"]]

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
soft = {{ fmu = "{shock}", parameters = {{ compression_scale = 0.5, rebound_scale = 0.5 }} }}
middle = "{shock}"
stiff = {{ fmu = "{shock}", parameters = {{ compression_scale = 2.0, rebound_scale = 2.0 }} }}

[[drive]]
file = "{track}"
stop = "2 s"

[[objective]]
measure = "grip number"
weight = 1.0
unit = "N"

[[constraint]]
measure = "aero number"
at_most = {limit}
"""


def optimise_command(fmus, folder, *words: str, limit: float = 1.0):
    file = folder / "study.toml"
    file.write_text(TEXT.format(car=fmus["seven_dof"], shock=fmus["lpnl2"], track=TRACK, limit=limit))
    options = ["optimise", str(file), "-o", str(folder / "out"), "--workers", "1", *words]
    return CliRunner(env={"COLUMNS": "160"}).invoke(main, options)


@pytest.mark.nightly
def test_a_search_writes_its_results_and_resumes_with_more_evaluations(fmus, tmp_path, monkeypatch):
    pages = []  # the page takes longer than the search, and is tested elsewhere
    monkeypatch.setattr(StudyFolder, "write_page", lambda *given, **_options: pages.append(given))
    shown = optimise_command(fmus, tmp_path, "--set", "evaluations=4")
    assert shown.exit_code == 0, shown.output
    for text in ("minimised: 1 x grip number", "4 setups were evaluated; the study has 9 setups", "results.parquet"):
        assert text in shown.output
    first = StudyResult.load(tmp_path / "out" / "results.parquet")
    assert len(first) == 4
    assert first.partial
    more = optimise_command(
        fmus, tmp_path, "--set", "evaluations=9", "--for", "grip number", "--for", "aero number", limit=1e-9
    )
    assert more.exit_code == 1, more.output  # no setup keeps the constraint
    assert "every setup was evaluated" in more.output
    whole = StudyResult.load(tmp_path / "out" / "results.parquet")
    assert len(whole) == 9
    assert not whole.partial
    assert len(pages) == 2


def test_an_unknown_measure_is_reported_before_anything_runs(fmus, tmp_path):
    shown = optimise_command(fmus, tmp_path, "--for", "grip nummber")
    assert shown.exit_code == 2
    assert "did you mean 'grip number'" in " ".join(shown.stderr.split())


# ==== Comparison of the search with the bank study of the shipped bank: 2401 setups ==================================

STUDY = Path(__file__).resolve().parents[3] / "examples" / "study.toml"


TRADED = ("front ride height, RMS", "total tire force, RMS", "rf hub acceleration, RMS")


@pytest.fixture(scope="module")
def bank(tmp_path_factory) -> StudyResult:
    folder = tmp_path_factory.mktemp("bank")
    shown = CliRunner().invoke(main, ["study", str(STUDY), "-o", str(folder)])
    assert shown.exit_code == 0, shown.output
    return StudyResult.load(folder / "results.parquet")


@pytest.mark.parametrize("measure", [None, *TRADED, "aero number"])
@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_all_setups_is_found_within_250(bank, measure, seed):
    names = () if measure is None else (measure,)
    found = optimise(bank.study.space, lambda indices: scores_of(bank, indices, names), evaluations=250, seed=seed)
    every = scores_of(bank, bank.setups, names)
    allowed = (every.violations <= 0.0).all(axis=1)
    assert found.best == bank.setups[np.where(allowed, every.objectives[:, 0], np.inf).argmin()]


@pytest.mark.parametrize("measures", [TRADED[:2], TRADED])
@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(3))
def test_the_trade_off_of_all_setups_is_found_within_400(bank, measures, seed):
    found = optimise(bank.study.space, lambda indices: scores_of(bank, indices, measures), evaluations=400, seed=seed)
    every = scores_of(bank, bank.setups, measures).objectives
    worst = every.max(axis=0)
    reached, whole = (moocore.hypervolume(one, ref=worst) for one in (found.objectives[found.allowed], every))
    assert reached > 0.999 * whole
