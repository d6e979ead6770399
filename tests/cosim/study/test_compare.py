"""Comparison of predictions with constructed measurements whose lines, ranks and bands are known."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from cosim.session.result import SavedRun
from cosim.study.choice.certainty import Levels
from cosim.study.choice.compare import Comparison, RunComparison, compare_runs, comparison_verdict, write_and_plot
from cosim.study.choice.rig_day import (
    BASELINE_RUNS,
    Measured,
    comparisons,
    measured_runs,
    read_run_list,
    read_selection,
    select,
    write_selection,
)
from cosim.study.definition import Drive, Term
from cosim.study.measures import Measure
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Verdict
from tests.unchanged import refusals

from .assessed import run
from .constructed import CORNERS, result, study

PREDICTED = np.array([1.0, 2.0, 4.0, 8.0, 16.0])


def comparison(measured: np.ndarray, predicted: np.ndarray = PREDICTED, **fields: object) -> Comparison:
    numbers = np.arange(predicted.size)
    return Comparison("front ride height", numbers, predicted, measured, np.ones_like(numbers), **fields)


def front(digits: np.ndarray) -> np.ndarray:
    return 1.0 + digits @ np.array([4.0, 2.0, 1.0, 0.5])


def record(amplitude: float, *, duration: float = 30.0, start: float = 7.0) -> TimeSeries:
    time = np.arange(0.0, duration + 1e-9, 0.005)
    values = np.sqrt(2.0) * amplitude * np.sin(2.0 * np.pi * 2.0 * time) + 1.0
    values[time < 1.0] = 50.0  # while the rig settles
    return TimeSeries.from_channels(start + time, {"front.ride_height": ("m", values)})


def test_levels_on_a_line_rank_perfectly_and_the_line_is_found():
    found = comparison(0.5 * PREDICTED + 3.0)
    assert (found.spearman, found.kendall) == pytest.approx((1.0, 1.0))
    assert (found.line.slope, found.line.intercept) == pytest.approx((0.5, 3.0))
    assert found.line.slope_error == pytest.approx(0.0, abs=1e-12)


def test_ranks_are_counted_pair_by_pair():
    measured = np.array([2.0, 1.0, 5.0, 3.0, 9.0])
    pairs = list(combinations(range(5), 2))
    right = sum((measured[j] - measured[i]) * (PREDICTED[j] - PREDICTED[i]) > 0 for i, j in pairs)
    assert comparison(measured).kendall == pytest.approx((2 * right - len(pairs)) / len(pairs))
    shifts = np.array([1, -1, 1, -1, 0])  # ranks 2, 1, 4, 3, 5
    assert comparison(measured).spearman == pytest.approx(1.0 - 6.0 * np.sum(shifts**2) / (5 * 24))


@pytest.mark.nightly
def test_the_slopes_confidence_interval_covers_the_truth_at_its_level():
    generator = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        low, high = comparison(0.8 * PREDICTED + generator.normal(size=5)).line.interval(0.9)
        held += low <= 0.8 <= high
    assert held / 1000 == pytest.approx(0.9, abs=0.03)


@pytest.mark.nightly
def test_the_lines_error_is_that_of_its_predicted_levels():
    generator = np.random.default_rng(2)
    lines = [comparison(PREDICTED + generator.normal(size=5)).line for _ in range(2000)]
    at = np.array([0.0, 10.0])
    spread = np.std([line.at(at) for line in lines], axis=0)
    stated = np.sqrt(np.mean([line.error_at(at) ** 2 for line in lines], axis=0))
    np.testing.assert_allclose(stated, spread, rtol=0.06)


def test_the_band_is_two_standard_deviations_of_a_run():
    off = np.array([0.0, 0.5, -1.5, 0.0, 0.0])
    found = comparison(PREDICTED + off, run_to_run=0.5)
    assert found.band == 1.0
    np.testing.assert_array_equal(found.within, np.abs(found.measured - found.line.at(PREDICTED)) <= 1.0)
    assert found.within.sum() == 4


def test_level_errors_are_relative_to_the_measured_level():
    found = comparison(PREDICTED / 1.1)
    assert (found.bias, found.level_error) == pytest.approx((10.0, 10.0))


def test_noise_limits_the_rank_that_even_a_perfect_prediction_reaches():
    close = np.linspace(1.0, 1.1, 8)
    quiet, loud = (comparison(close, close, run_to_run=noise).attainable for noise in (1e-4, 0.05))
    assert quiet == pytest.approx(1.0) and comparison(close, close).attainable == 1.0  # without noise
    assert loud < 0.7
    generator, reached = np.random.default_rng(5), []
    for _ in range(1000):
        reached.append(stats.spearmanr(close, close + 0.05 * generator.normal(size=8)).statistic)
    assert np.mean(np.array(reached) >= loud) == pytest.approx(0.95, abs=0.02)


def test_measures_of_records_are_computed_as_in_the_study(tmp_path):
    made = study(("front",), settling=2.0)
    runs = read_run_list(_list(tmp_path, "file,setup", "a.parquet,5", "b.parquet,6"), made)
    found = measured_runs(runs, made, lambda path: record(0.003 if path.name == "a.parquet" else 0.004))
    assert found.setups.tolist() == [5, 6]
    np.testing.assert_allclose(found.values["front"], [0.003, 0.004], rtol=1e-3)


def test_a_measure_whose_channels_the_rig_lacks_is_reported_as_missing(tmp_path):
    made = study(("front",))
    made = replace(made, measures=(*made.measures, Measure("driver", ("car.driver.acceleration",))))
    runs = read_run_list(_list(tmp_path, "file,setup", "a.parquet,5"), made)
    found = measured_runs(runs, made, lambda _: record(0.003))
    assert found.missing == {"driver": "the records lack driver.acceleration"}


def test_repeated_runs_are_averaged_and_give_the_run_to_run_deviation():
    made = result({"front": front})
    setups = np.array([0, 0, 0, 100, 100, 2000])
    values = {"front": np.array([1.0, 2.0, 3.0, 5.0, 7.0, 9.0])}
    (found,) = comparisons(made, Measured(setups, values, {}))
    assert found.measured.tolist() == [2.0, 6.0, 9.0]
    assert found.runs.tolist() == [3, 2, 1]
    assert found.run_to_run == pytest.approx(np.sqrt((2.0 + 2.0) / 3.0))


@pytest.mark.nightly
def test_the_interval_of_a_rig_run_covers_it_at_its_level_however_few_the_repeats():
    """True levels are known here, so that the intervals contain run-to-run noise only; two runs of one setup."""
    generator, inside = np.random.default_rng(3), []
    for _ in range(2000):
        first, second, *others = PREDICTED[[0, 0, 1, 2, 3, 4]] + 0.1 * generator.standard_normal(6)
        measured = np.array([0.5 * (first + second), *others])
        known = np.stack([PREDICTED, PREDICTED])
        runs = np.array([2, 1, 1, 1, 1])
        noise = abs(first - second) / np.sqrt(2.0)
        inside.append(Comparison("m", np.arange(5), PREDICTED, measured, runs, noise, known).inside[1:])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_the_interval_of_a_rig_run_contains_that_of_the_true_level():
    known = np.stack([PREDICTED - 0.3, PREDICTED + 0.3])
    known[:, 4] = np.nan
    measured, runs = PREDICTED + np.array([0.2, 0.4, -0.2, -0.4, 0.0]), np.array([2, 1, 1, 1, 1])
    found = Comparison("m", np.arange(5), PREDICTED, measured, runs, 1e-6, known)
    assert (found.inside.tolist(), found.judged) == ([True, False, True, False, False], 4)
    assert comparison(PREDICTED, true=known).judged == 0  # the run-to-run deviation is not known


@pytest.mark.parametrize(
    "lines", [("file,setup", "a.parquet,9"), ("file,lf,rf,lr,rr", "a.parquet,AA/AA,AA/AA,AA/B,B/AA")]
)
def test_a_setup_is_named_by_its_number_or_its_builds(tmp_path, lines):
    (run,) = read_run_list(_list(tmp_path, "# rig day", *lines), study(("front",)))
    assert (run.setup, run.file, run.drive) == (9, tmp_path / "a.parquet", "lap")


def test_a_list_for_two_drives_names_the_drive(tmp_path):
    drives = tuple(Drive(name, tmp_path / "lap.parquet", 30.0) for name in ("dry", "wet"))
    lines = ("file,setup,drive", "a.parquet,1,wet", "a.parquet,1,")
    runs = read_run_list(_list(tmp_path, *lines), study(("front",), drives=drives))
    assert [run.drive for run in runs] == ["wet", "dry"]


def test_the_selection_file_is_read_as_a_list_of_runs(tmp_path):
    made = result({"front": front}, baseline=dict.fromkeys(CORNERS, "B/B"))
    selection = select(made, total=8)
    write_selection(selection, made, tmp_path / "selection.csv")
    runs = read_run_list(tmp_path / "selection.csv", made.study)
    baseline, chosen = made.study.baseline_setup.index, [s.setup.index for s in selection.chosen]
    extreme = [chosen[0], chosen[4]]  # the lowest and the highest one
    assert [run.setup for run in runs] == chosen + extreme + BASELINE_RUNS * [baseline]
    assert runs[0].file == tmp_path / "run_01.parquet"
    assert read_selection(tmp_path / "selection.csv", made) == selection


def _list(folder, *lines: str):
    path = folder / "runs.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_the_attainable_rank_accounts_for_averaged_runs():
    one, four = (
        Comparison("m", np.arange(5), PREDICTED, PREDICTED + 0.1, np.full(5, runs), run_to_run=noise).attainable
        for runs, noise in ((1, 2.0), (4, 4.0))
    )
    assert one == four < 1.0


# ---- Verdicts -------------------------------------------------------------------------------------------------------


def test_a_prediction_is_usable_if_every_measure_is_within_its_limits_and_states_the_worst():
    good, worse = comparison(PREDICTED / 1.1), comparison(np.array([2.0, 1.0, 4.0, 8.0, 16.0]))
    (reason,) = comparison_verdict([good, worse], rank=0.85, level=None).reasons
    assert reason.grade is Grade.USABLE and reason.figure == "rank correlation 0.900 or more; limit 0.85"
    (reason,) = comparison_verdict([good], rank=0.99, level=10.5).reasons
    assert reason.figure == "rank correlation 1.000 or more; limit 0.99; level errors up to 10.0 %"


def test_a_prediction_of_wrong_ranks_or_levels_is_not_usable_and_names_the_figure():
    found = comparison_verdict([comparison(PREDICTED[::-1])], rank=0.9, level=5.0)
    assert [reason.grade for reason in found.reasons] == [Grade.NOT_USABLE] * 2
    assert found.reasons[0].figure == "rank correlation -1.000; limit 0.9"
    assert found.reasons[1].figure.endswith(" %; limit 5 %")
    noisy = comparison(np.array([2.0, 1.0, 4.0, 8.0, 16.0]), run_to_run=30.0)
    (reason,) = comparison_verdict([noisy], rank=0.95, level=None).reasons
    assert reason.figure.endswith("limit 0.95; run-to-run noise alone can explain this")


def test_the_verdict_on_runs_is_that_of_each_run_with_its_folder():
    good = comparison_verdict([comparison(PREDICTED)], rank=0.9, level=None)
    series = TimeSeries.from_channels(np.arange(3.0), {"x": ("m", np.arange(3.0))})
    saved = {label: SavedRun(series, verdict, ("x",), "") for label, verdict in (("a", good), ("b", Verdict()))}
    assert {(one.grade, one.origin) for one in compare_runs(saved).verdict.reasons} == {
        (Grade.USABLE, "a: front ride height"),
        (Grade.UNKNOWN, "b: result.json"),
    }


def test_runs_are_compared_by_the_change_of_each_measure_from_the_first_run():
    time = np.arange(0.0, 10.0, 0.01)
    wave = np.sin(2.0 * np.pi * time)
    runs = {
        label: TimeSeries.from_channels(time, {"a": ("m", scale * wave), "b": ("N", wave), "still": ("m", 0.0 * wave)})
        for label, scale in (("first", 1.0), ("second", 2.0), ("last", 0.5))
    }
    measures = tuple(Measure(name, (name,), display=unit) for name, unit in (("a", "in"), ("b", "N"), ("still", "m")))
    found = RunComparison(runs, measures, Verdict())
    assert [found.change(measure) for measure in measures] == [pytest.approx(-50.0), pytest.approx(0.0), None]
    table = found.to_pandas()
    assert table.loc["a"].tolist()[0] == "in" and table.loc["b", "change"] == pytest.approx(0.0)
    assert table.loc["a", "last"] == pytest.approx(np.sqrt(0.5) * 0.5 / 0.0254)
    text = repr(found)
    assert "Comparison of 3 runs" in text and text.index("-50.00 %") < text.index("+0.00 %")


# ---- Intervals and files --------------------------------------------------------------------------------------------


def test_the_interval_of_a_setup_is_unknown_once_the_certainty_contains_its_rig_run():
    expected = np.array([1.0, 2.0, 4.0])
    levels = Levels(expected, np.full((3, 3), 0.1), np.full(3, np.nan), relative=False, basis="stated", run_to_run=0.01)
    certainty = SimpleNamespace(runs=(run(2, front=1.6),), row=int, levels={"front": levels})
    made = result({"front": front}, builds=("B/B", "C/C"))
    rig = Measured(np.array([0, 1, 2]), {"front": np.array([1.0, 1.6, 2.0])}, {})
    (found,) = comparisons(made, rig, certainty)
    np.testing.assert_allclose(found.true, [[0.9, 1.9, np.nan], [1.1, 2.1, np.nan]])


@pytest.fixture
def drawn(monkeypatch):
    """List of the figures that are saved."""
    figures = []
    monkeypatch.setattr("eightpost.report.pictures.save", lambda figure, path: figures.append(figure))
    return figures


@pytest.mark.parametrize(("objective", "selected", "shown"), [
    ((), {"rear": [5]}, ["rear [in]"]), ((Term("front", 1.0, "in"),), {}, ["front [in]"]),
    ((), {}, ["front [in]", "rear [in]"]),
])  # fmt: skip
def test_the_picture_shows_the_selected_measures_those_of_the_objective_or_all(
    tmp_path, drawn, objective, selected, shown
):
    made = result({"front": front, "rear": front}, builds=("B/B", "C/C"), objective=objective)
    levels = np.array([1.0, 5.0, 9.0])
    found = comparisons(made, Measured(np.array([0, 5, 15]), {"front": levels, "rear": levels}, {}))
    write_and_plot(found, made, tmp_path, Verdict(), selected)
    assert [axes.get_ylabel() for axes in drawn[0].axes[::2]] == shown


def test_runs_and_levels_that_cannot_be_compared_are_refused(tmp_path, unchanged):
    made, some = study(("front",)), result({"front": front}, kept=np.arange(10))
    comparison(PREDICTED[:3], PREDICTED[:3])

    def measured():
        runs = read_run_list(_list(tmp_path, "file,setup", "a.parquet,5"), made)
        return measured_runs(runs, made, lambda _: record(0.003, duration=20.0))

    lists = {
        "no record": ("setup", "5"), "no number": ("file,setup", "a.parquet,front"),
        "no such setup": ("file,setup", "a.parquet,1", "", "b.parquet,2401"),
        "no such build": ("file,lf,rf,lr,rr", "a.parquet,AA/AA,C/D,B/B,B/B"),
        "another number": ("file,setup,lf,rf,lr,rr", "a.parquet,1,AA/AA,AA/AA,AA/AA,AA/AA"),
        "no such drive": ("file,setup,drive", "a.parquet,1,wet"),
    }  # fmt: skip
    unchanged(refusals({
        **{name: lambda rows=rows: read_run_list(_list(tmp_path, *rows), made) for name, rows in lists.items()},
        "a short record": measured, "equal levels": lambda: comparison(np.full(5, 2.0)).spearman,
        "a setup that was not run": lambda: comparisons(some, Measured(np.array([1, 2, 11]), {"front": np.arange(3.0)},
                                                                       {})),
        "other setups": lambda: Comparison("m", np.arange(5), PREDICTED, PREDICTED[:4], np.ones(5, dtype=int)),
        "two setups": lambda: comparison(PREDICTED[:2], PREDICTED[:2]),
    }))  # fmt: skip
