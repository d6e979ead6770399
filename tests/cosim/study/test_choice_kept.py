"""Choices of constructed studies, kept number by number: sensitivities, selections, comparisons, searches, draws."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from cosim.study.choice.assess import Knowledge, certainty_of, posterior_of
from cosim.study.choice.compare import Comparison, changes, compare_runs, comparison_verdict, write_and_plot
from cosim.study.choice.optimise import Optimum, Search, objectives_in_words, violation
from cosim.study.choice.rig_day import Measured, comparisons, repeated, select, write_selection
from cosim.study.choice.robust import Uncertain, drawn_studies, leading, read_uncertainty
from cosim.study.choice.sensitivity import sensitivities_of, write_terms
from cosim.study.choice.shape_search import DrawnCar, Problem, Range, Robustness, ShockSpace, VehicleDraws, band, search
from cosim.study.definition import Build, Constraint, Term
from cosim.study.measures import Measure
from cosim.study.running.evaluator import Coupling
from cosim.study.running.sweep import Trials
from cosim.study.table import StudyResult, error_column
from eightpost.corners import CORNERS
from eightpost.files import json_content
from eightpost.signals import TimeSeries
from tests.drawn import drawn
from tests.unchanged import refusals

from .assessed import assessed, lag
from .constructed import result

Unchanged = Callable[..., None]

BUILDS = ("A", "B", "C")


def a(digits: np.ndarray) -> np.ndarray:
    return 2.0 + 0.1 * (digits[:, 0] - 1.0) ** 2 + 0.03 * digits[:, 1] * digits[:, 2] - 0.05 * digits[:, 3]


def b(digits: np.ndarray) -> np.ndarray:
    return 1.0 + 0.02 * digits[:, 0] + 0.1 * digits[:, 2] - 0.01 * digits[:, 3] ** 2


def study(**fields: object) -> StudyResult:
    given = {"builds": BUILDS, "baseline": dict.fromkeys(CORNERS, "B"), "objective": (Term("a", 1.0, "in"),)}
    return result({"a": a, "b": b}, failed=(17,), marks={5: "a mark", 70: "other"}, **given | fields)


def test_sensitivities_are_unchanged(tmp_path: Path, unchanged: Unchanged) -> None:
    found = {
        "fitted": sensitivities_of(study()),
        "main effects": sensitivities_of(result({"a": a}, builds=BUILDS, kept=np.arange(0, 81, 4))),
        "alike": sensitivities_of(result({"a": a}, builds=BUILDS, alike=(("lf", "rf"),))),
    }
    unchanged({
        name: [f"{one.measure} {one.method} {one.setups} {one.mean:.8g} {one.rest:.8g} {one.variance:.8g} "
               + " ".join(f"{f.name} {one.share(f.name):.8g} {one.total(f.name):.8g}" for f in one.factors)
               for one in ones]
        for name, ones in found.items()
    })  # fmt: skip
    write_terms(found["alike"], {"a": "m"}, tmp_path / "terms.parquet")
    rows = pyarrow.parquet.read_table(tmp_path / "terms.parquet").to_pylist()
    values = [[f"{value:.8g}" if isinstance(value, float) else value for value in row.values()] for row in rows]
    unchanged([" ".join(row) for row in values], "terms")


@pytest.mark.parametrize(("name", "options"), [
    ("objective", {"total": 12}), ("two_measures", {"measures": ("a", "b"), "total": 14, "pool": 0.2}),
    ("odd", {"measures": ("b", "a"), "total": 11}), ("shares", {"share": {"b": 3, "a": 1}}),
], ids=["objective", "two_measures", "odd", "shares"])  # fmt: skip
def test_a_selection_and_its_list_are_unchanged(
    name: str, options: dict[str, object], tmp_path: Path, unchanged: Unchanged
) -> None:
    made = study(constraints=(Constraint("b", at_most=1.2),))
    known = certainty_of(made) if name == "two_measures" else None
    found = select(made, certainty=known, **options)
    write_selection(found, made, tmp_path / "selection.csv", twice=3)
    rows = list(csv.reader((tmp_path / "selection.csv").read_text(encoding="utf-8").splitlines()))
    unchanged({"closest": found.closest, "repeated": repeated(found), "list": [" | ".join(row) for row in rows]})


@pytest.fixture
def compared() -> tuple[StudyResult, tuple[Comparison, ...]]:
    """Return a study and its comparison with 12 rig runs of 9 setups."""
    made = assessed({"a": a, "b": b}, (0.01, 0.2), builds=BUILDS)
    setups = np.array([0, 0, 5, 9, 12, 12, 30, 41, 55, 61, 77, 77])
    noise = 1.0 + 0.02 * np.random.default_rng(3).standard_normal((2, setups.size))
    values = {name: made.values(name)[setups] * one for name, one in zip("ab", noise, strict=True)}
    known = certainty_of(made, Knowledge((lag("C", 0.01, 0.0),)), draws=128)
    return made, comparisons(made, Measured(setups, values, {}), known)


def test_a_comparison_with_the_rig_is_unchanged(
    compared: tuple[StudyResult, tuple[Comparison, ...]],
    tmp_path: Path,
    unchanged: Unchanged,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, found = compared
    figures = []
    monkeypatch.setattr("eightpost.report.pictures.save", lambda figure, path: figures.append(figure))
    verdict = comparison_verdict(found, rank=0.9, level=1.0)
    write_and_plot(found, made, tmp_path, verdict, {"a": [0, 5]})
    (first, second) = json_content(tmp_path / "comparison.json")["measures"]
    unchanged({key: np.array(value) if isinstance(value, list) else value for key, value in first.items()})
    unchanged({key: second[key] for key in ("spearman", "slope", "judged", "bias_percent")}, "second")
    unchanged({"figure": drawn(figures[0]), "reasons": list(map(str, verdict.reasons))}, "figure")


def test_the_picture_of_a_comparison_of_runs_is_unchanged(unchanged: Unchanged) -> None:
    time = np.arange(0.0, 4.0, 0.01)
    runs = {name: TimeSeries.from_channels(time, {"x": ("m", scale * np.sin(9.0 * time)), "y": ("N", time * scale),
                                                  "z": ("N", 0.0 * time)})
            for name, scale in {"first": 1.0, "second": 1.25, "third": 0.5}.items()}  # fmt: skip
    measures = tuple(Measure(name, (name,)) for name in "xyz")
    unchanged(drawn(changes(runs, measures)))


@pytest.mark.parametrize(("limits", "value", "expected"), [
    ({"at_most": 2.0}, 3.0, 0.5), ({"at_most": -2.0}, -1.0, 0.5), ({"at_most": 0.0}, 0.25, 0.25),
    ({"at_least": 4.0}, 3.0, 0.25), ({"at_least": 0.0}, -0.5, 0.5), ({"at_most": 2.0}, 2.0, 0.0),
    ({}, 1.0, -1.0), ({"at_least": 1.0, "at_most": 2.0}, 1.5, -0.25), ({"at_most": 2.0}, np.nan, np.inf),
])  # fmt: skip
def test_a_violation_is_a_share_of_its_limit(limits: dict[str, float], value: float, expected: float) -> None:
    assert violation(np.array([value]), Constraint("a", **limits)).tolist() == [expected]


def test_the_best_of_several_setups_is_the_allowed_one_with_the_lowest_number_of_equals() -> None:
    values = np.array([[1.0], [0.0], [0.0], [-1.0], [np.nan]])
    broken = np.array([[0.0], [0.0], [-1.0], [1e-9], [0.0]])
    found = Optimum(np.array([4, 9, 2, 1, 0]), values, broken, 0, "")
    assert (found.best, found.front.tolist()) == (2, [2, 9])


def test_what_a_search_minimises_is_said_in_words() -> None:
    one = study(objective=(Term("a", 2.0, "in"), Term("b", -0.5, "m"))).study
    plain = study(objective=()).study
    said = [objectives_in_words(*pair) for pair in ((one, Search()), (plain, Search()), (one, Search(("b",))),
                                                    (one, Search(("a", "b"))))]  # fmt: skip
    assert said == ["2 x a [in] + -0.5 x b [m]", "a", "b", "the trade-off between a, b"]


# ---- Continuous search ----------------------------------------------------------------------------------------------


@dataclass
class CurvedRuns:
    """Workers whose measures are known functions of two numbers of the shocks at each corner."""

    count: int = 2

    def rows(self, study, coupling, chunks, stop):
        for chunk in chunks:
            yield chunk, [self.row(study, study.space.setup(index)) for index in chunk.indices]

    def row(self, study, setup):
        shocks = [study.bank[setup.builds[corner]].parameters for corner in study.corners]
        scale, lag_time = (np.array([one[name] for one in shocks]) for name in ("scale", "lag"))
        levels = {
            "a": float(2.0 + 0.2 * np.sum((scale - [1.6, 1.6, 2.2, 2.2]) ** 2) + 0.5 * np.sum(lag_time**2)),
            "b": float(1.0 + 0.1 * np.sum(scale) + 0.05 * lag_time[0]),
        }
        words = {"status": "done", "message": "", "marks": "", "seconds": 1.0, "setup": setup.index, **setup.builds}
        return {**words, **levels, **dict.fromkeys(map(error_column, levels), 1e-3)}


SHOCKS = ShockSpace((("lf", "rf"), ("lr", "rr")), (Range("scale", 0.5, 4.0, 0.05), Range("lag", -1.0, 1.0)),
                    lambda _group, numbers: Build("shock.fmu", numbers))  # fmt: skip


@pytest.mark.parametrize(("robustness", "limit", "car"), [
    (Robustness(), np.inf, False), (Robustness(), 1.6, False),
    (Robustness(8, 2.0, 1), np.inf, False), (Robustness(2, 1.0), 1.65, True),
], ids=["exact", "limited", "tolerances", "cars"])  # fmt: skip
def test_a_continuous_search_is_unchanged(
    robustness: Robustness, limit: float, car: bool, unchanged: Unchanged
) -> None:
    limits = (Constraint("b", at_most=limit),) if np.isfinite(limit) else ()
    bank = {one: Build("shock.fmu", {"scale": 1.0 + k, "lag": 0.1}) for k, one in enumerate(BUILDS)}
    made = assessed({"a": a, "b": b}, (0.02, 0.3), builds=BUILDS, bank=bank, constraints=limits)
    drawn = None
    if car:
        draws = VehicleDraws.of(made, posterior_of(made, Knowledge()))
        assert draws is not None
        drawn = DrawnCar.of(made, draws, "a", 12)
        levels = np.array([[2.0, 1.1], [2.4, 1.3]])
        unchanged({"common": draws.common, "own": draws.own, "objectives": drawn.objectives(levels),
                   "limited": list(drawn.limited(levels)), "known": drawn.is_known}, "draws")  # fmt: skip
    trials = Trials(made.study, {"a": "m", "b": "m"}, CurvedRuns(), Coupling("gauss-seidel", 1e-3))
    problem = Problem(trials, SHOCKS, robustness, "a", drawn)
    points = np.array([[0.1, 0.2, 0.8, 0.9], [0.5, 0.5, 0.5, 0.5]])
    unchanged({"evaluation": problem.evaluate(points)._asdict(), "drawn": problem.drawn(points)}, "evaluation")
    found = search(problem, [points[0]], iterations=4)
    kept = band(problem, found, 3.5, share=0.9)
    unchanged({"optimum": replace(found, runs=0, status=()), "size": kept.size, "kept": kept.kept, "alone": kept.alone,
               "points": kept.points}, "found", relative=1e-3)  # fmt: skip


# ---- Draws ----------------------------------------------------------------------------------------------------------

UNCERTAIN = """schema = 1
runs = 3
vehicles = ["other.fmu"]
[run_to_run]
a = "0.1 in"
b = 0.002
[[uncertain]]
part = "B"
correlation = [[1.0, 0.5], [0.5, 1.0]]
[uncertain.parameters]
scale = {value = 1.0, deviation = 0.1, lowest = 0.95}
lag = {value = 0.01, deviation = 0.002}
[[uncertain]]
part = "car"
[uncertain.parameters]
mass = {value = 1000.0, deviation = 10.0, highest = 1001.0}
[fits]
C = "c.json"
"""


def test_an_uncertainty_file_and_its_draws_are_unchanged(tmp_path: Path, unchanged: Unchanged) -> None:
    made = study()
    path = tmp_path / "uncertain.toml"
    path.write_text(UNCERTAIN)
    found = read_uncertainty(path, made)
    drawn = drawn_studies(made.study, found.parts, draws=5, seed=2, vehicles=found.vehicles)
    unchanged({"parts": found.parts, "noise": found.run_to_run, "runs": found.runs, "any": found.any,
               "files": [one.name for one in (*found.vehicles, *found.fits.values())],
               "draws": [{**one.bank["B"].parameters, **one.vehicle.parameters, "fmu": one.vehicle.fmu.name}
                         for one in drawn]})  # fmt: skip
    assert leading(made, 3).tolist() == sorted({*made.setups[made.ranking()[:3]].tolist(), 40})


def test_choices_that_cannot_be_made_are_refused(unchanged: Unchanged) -> None:
    part = Uncertain("B", ("scale",), np.ones(1), np.eye(1))
    ranges = ((1.0, 1.0), (1.0, 2.0, 1.0), (1.0, 2.0, -0.1))
    assert Range("scale", 1.0, 1.1, 0.999).by_factors and not Range("scale", 0.0, 1.1).by_factors
    assert Robustness(2, 0.0).draws == 2
    unchanged(refusals({
        **{f"range {one}": partial(Range, "scale", *one) for one in ranges},
        **{f"robustness {one}": partial(Robustness, *one) for one in ((1, 1.0), (-1, 1.0), (2, -0.1))},
        "a single draw": lambda: drawn_studies(study().study, [part], draws=1),
        "an unknown part": lambda: drawn_studies(study().study, [replace(part, part="D")], draws=2),
        "a single run": lambda: compare_runs({"first": None}),  # type: ignore[dict-item]
    }))  # fmt: skip
