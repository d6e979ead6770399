"""The law of a record is recognised by cross-validation, and the choice is stated with its reason."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident import choose_law, fit_shock
from eightpost.ident.shock import curve_choice
from eightpost.ident.shock.choice_verdict import RULES, choice_reasons
from eightpost.ident.shock.cross_validation import HeldOut, _without_level, left_out_blocks, left_out_runs
from eightpost.ident.shock.law_choice import LawScore, chosen_law
from eightpost.ident.shock.record import prepare
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.tables import choice_table
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import LAWS, Lpf1, Lpnl2, Polylinear, law_name
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade

RATE = 500.0


def made_by(kind, curve):
    own = {Polylinear: (), Lpf1: (3e-3,), Lpnl2: (4e-3, 250.0, 700.0)}
    return kind(curve, *own[kind])


def sine(*, speed=0.2, hertz=2.0, duration=6.0, gain=2000.0):
    time = np.arange(round(duration * RATE)) / RATE
    phase = 2.0 * np.pi * hertz * time
    noise = np.random.default_rng(1).standard_normal(time.size)
    velocity = speed * np.cos(phase)
    channels = {
        "velocity": ("m/s", velocity),
        "displacement": ("m", speed / (2.0 * np.pi * hertz) * np.sin(phase)),
        "force": ("N", gain * velocity + noise),
    }
    return DynoTest(TimeSeries.from_channels(time, channels))


def with_force(test, force):
    return replace(test, series=test.series.with_channel("force", "N", force))


# ---- Which law is chosen --------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_record_without_dynamics_gives_the_static_law_without_cross_validating_the_others(rising, law_record):
    choice = choose_law(law_record(Polylinear(rising), 1, rate=RATE), ("polylinear", "lpf1"))
    assert choice.law == "polylinear"
    assert choice["lpf1"].trouble == "" or choice["lpf1"].trouble.startswith("same fit as Polylinear")


@pytest.fixture(scope="module")
def chosen(rising, law_record):
    """Return a function that compares the laws on the record of a law, once for all tests."""

    @cache
    def choose(kind):
        return choose_law(law_record(made_by(kind, rising), 1, rate=RATE))

    return choose


@pytest.mark.nightly
@pytest.mark.parametrize("kind", [Lpf1, Lpnl2])
def test_the_law_that_made_a_record_is_chosen(kind, chosen):
    choice = chosen(kind)
    assert choice.law == law_name(kind)
    assert choice.chosen.held_out.percent < 3.0
    assert [score.law for score in choice.scores] == list(LAWS)


@pytest.mark.nightly
def test_the_same_law_is_chosen_on_a_part_of_the_record(rising, law_record):
    record = law_record(made_by(Lpf1, rising), 1, rate=RATE)
    assert choose_law(record, segment=(1.0, 5.0)).law == choose_law(record, segment=(5.0, 10.0)).law == "lpf1"


@pytest.mark.nightly
def test_noise_alone_gives_the_simplest_law_and_is_not_usable(rising, law_record):
    record = law_record(made_by(Lpf1, rising), 1, rate=RATE)
    noise = np.random.default_rng(3).standard_normal(len(record.series))
    fit = fit_shock(with_force(record, 300.0 * noise), "auto", order=5)
    assert fit.choice.law == "polylinear"
    reasons = {reason.rule: reason.grade for reason in fit.verdict.about("choice of the law").reasons}
    assert reasons["chosen law predicts poorly"] is Grade.NOT_USABLE


@pytest.mark.nightly
def test_of_several_runs_whole_ones_are_left_out_and_their_level_does_not_count(rising, law_record):
    one, other = (law_record(made_by(Lpf1, rising), seed, rate=RATE) for seed in (1, 2))
    fit = fit_shock([one, with_force(other, 1.3 * other.series["force"])], "auto")
    assert (fit.choice.law, fit.choice.left_out) == ("lpf1", "runs")
    held = fit.choice.chosen.held_out
    assert held.percent < 1.5
    assert held.raw_percent > 10.0
    assert "level of the runs" in {reason.rule for reason in fit.verdict.reasons}


# ---- The automatic fit is the fit of the chosen law -----------------------------------------------------------------


@pytest.mark.nightly
def test_the_automatic_fit_is_that_of_the_chosen_law_and_states_the_comparison(rising, law_record, chosen):
    record = law_record(made_by(Lpf1, rising), 1, rate=RATE)
    fit = fit_shock(record, "auto")
    named = fit_shock(record, fit.choice.law)
    assert fit.shock.law == named.shock.law
    assert named.choice is None
    assert "law_choice" not in named.shock.fit
    assert fit.shock.fit["law_choice"] == json.loads(json.dumps(chosen(Lpf1).to_json()))
    assert fit.shock.fit["law_choice"]["laws"]["lpf1"]["parameters"] > 1


def test_a_law_that_rejects_the_record_is_listed_and_the_others_are_compared(monkeypatch, rising, law_record):
    record, fit_law = law_record(made_by(Lpf1, rising), 1, rate=RATE), curve_choice.fit_law

    def rejecting(runs, law, choices, curve):
        if law == "lpnl2":
            raise ValueError("the curve falls")
        return fit_law(runs, law, choices, curve)

    monkeypatch.setattr(curve_choice, "fit_law", rejecting)
    choice = choose_law(record, ("polylinear", "lpnl2"))
    assert choice.law == "polylinear"
    assert choice["lpnl2"].trouble == "the curve falls"
    assert choice.to_json()["laws"]["lpnl2"] == {"trouble": "the curve falls"}
    with pytest.raises(ParameterError, match="no law could be fitted to this record"):
        choose_law(record, ("lpnl2",))


@pytest.mark.parametrize("laws", [(), ("auto",), ("lpf2",)])
def test_unknown_laws_are_refused(laws):
    with pytest.raises(ParameterError, match="laws to compare must be among polylinear, lpf1"):
        choose_law(sine(), laws)


def test_the_dissertations_recipe_does_not_choose():
    with pytest.raises(ParameterError, match="recipe 'boggs' fits one law, not 'auto'"):
        fit_shock(sine(), "auto", recipe="boggs")


# ---- The rule -------------------------------------------------------------------------------------------------------


def score(law, *percents, trouble=""):
    held = HeldOut(tuple((p / 100.0) ** 2 for p in percents), tuple((p / 100.0) ** 2 for p in percents))
    own = {"polylinear": 0, "lpf1": 1, "other": 1, "lpnl2": 3}
    return LawScore(law, held, None, 1.0, own[law], 20, None, trouble)


def test_a_simpler_law_is_chosen_if_it_is_better_on_some_pieces():
    choice = chosen_law([score("lpf1", 2.0, 2.0, 2.1, 2.2), score("lpnl2", 2.1, 1.9, 2.2, 1.9)])
    assert (choice.law, choice.best) == ("lpf1", "lpnl2")
    assert "LPF1 is the simplest law within one standard error of the best" in choice.reason


def test_a_small_gain_on_every_piece_is_enough_although_the_pieces_differ():
    choice = chosen_law([score("lpf1", 1.1, 2.2, 4.4, 8.8), score("lpnl2", 1.0, 2.0, 4.0, 8.0)])
    assert choice.law == "lpnl2"
    assert "no simpler law is within one standard error" in choice.reason


def test_one_piece_that_all_laws_predict_badly_does_not_decide():
    """The third piece alone favours LPF1; in a mean of the errors it outweighs the others."""
    choice = chosen_law([score("lpf1", 2.0, 2.1, 19.0, 2.0), score("lpnl2", 1.0, 1.1, 20.0, 1.0)])
    assert (choice.law, choice.best) == ("lpnl2", "lpnl2")


def test_the_error_is_the_geometric_mean_of_the_pieces_with_its_standard_error():
    held = score("lpf1", 1.0, 2.0, 4.0).held_out
    assert held.percent == pytest.approx(2.0)
    assert held.spread == pytest.approx(2.0 * np.log(2.0) / np.sqrt(3.0))


def test_a_run_whose_speed_no_other_has_is_not_left_out_for_the_choice():
    quarters, runs = (score("lpf1", percent, percent).blocks for percent in (2.0, 9.0))
    both = LawScore("lpf1", quarters, runs, 1.0, 1, 20, None)
    assert both.held_out is runs
    assert replace(both, decides="quarters").held_out is quarters
    assert chosen_law([both]).left_out == "runs"
    assert chosen_law([replace(both, decides="quarters")]).left_out == "quarters"


@pytest.mark.parametrize(
    ("speeds", "are_repeated"), [((0.3,), False), ((0.3, 0.3), True), ((0.1, 0.3), False), ((0.1, 0.3, 0.31), False),
                                 ((0.1, 0.11, 0.3, 0.31), True)]
)  # fmt: skip
def test_runs_are_left_out_if_each_has_another_of_its_speed(speeds, are_repeated):
    runs = Runs.of([prepare(sine(speed=speed, duration=4.0)) for speed in speeds])
    assert runs.has_repeated_speeds is are_repeated


def test_a_tie_gives_the_simpler_law_and_of_equally_simple_ones_the_better():
    assert chosen_law([score("lpnl2", 2.0, 3.0), score("lpf1", 2.0, 3.0)]).law == "lpf1"
    assert chosen_law([score("lpf1", 2.0, 3.1), score("other", 2.1, 2.9), score("lpnl2", 2.0, 2.9)]).law == "other"
    assert chosen_law([score("lpf1", 2.001, 3.001), score("lpnl2", 2.0, 3.0)]).law == "lpf1"


def test_a_law_that_did_not_converge_is_chosen_only_without_another():
    lost = score("lpnl2", 1.0, 1.0, trouble="the fit did not converge")
    assert chosen_law([lost, score("lpf1", 2.0, 2.0)]).law == "lpf1"
    assert chosen_law([lost]).law == "lpnl2"


def test_the_regret_is_the_excess_over_the_best_law_in_hindsight():
    choice = chosen_law([score("lpf1", 2.0, 2.0), score("lpnl2", 1.0, 1.0)])
    assert choice.regret({"lpf1": 4.0, "lpnl2": 5.0}) == pytest.approx(0.25)


# ---- What is left out -----------------------------------------------------------------------------------------------


def test_the_quarters_are_apart_from_the_rows_that_are_fitted():
    runs = Runs.of([prepare(sine()), prepare(sine())])
    blocks = left_out_blocks(runs)
    predicted = np.concatenate([np.arange(runs.target.size)[part] for block in blocks for part in block.parts])
    assert sorted(predicted.tolist()) == list(range(runs.target.size))
    for block in blocks:
        for part in block.parts:
            assert not block.kept[part].any()
        assert 0.6 < block.kept.mean() < 0.74


def test_the_error_on_a_whole_run_is_that_of_the_best_offset_and_gain_of_the_samples_that_count():
    measured = np.random.default_rng(4).standard_normal(50)
    weights = np.ones(50)
    weights[7], predicted = 0.0, 30.0 - 4.0 * measured
    predicted[7] = 1e3
    assert np.delete(_without_level(predicted, measured, weights), 7) == pytest.approx(np.zeros(49), abs=1e-12)
    constant = _without_level(np.full(50, 3.0), measured, np.ones(50))
    assert constant == pytest.approx(measured.mean() - measured)


@pytest.mark.parametrize(("count", "fits"), [(1, 0), (2, 2), (8, 8), (11, 8)])
def test_each_run_is_left_out_once_by_at_most_eight_fits(count, fits):
    runs = Runs.of([prepare(sine(duration=2.0))] * count)
    left = left_out_runs(runs)
    assert len(left) == fits
    assert sum(len(part.parts) for part in left) == (count if fits else 0)
    assert all(part.is_whole and not part.kept[part.parts[0]].any() for part in left)


# ---- The verdict ----------------------------------------------------------------------------------------------------


def reasons(scores, *tests):
    return {
        reason.rule: reason
        for reason in choice_reasons(chosen_law(scores), Runs.of([prepare(test) for test in tests]), "run.csv")
    }


@pytest.mark.parametrize(
    ("percents", "rule", "statement"),
    [((10.0, 10.0), "chosen law predicts", "LPF1 predicts what was left out of its fit"),
     ((4.0, 16.4), "chosen law predicts roughly", "LPF1 does not predict what was left out of its fit well"),
     ((20.0, 40.2), "chosen law predicts poorly", "LPF1 does not predict what was left out of its fit well")],
)  # fmt: skip
def test_the_mean_held_out_error_decides_whether_the_chosen_law_predicts(percents, rule, statement):
    (found, *_) = reasons([score("lpf1", *percents)], sine(speed=0.3)).values()
    assert (found.rule, found.statement) == (rule, statement)
    assert found.figure.startswith(f"held-out error {np.mean(percents):.3g} % (typically ")
    assert found.figure.endswith(
        "on quarters of one run; other runs were not tried; limits 10 and 30 %; velocities -0.3 to 0.3 m/s"
    )


def test_a_long_fast_test_with_two_speeds_shows_everything():
    tests = [sine(speed=speed, hertz=4.0, duration=3.0) for speed in (0.1, 0.3)]
    found = reasons([replace(score("lpf1", 1.0, 1.0), decides="quarters")], *tests)
    assert list(found) == ["chosen law predicts"]
    assert (
        "on quarters of 2 runs, whose speeds differ; other runs were not tried" in found["chosen law predicts"].figure
    )


def test_eight_cycles_at_one_low_speed_do_not_show_enough():
    found = reasons([score("lpf1", 1.0, 1.0)], sine(speed=0.1, duration=4.0))
    assert list(found) == ["chosen law predicts", "single speed", "few cycles", "low speeds only"]
    assert found["single speed"].figure.endswith(" Hz, peak speed 0.1 m/s")
    assert found["few cycles"].figure == "8 cycles in all; 16 are needed"
    assert found["low speeds only"].figure == "peak speed 0.1 m/s; limit 0.254 m/s"


@pytest.mark.parametrize(("fourth", "is_uneven"), [(5.0, False), (9.0, True)])
def test_a_quarter_with_a_larger_error_than_the_others_is_named(fourth, is_uneven):
    pieces = [percent for percent in (1.0, 2.0, 3.0, fourth) for _ in range(4)]
    found = reasons([score("lpf1", *pieces)], sine(speed=0.3, hertz=4.0))
    assert ("uneven record" in found) == is_uneven
    if is_uneven:
        assert found["uneven record"].figure == "held-out error of quarter 4 of 4: 9 %, of the others 2 %"


@pytest.mark.parametrize(("raw", "differs"), [(6.9, False), (7.1, True)])
def test_runs_whose_forces_differ_by_a_factor_are_named(raw, differs):
    """A law with an error of 2 % may have one of 7 % with the level of each run."""
    held = HeldOut((0.02**2,) * 2, ((raw / 100.0) ** 2,) * 2)
    one = replace(score("lpf1", 2.0, 2.0), runs=held)
    found = reasons([one], sine(speed=0.3, hertz=4.0), sine(speed=0.3, hertz=4.0))
    assert ("level of the runs" in found) == differs
    assert "on whole runs, 2 of them; limits" in found["chosen law predicts"].figure


def test_the_table_of_the_choice_has_the_held_out_error_of_each_law():
    scores = [replace(score("lpf1", 2.0, 2.0), step_cost=1.25), score("lpnl2", 1.0, 4.0, trouble="did not converge"),
              LawScore("other", None, None, 0.0, 1, 0, None, "the curve falls")]  # fmt: skip
    table = choice_table(chosen_law(scores))
    assert table.title == "Choice of the law: errors on left-out quarters of the record, % of std"
    assert list(zip(*(column.cells for column in table.columns), strict=True)) == [
        ("LPF1", "-", "2", "0", "1", "20", "1.2", "chosen"),
        ("Other", "-", "-", "-", "-", "-", "-", "the curve falls"),
        ("LPNL2", "-", "2", "1.4", "1", "20", "-", "did not converge"),
    ]


@pytest.mark.nightly
def test_a_few_cycles_of_one_slow_sine_leave_open_what_another_test_would_settle():
    fit = fit_shock(sine(speed=0.1, duration=4.0), "auto")
    found = {reason.rule: reason for reason in fit.verdict.about("choice of the law").reasons}
    assert {"chosen law predicts", "single speed", "few cycles", "low speeds only"} == found.keys()
    assert found["single speed"].figure.endswith("peak speed 0.1 m/s")
    assert found["few cycles"].figure == "8 cycles in all; 16 are needed"


@pytest.mark.nightly
def test_two_speeds_are_not_a_single_speed():
    fit = fit_shock([sine(speed=speed, hertz=4.0, duration=3.0) for speed in (0.1, 0.3)], "auto")
    assert not {"single speed", "few cycles", "low speeds only"} & {reason.rule for reason in fit.verdict.reasons}


@pytest.mark.nightly
def test_a_part_that_differs_from_the_rest_is_named(rising, law_record):
    record = law_record(made_by(Lpf1, rising), 1, rate=RATE)
    later = np.where(record.series.time > 8.0, 1.4, 1.0)
    fit = fit_shock(with_force(record, later * record.series["force"]), "auto")
    (reason,) = [reason for reason in fit.verdict.reasons if reason.rule == "uneven record"]
    assert reason.figure.startswith("held-out error of quarter 4 of 4: ")


def test_the_remedy_of_a_test_with_few_cycles_is_the_number_that_is_not_few():
    """Four cycles in each of four quarters are enough."""
    few, enough = (reasons([score("lpf1", 1.0, 1.0)], sine(speed=0.3, duration=s)) for s in (7.8, 8.5))
    assert "few cycles" not in enough
    assert few["few cycles"].remedy == "record 16 or more cycles"


def test_the_rules_have_names_of_their_own():
    assert len({rule.name for rule in RULES}) == len(RULES) == 8
