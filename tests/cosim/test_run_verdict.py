"""The verdict on a run, rule by rule."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cosim import Result
from cosim.report.page import tiles
from cosim.session import verdict as rules
from cosim.session.verdict import BondEnergy, Coupled
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Verdict

BOND = "car.lf"


def sound(**changes) -> Result:
    """Result of a run with one bond and no faults."""
    time = np.linspace(0.0, 10.0, 101)
    series = TimeSeries.from_channels(time, {"car.lf.velocity": ("m/s", np.sin(time))})
    result = Result(
        series=series, converged=True, notes=(), algorithm="default", order=("car", "lf"), step=1e-3, steps=10_000,
        seconds=1.0, equilibrium_sweeps=3, energy={BOND: BondEnergy(0.1, 1000.0)}, held_direct=(), identities={},
        share_beyond_fit={"lf": 0.0}, share_tire_off={"car.lf.tire_force": 0.0}, scheme="gauss-seidel",
        coupled={BOND: Coupled(1e-4, 0.5, 1.0, 800.0, 0.5, 800.0)},
        stated_error={"car.lf.velocity": 0.1, "car.lf.hub": 0.5},
        decisive=frozenset({"car.lf.velocity"}), tolerance=0.2,
    )  # fmt: skip
    return replace(result, **changes)


def only(verdict: Verdict, rule: str):
    (reason,) = [reason for reason in verdict.reasons if reason.rule == rule]
    return reason


def test_a_run_without_faults_is_usable_and_its_verdict_states_the_figures():
    verdict = sound().verdict
    assert verdict.grade is Grade.USABLE
    small = only(verdict, "coupling error small")
    assert "0.1 % of the scale" in small.figure
    assert small.origin == "channel car.lf.velocity, gauss-seidel at 1 ms"
    assert "0.01 %" in {tile.us.replace("\xa0", " ") for tile in tiles(sound())}
    assert set(verdict.grades) == {"coupling", "energy", "convergence", "range of the models"}


CASES = [
    ("stated_error", {"car.lf.velocity": 5.1}, "coupling error too large"),
    ("stated_error", {"car.lf.velocity": 4.9}, "coupling tolerance not met"),
    ("stated_error", {"car.lf.velocity": 0.1, "car.lf.hub": 5.1}, "coupling error of other channels"),
    ("stated_error", {}, "coupling error not stated"),
    ("stated_error", {"car.lf.velocity": np.inf}, "coupling error not stated"),
    ("stated_error", {"car.lf.velocity": np.nan}, "coupling error not stated"),
    ("coupled", {BOND: Coupled(0.026, 0.5, 1.0, 800.0, 0.5, 800.0)}, "local error of a bond"),
    ("energy", {BOND: BondEnergy(-60.0, 1000.0)}, "energy residual too large"),
    ("energy", {BOND: BondEnergy(-20.0, 1000.0)}, "energy residual notable"),
    ("converged", False, "not converged"),
    ("partial", True, "ended early"),
    ("share_beyond_fit", {"lf": 0.38}, "mostly outside the fitted velocities"),
    ("share_beyond_fit", {"lf": 0.02}, "outside the fitted velocities"),
    ("share_beyond_fit", {"lf": 0.005}, "within the fitted velocities"),
    ("share_tire_off", {"car.lf.tire_force": 0.001}, "tire off the ground"),
    ("share_tire_off", {"car.lf.tire_force": 0.3}, "tire mostly off the ground"),
    ("share_tire_off", {"car.lf.tire_force": None}, "static tire force not given"),
]  # fmt: skip


SETTINGS = [
    ({}, {}, {}, []),
    ({"lf": 0.0}, {"lf": 0.0}, {"lf": 0.0}, ["within the settings of a shock"]),
    ({"lf": 0.1}, {"lf": 0.0}, {"lf": 0.0}, ["beyond the settings of a shock"]),
    ({"lf": 1.0}, {"lf": 1.0}, {"lf": 0.0}, ["far beyond the settings of a shock"]),
    ({"lf": 0.0}, {"lf": 0.0}, {"lf": 1.0}, ["untested settings of a shock"]),
    ({"lf": 1.0}, {"lf": 0.0}, {"lf": 1.0}, ["untested settings of a shock", "beyond the settings of a shock"]),
]


@pytest.mark.parametrize(("beyond", "far", "untested", "expected"), SETTINGS)
def test_a_shock_at_settings_that_were_not_measured_is_a_reason(beyond, far, untested, expected):
    shares = {"share_beyond_settings": beyond, "share_far_beyond_settings": far, "share_untested_settings": untested}
    reasons = sound(**shares).verdict.about("settings of the shocks").reasons
    assert [reason.rule for reason in reasons] == expected
    assert all(reason.origin == "component lf" for reason in reasons)


@pytest.mark.parametrize(("field", "value", "rule"), CASES)
def test_each_fault_gives_the_reason_of_its_rule_and_the_worst_reason_sets_the_grade(field, value, rule):
    verdict = sound(**{field: value}).verdict
    assert only(verdict, rule).grade is verdict.grade is rules.RULES.named(rule).grade
    for reason in verdict.reasons:  # the type refuses an empty text
        assert any(character.isdigit() for character in reason.figure) or reason.rule == "not converged"


def test_every_rule_of_a_run_is_covered_by_these_cases():
    covered = {rule for _, _, rule in CASES} | {rule for *_, found in SETTINGS for rule in found}
    for result in (sound(), sound(energy={}, coupled={}, stated_error={})):
        covered |= {reason.rule for reason in result.verdict.reasons}
    ranges = rules.RULES.index(rules.RULES.named("validity of a model unknown"))  # the rules on models follow
    assert covered == {rule.name for rule in rules.RULES[:ranges]}


def test_a_large_local_error_makes_a_run_not_usable_even_if_the_stated_error_is_small():
    """Two runs that oscillate from step to step can agree at the recorded points."""
    chatter = sound(coupled={BOND: Coupled(1.4, 0.5, 1.0, 800.0, 0.5, 800.0)}, stated_error={"car.lf.velocity": 1e-3})
    assert chatter.verdict.grade is Grade.NOT_USABLE
    assert not chatter.acceptable
    assert "280 %" in only(chatter.verdict, "local error of a bond").figure


def test_a_run_with_an_unknown_error_is_acceptable_but_graded_unknown():
    result = sound(stated_error={}, tolerance=0.0)
    assert result.acceptable
    assert result.verdict.grade is Grade.UNKNOWN


def test_the_energy_beyond_the_fitted_velocities_is_limited_like_the_time():
    """A shock that is beyond its fitted range for a short time, but dissipates most of its energy then."""
    time = np.linspace(0.0, 10.0, 1001)
    beyond = (time > 9.9).astype(float)
    series = TimeSeries.from_channels(
        time, {"lf.beyond_fit": ("1", beyond), "lf.dissipated_power": ("W", 1.0 + 1e4 * beyond)}
    )
    reason = only(sound(series=series, share_beyond_fit={"lf": 0.01}).verdict, "mostly outside the fitted velocities")
    assert "99.0% of its energy" in reason.figure


def test_the_verdict_of_a_run_is_written_to_its_json(tmp_path):
    result = sound(converged=False)
    result.write(tmp_path)
    document = json.loads((tmp_path / "result.json").read_text())
    assert document["verdict"]["grade"] == "not usable"
    assert Verdict.from_json(document["verdict"]) == result.verdict
