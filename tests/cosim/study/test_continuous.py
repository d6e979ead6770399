"""Continuous search: analytic optima, robust ones, bands, and trials that are runs of the study."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.study import Build
from cosim.study.choice.sensitivity import MeasureChange, what_if
from cosim.study.choice.shape_search import Evaluation, Problem, Range, Robustness, ShockSpace, band, groups_of, search
from cosim.study.definition import Constraint, Term
from cosim.study.running.evaluator import Coupling
from cosim.study.running.sweep import Sweep, Trials
from cosim.study.table import error_column
from tests.unchanged import refusals

from .constructed import CORNERS, result

SPACE = ShockSpace((("front",), ("rear",)), (Range("a", 1.0, 100.0, 0.1), Range("b", -1.0, 1.0)), lambda *_: Build("x"))


@dataclass
class Analytic:
    """A problem without runs: a function of points (K, n), and a constraint that is met where it is negative."""

    function: object
    constraint: object = None
    space: ShockSpace = SPACE
    trials: SimpleNamespace = field(init=False)

    def __post_init__(self):
        self.trials = SimpleNamespace(count=0, study=SimpleNamespace(constraints=(self.constraint,) * bool(
            self.constraint)))  # fmt: skip

    def evaluate(self, points):
        self.trials.count += len(points)
        values = self.function(points)
        kept = self.constraint(points)[:, None] if self.constraint else np.empty((len(points), 0))
        return Evaluation(values, kept, values, np.zeros(len(points)), values)


@settings(max_examples=20)
@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_the_minimum_of_a_bowl_is_found_also_at_the_edge_of_the_range(center):
    bowl = Analytic(lambda points: 5.0 + ((points - center) ** 2 @ np.array([1.0, 2.0, 3.0, 4.0])))
    found = search(bowl, [np.full(4, 0.5)])
    assert found.allowed and found.objective == pytest.approx(5.0, abs=2e-3)


def test_a_flat_bowl_whose_gain_is_a_small_share_of_the_objective_is_searched_too():
    bowl = Analytic(lambda points: 400.0 + ((points - 0.9) ** 2).sum(axis=1))
    found = search(bowl, [np.full(4, 0.4)])
    assert found.objective - 400.0 < 0.05  # of a gain of 1, which is 0.25 % of the objective


def test_a_constraint_holds_at_the_optimum():
    bowl = Analytic(lambda points: 5.0 + ((points - 0.8) ** 2).sum(axis=1), lambda points: points[:, 0] - 0.3)
    found = search(bowl, [np.full(4, 0.1), np.full(4, 0.9)])
    assert found.allowed and found.point[0] == pytest.approx(0.3, abs=0.01)
    assert found.objective == pytest.approx(5.25, abs=0.01) and len(found.starts) == 2


def test_failed_runs_do_not_end_a_search():
    def function(points):
        values = 5.0 + ((points - 0.6) ** 2).sum(axis=1)
        return np.where(points[:, 0] > 0.9, np.nan, values)

    found = search(Analytic(function), [np.full(4, 0.2)])
    assert found.objective == pytest.approx(5.0, abs=2e-3)


def test_the_band_is_as_wide_as_the_gain_allows():
    cliff = Analytic(lambda points: 5.0 + 100.0 * (points[:, 0] - 0.5) ** 2)
    optimum = search(cliff, [np.full(4, 0.3)])
    kept = band(cliff, optimum, 6.0, share=0.7)  # 0.3 of the gain of 1 is lost at a distance of 0.055
    assert kept.size == 0.05 and kept.kept >= 0.95
    assert kept.alone[0] == pytest.approx([0.45, 0.55], abs=0.005)
    assert kept.alone[1] == pytest.approx([0.0, 1.0])


def test_a_gain_that_no_box_keeps_has_a_band_of_size_zero_without_points():
    spike = Analytic(lambda points: 5.0 + (points != 0.5).any(axis=1))
    optimum = search(spike, [np.full(4, 0.5)])
    none = band(spike, optimum, 6.0)
    assert (optimum.objective, none.size, none.kept, none.points.shape) == (5.0, 0.0, 0.0, (0, 4))
    assert (none.alone == 0.5).all()


@given(st.floats(1.0, 100.0), st.floats(-1.0, 1.0))
def test_points_are_values_within_the_ranges_and_back(a, b):
    point = SPACE.point([{"a": a, "b": b}, {"a": 1e9, "b": -1e9}])
    front, rear = SPACE.numbers(SPACE.values(point[None])[0])
    assert front == pytest.approx({"a": a, "b": b}) and rear == pytest.approx({"a": 100.0, "b": -1.0})


def test_the_tolerance_acts_on_the_numbers_that_have_one_and_is_the_same_for_every_point():
    factors = Robustness(50, seed=3).factors(SPACE)
    assert (factors[0] == 1.0).all() and (factors[..., 1] == 1.0).all()
    assert np.log(factors[1:, :, 0]).std() == pytest.approx(0.1, rel=0.1)
    assert (Robustness(50, seed=3).factors(SPACE) == factors).all()
    assert (Robustness().factors(SPACE) == np.ones((1, 2, 2))).all()


def scaled(study, *scales):
    fmu = study.bank["stiff"].fmu
    return [dict.fromkeys(study.corners, Build(fmu, {"rebound_scale": scale})) for scale in scales]


@dataclass
class LinearRuns:
    """Workers whose two measures [m] are sums of the scales at the corners, with 1 mm of coupling error."""

    count: int = 2
    chunks: list = field(default_factory=list)

    def rows(self, study, coupling, chunks, stop):
        assert (coupling.scheme, coupling.step, stop()) == ("gauss-seidel", 1e-3, False)
        self.chunks += chunks
        for chunk in reversed(chunks):
            yield chunk, [self.row(study, study.space.setup(index)) for index in chunk.indices]

    def row(self, study, setup):
        scales = [study.bank[setup.builds[corner]].parameters["scale"] for corner in study.corners]
        done = {"status": "failed" if min(scales) < 0.0 else "done", "message": "too soft", "marks": "", "seconds": 1.0}
        levels = {"a": sum(scales), "b": 10.0 * scales[0]}
        return {
            "setup": setup.index,
            **setup.builds,
            **done,
            **levels,
            **dict.fromkeys(map(error_column, levels), -1e-3),
        }


UNITS = {"a": "m", "b": "m"}


@pytest.fixture
def linear():
    """A study of linear runs: `low` has a scale of 1, `high` of 2; the objective is 2 a [in] - b [m]."""
    bank = {name: Build("shock.fmu", {"scale": scale}) for name, scale in (("low", 1.0), ("high", 2.0))}
    found = result(
        {"a": lambda digits: 4.0 + digits.sum(axis=1), "b": lambda digits: 10.0 + 10.0 * digits[:, 0]},
        builds=tuple(bank),
        bank=bank,
        objective=(Term("a", 2.0, "in"), Term("b", -1.0, "m")),
    )
    coupling = {"scheme": "gauss-seidel", "step": 1e-3}
    return replace(found, provenance=replace(found.provenance, settings={"coupling": coupling}))


INCH = 0.0254


def test_a_change_at_a_corner_moves_every_measure_by_its_slope_in_displayed_units(linear):
    objective, a, b = what_if(linear, LinearRuns(), {"lr": {"scale": 1.5}}, setup=0)
    assert [one.measure for one in (objective, a, b)] == ["objective", "a", "b"] and (a.unit, b.unit) == ("in", "in")
    assert (a.before, a.change) == pytest.approx((4.0 / INCH, 0.5 / INCH)) and a.is_clear
    assert (a.relative, a.noise) == pytest.approx((0.5 / 4.0, 1e-3 / INCH))
    assert (b.before, b.change) == pytest.approx((10.0 / INCH, 0.0)) and not b.is_clear
    assert objective.change == pytest.approx(2.0 * 0.5 / INCH)
    assert objective.noise == pytest.approx(2.0 * 1e-3 / INCH + 1e-3)


def test_a_change_may_be_compared_with_a_run_that_is_not_a_setup_of_the_study(linear):
    _, a, _ = what_if(linear, LinearRuns(), {"lr": {"scale": 1.5}}, setup=0, before={"rf": {"scale": 7.0}})
    assert (a.before * INCH, a.after * INCH) == pytest.approx((10.0, 10.5))


def test_the_change_is_to_the_baseline_or_without_one_to_the_best_setup(linear):
    def before(found):
        return INCH * what_if(found, LinearRuns(), {"lr": {"scale": 1.5}})[1].before

    assert before(linear) == pytest.approx(4.0)
    high = replace(linear, study=replace(linear.study, baseline=dict.fromkeys(CORNERS, "high")))
    assert before(high) == pytest.approx(8.0)


def test_a_change_is_clear_only_beyond_a_known_noise():
    assert [MeasureChange("a", "", 1.0, 2.0, noise).is_clear for noise in (0.9, 1.0, np.nan)] == [True, False, True]
    assert np.isnan(MeasureChange("a", "", 0.0, 1.0, 0.0).relative)


def test_trials_are_rows_in_their_order_and_shared_among_the_workers_in_two_chunks_each(linear):
    workers = LinearRuns()
    here = Trials(linear.study, UNITS, workers, Coupling("gauss-seidel", 1e-3))
    scales = [3.0, 1.0, 2.0, 5.0, 4.0]
    found = here.run([dict.fromkeys(CORNERS, Build("shock.fmu", {"scale": scale})) for scale in scales])
    assert found.values("b").tolist() == [10.0 * scale for scale in scales]
    assert [len(chunk.indices) for chunk in workers.chunks] == [2, 2, 1] and here.count == 5
    assert [chunk.number for chunk in workers.chunks] == [0, 1, 2]


def test_the_robust_objective_is_mean_and_scatter_of_the_drawn_shocks(linear):
    space = ShockSpace((("lf", "rf"), ("lr", "rr")), (Range("scale", 1.0, 3.0, 0.1),),
                       lambda _group, numbers: Build("shock.fmu", numbers))  # fmt: skip
    here = Trials(linear.study, UNITS, LinearRuns(), Coupling("gauss-seidel", 1e-3))
    points, robust = np.array([[0.1, 0.9], [0.5, 0.5]]), Robustness(20, 2.0)
    exact, found = (Problem(here, space, one, "a").evaluate(points) for one in (Robustness(), robust))
    scales = space.values(points)[:, None] * robust.factors(space)  # (K, 1 + S, groups, 1)
    levels = 2.0 * scales.sum(axis=(2, 3))  # of a: each group has two corners
    assert exact.objective == pytest.approx(levels[:, 0]) and exact.scatter.tolist() == [0.0, 0.0]
    assert found.nominal == pytest.approx(levels[:, 0])
    assert found.scatter == pytest.approx(levels.std(axis=1, ddof=1))
    assert found.objective == pytest.approx(levels.mean(axis=1) + 2.0 * levels.std(axis=1, ddof=1))
    assert found.assured == pytest.approx(np.quantile(levels, 0.95, axis=1))


@pytest.mark.nightly
def test_a_trial_is_the_run_of_the_study_to_the_bit_whatever_ran_before(small_study, here, tmp_path):
    study = small_study(alike=(("lf", "rf"), ("lr", "rr")))
    requested = Sweep(study, tmp_path)
    coupling = requested.coupling(here)
    known = requested.request(here, coupling, study.space.indices.tolist())
    assert groups_of(study) == (("lf", "rf"), ("lr", "rr"))
    trials = Trials(study, requested.units, here, coupling)
    rows = [known.row(dict.fromkeys(study.corners, name)) for name in study.bank]
    other, *_ = scaled(study, 2.0)
    found = trials.run([other, *(dict.fromkeys(study.corners, build) for build in study.bank.values()), other])
    for measure in study.measures:
        values = found.values(measure.name)
        assert values[1:3].tolist() == known.values(measure.name)[rows].tolist()
        assert values[0] == values[3] != values[2]
    stiff, soft = (dict.fromkeys(study.corners, name) for name in ("stiff", "soft"))
    changes = dict.fromkeys(study.corners, study.bank["soft"].parameters)
    for effect in what_if(known, here, changes, setup=study.space.find(stiff).index):
        shown = known.shown(effect.measure)
        assert effect.change == shown[known.row(soft)] - shown[known.row(stiff)]


def test_changes_trials_and_bands_that_cannot_be_are_refused_by_name(linear, unchanged):
    none = replace(linear, study=replace(linear.study, constraints=(Constraint("a", at_most=1.0),)))
    here = Trials(linear.study, UNITS, LinearRuns(), Coupling("gauss-seidel", 1e-3))
    bowl = Analytic(lambda points: 5.0 + points[:, 0] ** 2)

    def changed(changes, before=None, found=linear, setup=0):
        return what_if(found, LinearRuns(), changes, setup=setup, before=before or {})

    unchanged(refusals({
        "nothing": lambda: changed({"lr": {}}), "no corner": lambda: changed({"left": {"scale": 2.0}}),
        "no corner before": lambda: changed({"lr": {"scale": 2.0}}, {"right": {"scale": 2.0}}),
        "a failed run": lambda: changed({"lr": {"scale": -1.0}}),
        "no feasible setup": lambda: changed({"lr": {"scale": 1.5}}, found=none, setup=None),
        "no shock": lambda: here.run([{}]), "no gain": lambda: band(bowl, search(bowl, [np.full(4, 0.5)]), 4.0),
    }))  # fmt: skip
