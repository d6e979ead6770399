"""Certainty of a study, compared with closed forms, a dense joint distribution and its own claims."""

from __future__ import annotations

import math
from dataclasses import replace
from time import process_time

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats

from cosim.study.choice.assess import Knowledge, certainty_of, posterior_of
from cosim.study.choice.best import Limits, next_tests
from cosim.study.choice.certainty import (
    OBJECTIVE,
    ConfirmedRun,
    Effect,
    NextTest,
    Status,
    certainty_reasons,
    summary_lines,
)
from cosim.study.choice.posterior import half_width, probability_below
from cosim.study.choice.shape_search import DrawnCar, VehicleDraws
from cosim.study.choice.sources import Scales, error_sources
from cosim.study.definition import Constraint, Term
from eightpost.uncertainty import MeasureUncertainty, separation
from eightpost.validity import ModelUncertainty, Validity
from eightpost.verdict import Grade, Verdict

from .assessed import NOISE, assessed, lag, paired, run, stating, two_setups
from .constructed import result

# ---- Probability of being best --------------------------------------------------------------------------------------


@pytest.mark.parametrize("own", [0.25, 0.5, 2.0])
def test_of_two_setups_the_lower_one_is_the_best_with_the_probability_of_students_t(own):
    """The only measure changes by its own logarithm, and by the same distance of the setups."""
    found = certainty_of(two_setups(0.01, (0.03, own)))
    apart = separation(0.01, 0.01)
    assert found.best[0] == pytest.approx(stats.t.cdf(0.01 / (own * apart), 4), abs=NOISE)
    assert found.best.sum() == pytest.approx(1.0)


def test_an_error_that_all_setups_share_does_not_affect_the_choice():
    small, large = (certainty_of(two_setups(0.01, (common, 0.5))) for common in (0.0, 0.3))
    assert large.best[0] == pytest.approx(small.best[0], abs=NOISE)
    low, high = large.levels["a"].interval(0.95)
    assert np.log(high / low)[0] == pytest.approx(2.0 * 0.3 * stats.t.ppf(0.975, 4), rel=0.02)


@pytest.mark.parametrize("deviation", [0.005, 0.02])
def test_of_two_setups_that_differ_in_one_uncertain_shock_the_probability_is_normal(deviation):
    found = certainty_of(two_setups(0.01, (0.0, 0.0)), Knowledge((lag("C/C", deviation),)))
    assert found.best[0] == pytest.approx(stats.norm.cdf(0.01 / deviation), abs=NOISE)


@pytest.mark.parametrize("correlation", [-0.5, 0.5, 0.95])
def test_what_the_fits_of_two_builds_have_in_common_does_not_affect_which_is_better(correlation):
    """The variance of the difference of two errors of size s is 2 (1 - r) s^2; that of each one does not change."""
    effects = paired(lag("B/B", 0.01), lag("C/C", 0.01), correlation)
    found = certainty_of(two_setups(0.004, (0.0, 0.0)), Knowledge(effects))
    assert found.best[0] == pytest.approx(stats.norm.cdf(0.004 / (0.01 * np.sqrt(2.0 - 2.0 * correlation))), abs=NOISE)
    low, high = found.levels["a"].interval(0.95)
    np.testing.assert_allclose(np.log(high / low), 2.0 * 0.01 * stats.norm.ppf(0.975), rtol=0.02)


def test_builds_of_one_common_error_have_a_certain_order():
    effects = paired(lag("B/B", 0.01), lag("C/C", 0.01), 1.0)
    assert certainty_of(two_setups(0.001, (0.0, 0.0)), Knowledge(effects)).best[0] == 1.0


def test_errors_of_other_parameters_and_of_copies_are_not_correlated():
    effects = paired(lag("B/B", 0.01, copies=1.0), replace(lag("C/C", 0.01), parameter="stop_time"), 1.0)
    apart = [replace(one, correlations={}) for one in effects]
    first, second = (error_sources(two_setups(0.01), one) for one in (effects, apart))
    np.testing.assert_array_equal(first.changes, second.changes)
    same = error_sources(two_setups(0.01), paired(*(lag(build, 0.01, copies=1.0) for build in ("B/B", "C/C")), 1.0))
    rows = np.arange(2)
    fit, copies = same.by_parameter(rows, 0), same.by_copy(rows, 0).reshape(2, -1)
    np.testing.assert_allclose(fit @ fit.T, 0.01**2)
    np.testing.assert_allclose(copies @ copies.T, 0.01**2 * np.eye(2), atol=1e-18)


def test_the_same_build_has_the_same_error_of_the_fit_at_every_corner_and_another_one_of_the_copy():
    corners = {"lf": ("B/B",), "rf": ("B/B",), "lr": ("B/B", "C/C"), "rr": ("B/B", "C/C")}
    study = assessed({"a": lambda d: np.exp(0.01 * d[:, 3] + 0.0 * d[:, 2])}, (0.0, 0.0), corners=corners)
    both = {corner: {"C/C": {"a": 0.02}} for corner in ("lr", "rr")}
    for copies, expected in ((0.0, 0.02), (1.0, 0.02)):
        # Setups 1 and 2 have C/C at one rear corner each: errors of the fit cancel, errors of the copies do not.
        known = Knowledge((Effect("C/C", "lag", 1.0, copies, {}, both),))
        rows = np.array([1, 2])
        sources = error_sources(study, known.effects)
        drawn = sources.draw(Scales(np.ones(1), np.ones(1)), 4000, np.random.default_rng(1))
        errors = sources.errors(drawn, rows, 0)
        apart = float(np.std(errors[:, 0] - errors[:, 1]))
        assert apart == pytest.approx(np.sqrt(2.0) * copies * expected, rel=0.05, abs=1e-12)
        assert np.std(errors[:, 0]) == pytest.approx(expected * np.hypot(1.0, copies), rel=0.05)
        np.testing.assert_allclose(sources.shock_covariance(rows, 0, 0), (expected * np.hypot(1.0, copies)) ** 2)


def test_the_ties_contain_the_best_setup_with_a_joint_probability_and_are_the_fewest():
    found = certainty_of(assessed({"a": lambda d: np.exp(0.004 * (d[:, 0] + 2 * d[:, 1] + d[:, 2] + 3 * d[:, 3]))}))
    chances = np.sort(found.best)[::-1]
    assert sum(found.probability(setup) for setup in found.ties) >= 0.95
    fewest = int(np.searchsorted(np.cumsum(chances), 0.95)) + 1
    assert fewest <= len(found.ties) <= 1.3 * fewest + 2  # the order comes from one half of the draws
    assert len(found.ties) > 1
    assert found.leader == found.setups[np.argmax(found.best)]


def test_a_choice_among_many_setups_is_less_sure_than_each_of_its_comparisons():
    """With 48 rivals of equal level and independent shocks, the best predicted one is rarely the best."""
    builds = tuple(f"b{k}" for k in range(49))
    corners = {"lf": builds[:1], "rf": builds[:1], "lr": builds[:1], "rr": builds}
    study = assessed({"a": lambda d: np.where(d[:, 3] == 0, 1.0, 1.01)}, (0.0, 0.0), corners=corners, builds=builds)
    found = certainty_of(study, Knowledge(tuple(lag(build, 0.01) for build in builds)))
    pairwise = stats.norm.cdf(0.01 / (0.01 * np.sqrt(2.0)))
    assert found.best[0] < 0.3 < pairwise
    expected = stats.norm.expect(lambda z: stats.norm.sf(z - 1.0) ** 48)
    assert found.best[0] == pytest.approx(expected, abs=NOISE)


def test_among_the_best_k_are_k_setups_of_every_draw():
    slopes = 0.01 * np.array([1.0, 1.013, 1.039, 1.117])  # no two setups are equal
    found = certainty_of(assessed({"a": lambda d: np.exp(d @ slopes)}), top=7)
    assert found.among.sum() == pytest.approx(7.0, rel=1e-3)
    assert np.all(found.among >= found.best - 1e-9)


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_the_result_does_not_depend_on_the_order_of_builds(seed):
    """The same physical setups, numbered in another order, have the same probabilities."""
    order = np.random.default_rng(seed).permutation(4)
    builds, level = ("p", "q", "r", "s"), np.array([0.0, 0.01, 0.013, 0.03])
    corners = {"lf": builds[:1], "rf": builds[:1], "lr": builds[:1]}
    names = tuple(builds[k] for k in order)
    plain = assessed({"a": lambda d: np.exp(level[d[:, 3]])}, corners={**corners, "rr": builds}, builds=builds)
    other = assessed({"a": lambda d: np.exp(level[order][d[:, 3]])}, corners={**corners, "rr": names}, builds=builds)
    first, second = certainty_of(plain), certainty_of(other)
    chances = [dict(zip(one_names, one.best, strict=True)) for one_names, one in ((builds, first), (names, second))]
    assert chances[1] == pytest.approx(chances[0], abs=NOISE)


# ---- Objective and constraints --------------------------------------------------------------------------------------


def test_the_objective_is_ranked_by_the_sum_of_its_uncertain_terms():
    study = assessed(
        {"a": lambda d: np.exp(0.01 * d[:, 3]), "b": lambda d: 2.0 * np.exp(-0.002 * d[:, 3])},
        (0.0, 0.0),
        objective=(Term("a", 3.0, "m"), Term("b", 1.0, "m")),
        corners={"lf": ("B/B",), "rf": ("B/B",), "lr": ("B/B",), "rr": ("B/B", "C/C")},
    )
    effects = (lag("C/C", 0.01), lag("C/C", 0.01, measure="b"))
    found = certainty_of(study, Knowledge(effects))
    gap = study.objective[1] - study.objective[0]
    deviation = np.hypot(3.0 * 0.01 * np.exp(0.01), 2.0 * 0.01)
    assert found.criterion == OBJECTIVE
    assert found.best[0] == pytest.approx(stats.norm.cdf(gap / deviation), abs=NOISE)
    low, high = found.levels[OBJECTIVE].interval(0.8)
    assert (high - low)[1] == pytest.approx(2.0 * stats.norm.ppf(0.9) * deviation, rel=0.02)


def test_a_setup_near_a_limit_is_feasible_with_a_probability_and_best_only_if_it_is():
    study = two_setups(0.05, (0.0, 0.0), constraints=(Constraint("a", at_most=1.06),))
    effect = Effect("B/B", "lag", 1.0, 0.0, {}, {"rr": {"B/B": {"a": 0.06}}})
    found = certainty_of(study, Knowledge((effect,)))
    meets = stats.norm.cdf(np.log(1.06) / 0.06)
    assert found.feasible.tolist() == pytest.approx([meets, 1.0], abs=0.01)
    below = stats.norm.cdf(0.05 / 0.06)  # the level of the first setup is also below that of the second
    assert found.best[0] == pytest.approx(min(meets, below), abs=NOISE)


def test_a_study_without_a_feasible_setup_has_no_leader():
    found = certainty_of(two_setups(0.01, (0.0, 0.001), constraints=(Constraint("a", at_most=0.1),)))
    assert found.ties == () and found.leader is None
    assert list(certainty_reasons(found)) == []
    assert "no setup meets the constraints" in next(iter(summary_lines(two_setups(0.01), found)))


def test_failed_setups_are_never_the_best():
    study = two_setups(0.01, failed=(0,))
    found = certainty_of(study)
    assert found.best.tolist() == [0.0, 1.0] and found.feasible[0] == 0.0
    assert np.isnan(found.levels["a"].half_widths[:, 0]).all()


# ---- What is not known is not claimed -------------------------------------------------------------------------------


def test_a_vehicle_that_states_nothing_leaves_the_choice_unknown():
    study = result({"front": lambda d: np.exp(0.1 * d[:, 3])})
    found = certainty_of(study)
    assert not found.is_known and not found.levels["front"].is_known
    assert np.isnan(found.levels["front"].half_widths).all()
    grades = {reason.grade for reason in certainty_reasons(found)}
    assert Grade.UNKNOWN in grades and Grade.USABLE not in grades
    assert "is not known" in next(iter(summary_lines(study, found)))


def test_a_measure_in_a_band_has_the_uncertainty_of_its_output_and_says_so():
    study = two_setups(0.01)
    banded = replace(study.study, measures=(replace(study.study.measures[0], band=(1.0, 5.0)),))
    found = certainty_of(replace(study, study=banded))
    assert found.levels["a"].basis == "output"
    assert any("RMS of its outputs" in text for text in found.remarks)
    meant = replace(study.study, measures=(replace(study.study.measures[0], statistic="mean"),))
    assert certainty_of(replace(study, study=meant)).levels["a"].basis == "unknown"


def test_a_build_without_the_effect_of_any_parameter_is_unknown_and_not_exact():
    """Nothing is stated about the shocks, or the runs with another parameter of C/C failed."""
    failed = Effect("C/C", "lag", 1.0, 0.0, {}, {})
    for known in (Knowledge(), Knowledge((lag("B/B", 0.001), failed))):
        found = certainty_of(two_setups(0.01), known)
        (fits,) = [one for one in found.contributions if one.name == "shock fits"]
        assert fits.status is Status.UNKNOWN and "C/C" in fits.text and not found.is_known


def test_a_certain_choice_is_usable_and_a_tie_is_not():
    exact = Knowledge((lag("B/B", 0.0), lag("C/C", 0.0)))
    partly, tied = (certainty_of(two_setups(gap, (0.0, 0.1)), exact) for gap in (0.01, 0.0))
    assert {one.name for one in partly.left_out} == {"build to build", "coupling"}
    assert [one.grade for one in certainty_reasons(partly)] == [Grade.LIMITED]
    included = tuple(replace(one, status=Status.INCLUDED) for one in partly.contributions)
    assert [one.grade for one in certainty_reasons(replace(partly, contributions=included))] == [Grade.USABLE]
    assert [one.grade for one in certainty_reasons(tied)] == [Grade.LIMITED]
    assert [one.grade for one in certainty_reasons(None)] == [Grade.UNKNOWN]


def test_a_summary_names_what_is_not_included_instead_of_a_probability():
    study = two_setups(0.01, (0.0, 0.1))
    partly = certainty_of(study, Knowledge((lag("B/B", 0.0), lag("C/C", 0.0))))
    included = tuple(replace(one, status=Status.INCLUDED) for one in partly.contributions)
    assert next(summary_lines(study, replace(partly, contributions=included))).endswith(" %")
    first = next(summary_lines(study, partly))
    assert first.startswith("probably the best by") and "%" not in first
    assert {name in first for name in ("build to build", "coupling")} == {True}


def test_rig_runs_of_a_known_deviation_do_not_count_as_exact():
    study = two_setups(0.0, (0.0, 0.1))
    known = certainty_of(study, Knowledge((lag("B/B", 0.0), lag("C/C", 0.0)), run_to_run={"a": 0.01}))
    assert not known.assumes_exact_runs
    lines = summary_lines(study, replace(known, tests=(NextTest(1, 1e-4),)))
    assert "test next: 1; below 0.1 % of the uncertainty about the ties remains (eightpost study confirm)" in lines


# ---- Next tests -----------------------------------------------------------------------------------------------------


def test_the_next_tests_are_of_the_setups_between_which_the_choice_is_open():
    """Of four setups, two are likely and differ by independent errors; a third one is known exactly."""
    covariance = np.diag([1.0, 1.0, 0.0, 1.0])
    chosen = next_tests(covariance, np.array([0.5, 0.48, 0.01, 0.01]), 0.01, 2)
    assert {place for place, _ in chosen} == {0, 1}
    assert chosen[1][1] < 0.05 < chosen[0][1]


def test_a_common_error_alone_asks_for_no_test():
    assert next_tests(np.ones((3, 3)), np.full(3, 1.0 / 3.0), 0.0, 3) == []


def test_no_setup_is_proposed_twice():
    values = np.random.default_rng(4).normal(size=(40, 12))
    chosen = [place for place, _ in next_tests(np.cov(values.T), np.full(12, 1.0 / 12.0), 0.5, 12)]
    assert len(set(chosen)) == len(chosen) == 12


# ---- Distribution ----------------------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(student=st.floats(0.0, 4.0), normal=st.floats(0.0, 4.0), probability=st.sampled_from((0.5, 0.8, 0.95)))
def test_half_widths_contain_their_probability(student, normal, probability):
    assume(student + normal >= 1e-3)
    half = half_width(probability, np.array([student]), np.array([normal]), 4.0)
    inside = 2.0 * probability_below(half, np.array([student]), np.array([normal]), 4.0)[0] - 1.0
    assert inside == pytest.approx(probability, abs=2e-3)


def test_the_mixture_is_students_t_without_a_normal_part_and_normal_without_the_other():
    one, none = np.ones(1), np.zeros(1)
    for probability in (0.5, 0.8, 0.95):
        tail = 0.5 + 0.5 * probability
        assert half_width(probability, one, none, 4.0)[0] == pytest.approx(stats.t.ppf(tail, 4), rel=0.01)
        assert half_width(probability, none, one, 4.0)[0] == pytest.approx(stats.norm.ppf(tail), rel=1e-4)


def test_the_total_tire_force_has_its_own_stated_uncertainty():
    wheels = tuple(f"car.{corner}.tire_force" for corner in ("lf", "rf", "lr", "rr"))
    study = result({"total": lambda d: np.exp(0.01 * d[:, 3])})
    measure = replace(study.study.measures[0], channels=wheels)
    study = replace(study, study=replace(study.study, measures=(measure,)))
    stated = {wheel.removeprefix("car."): (0.5, 0.5) for wheel in wheels} | {"total_tire_force": (0.1, 0.2)}
    sources = error_sources(stating(study, stated))
    assert (sources.common.tolist(), sources.own.tolist(), sources.bases) == ([0.1], [0.2], ("stated",))


@pytest.mark.nightly
def test_a_hundred_thousand_setups_with_twenty_measures_take_seconds():
    builds = tuple(f"b{k}" for k in range(18))
    slopes = np.random.default_rng(5).normal(0.0, 0.01, (20, 4))
    responses = {f"m{k}": (lambda d, row=row: np.exp(d @ row)) for k, row in enumerate(slopes)}
    study = assessed(responses, (0.01, 0.1), builds=builds, corners=dict.fromkeys(("lf", "rf", "lr", "rr"), builds))
    assert len(study) == 18**4
    began = process_time()
    found = certainty_of(study)
    assert process_time() - began < 40.0
    assert found.best.sum() == pytest.approx(1.0)


# ---- A known bias of the vehicle ------------------------------------------------------------------------------------

#: The vehicle predicts 3 % too high levels.
BIAS = math.log(1.03)


def biased(scales=(0.01, 0.0)):
    """A study of two setups whose vehicle has a known bias."""
    found = two_setups(0.02, scales)
    stated = {"o0": MeasureUncertainty(*scales, bias=BIAS)}
    validity = Validity(Verdict([]), (), ModelUncertainty(measures=stated)).to_json()
    return replace(found, provenance=replace(found.provenance, models={"car.fmu": validity}))


def test_levels_are_corrected_by_a_known_bias_and_the_certainty_says_so():
    found, plain = certainty_of(biased()), certainty_of(two_setups(0.02, (0.01, 0.0)))
    assert found.levels["a"].expected == pytest.approx(plain.levels["a"].expected / 1.03)
    np.testing.assert_allclose(found.levels["a"].half_widths, plain.levels["a"].half_widths)
    assert found.remarks[0] == "a is corrected by -2.9 %: its error on the vehicle's own tests is significant"
    assert found.ties == plain.ties


def test_a_rig_run_at_the_corrected_level_agrees_with_the_prediction_and_one_at_the_predicted_level_does_not():
    study = biased((0.002, 0.0))
    known = {"run_to_run": {"a": 0.001}}
    agreed, apart = (certainty_of(study, Knowledge(runs=(run(0, a=level),), **known)) for level in (1.0 / 1.03, 1.0))
    assert not agreed.contradictions
    assert apart.contradictions[0].measure == "a"
    assert agreed.levels["a"].expected[0] == pytest.approx(1.0 / 1.03, rel=1e-3)


def test_drawn_cars_have_the_bias_on_average():
    study = biased()
    draws = VehicleDraws.of(study, posterior_of(study, Knowledge()))
    assert draws.common.mean() == pytest.approx(-BIAS)
    assert draws.common.std() > 0.005


# ==== Drawn errors of the vehicle at setups that are not in a study's table ==========================================

COMMON, OWN = 0.02, 0.5

#: Standard deviation of Student's t distribution with four degrees of freedom.
STUDENT = np.sqrt(2.0)


def study(**scales):
    """Return a study of two measures that depend on the front and on the rear."""
    responses = {"a": lambda digits: np.exp(0.02 * digits[:, :2].sum(axis=1)),
                 "b": lambda digits: np.exp(-0.03 * digits[:, 2:].sum(axis=1))}  # fmt: skip
    return assessed(responses, scales.get("scales", (COMMON, OWN)), corners=dict.fromkeys(
        ("lf", "rf", "lr", "rr"), ("AA/AA", "B/B", "C/C")))  # fmt: skip


def draws_of(found, known=None):
    return VehicleDraws.of(found, posterior_of(found, known or Knowledge()))


def car_of(found, row=0, **changes):
    return replace(DrawnCar.of(found, draws_of(found), "a", row), **changes)


@pytest.fixture(scope="module")
def car():
    return car_of(study())


@settings(max_examples=15)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_the_difference_of_two_setups_scatters_by_their_distance_and_not_by_the_common_error(car, first, second):
    """To first order it is the own error between them; over 400 pairs, the higher orders change it by up to 7 %."""
    other = car.reference * np.exp([first, second])
    here, there = car.draws.axes.position(np.stack([car.reference, other]))
    relative = np.log1p((car.objectives(other[None])[0] - other[0]) / other[0])
    assert np.std(relative) == pytest.approx(np.std(car.draws.own[:, 0] @ (there - here)), rel=0.1, abs=1e-9)


def test_own_and_common_errors_have_the_stated_scales_and_the_tails_of_few_degrees_of_freedom(car):
    """The scales of 64 groups lack the last tail, which is 3 % of the standard deviation (mean of 200 seeds)."""
    own = car.draws.own[:, 0]
    own = own[:, own.any(axis=0)]  # along what the measure depends on
    assert np.sqrt(np.mean(own**2)) == pytest.approx(0.97 * STUDENT * OWN, rel=0.04)
    assert np.sqrt(np.mean(car.draws.common[:, 0] ** 2)) == pytest.approx(0.97 * STUDENT * COMMON, rel=0.2)


def test_the_reference_has_the_same_objective_on_every_car_but_its_constraints_have_errors():
    car = car_of(study(), limits=(Limits(0, 0.0, 1.0),))
    objectives = car.objectives(np.stack([car.reference, 1.01 * car.reference]))
    assert np.ptp(objectives[0]) < 1e-12 and np.ptp(objectives[1]) > 1e-4
    (levels,) = car.limited(car.reference[None])
    assert np.std(np.log(levels)) >= 0.7 * STUDENT * COMMON


def test_rig_runs_narrow_the_draws_near_them():
    found = study()
    row = 40
    values = {name: 1.03 * found.values(name)[row] for name in ("a", "b")}
    run = ConfirmedRun("run.csv", int(found.setups[row]), "lap", "", values)
    known = Knowledge(runs=(run,), run_to_run={"a": 1e-4, "b": 1e-4})
    levels = np.array([[found.values(name)[row] for name in ("a", "b")]])
    before, after = (d.levels(levels, np.array([0]))[:, 0, 0] for d in (draws_of(found), draws_of(found, known)))
    assert after.std() < 0.1 * before.std()
    assert after.mean() == pytest.approx(values["a"], rel=2e-3)


def test_a_vehicle_that_states_no_uncertainty_has_no_draws():
    assert draws_of(study(scales=(0.0, 0.0))) is None
