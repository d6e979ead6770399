"""Effects of the entries of an uncertainty file, and the check of linear effects by simulated draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.study.choice import robust
from cosim.study.choice.assess import Knowledge
from cosim.study.choice.certainty import Effect, VehicleSource
from cosim.study.choice.robust import Spread, Uncertain, Uncertainty, knowledge_of, linearity_check
from cosim.study.choice.sources import UncertainParameter, error_sources
from eightpost.errors import InputError
from eightpost.validity import ParameterUncertainty

from .constructed import independent, result

STUDY = result({"a": lambda digits: 1.0 + digits.sum(axis=1)}, builds=("B/B", "C/C"))

#: Values in the study, and ln(changed / nominal) of the measure by a deviation of the parameter at each corner.
VALUES, SLOPES = {"lag": 1.0, "scale": 2.0, "gas": 3.0}, {"lag": 0.03, "scale": 0.04, "gas": 0.05}


@pytest.fixture
def known(monkeypatch):
    """A function of an uncertainty file's entries for a study whose FMUs state `lag` and `gas` of B/B, and no C/C."""
    stated = [UncertainParameter("B/B", VALUES[name], ParameterUncertainty(name, 0.1)) for name in ("lag", "gas")]

    def effects_of(_result, parameters, _sweep, _workers, _progress, *, vehicles):
        cars = [Effect("car", path.name, 1.0, 0.0, {"a": 0.2}, {}) for path in vehicles]
        return *map(effect, parameters), *cars

    def effect(one):
        name, corners = one.stated.name, STUDY.study.corners
        at = {corner: {one.part: {"a": SLOPES[name]}} for corner in corners}
        return Effect(one.part, name, one.stated.deviation, 0.0, {}, at)

    def values(_fmu, _parameters, names):
        return {name: VALUES[name] for name in names if name in VALUES}

    monkeypatch.setattr(robust, "stated_parameters", lambda _: (stated, ("C/C",), ("a note",)))
    monkeypatch.setattr(robust, "effects_of", effects_of)
    monkeypatch.setattr(robust, "parameter_values", values)
    return lambda *parts, vehicles=(): knowledge_of(
        STUDY, Uncertainty(parts, vehicles=vehicles), {"a": 0.5}, None, None
    )


def test_an_entry_of_the_file_replaces_what_the_fmu_states_about_the_same_parameter(known):
    found = known(independent("B/B", {"lag": (1.0, 0.2)}), independent("C/C", {"scale": (2.0, 0.3)}))
    rows = [(one.part, one.parameter, one.deviation) for one in found.effects]
    assert rows == [("B/B", "gas", 0.1), ("B/B", "lag", 0.2), ("C/C", "scale", 0.3)]
    assert (found.unstated, found.run_to_run, found.notes) == ((), {"a": 0.5}, ("a note",))


def test_a_value_of_the_file_more_than_a_deviation_from_the_studys_is_reported(known):
    near, far = (known(independent("B/B", {"lag": (value, 0.2)})).notes for value in (1.15, 1.25))
    assert near == ("a note",)
    assert far[1:] == (
        "B/B: the study has lag = 1, the uncertainty file 1.25; only its deviation is used",
    )  # fmt: skip


@pytest.mark.parametrize("correlation", [-0.6, 0.0, 0.5, 1.0])
def test_correlated_parameters_change_a_setup_with_the_variance_of_their_covariance(known, correlation):
    deviations = np.array([0.2, 0.3])
    covariance = np.outer(deviations, deviations) * np.array([[1.0, correlation], [correlation, 1.0]])
    entry = Uncertain("B/B", ("lag", "scale"), np.array([1.0, 2.0]), covariance)
    sources = error_sources(STUDY, known(entry).effects)
    row = STUDY.row(dict.fromkeys(STUDY.study.corners, "B/B"))
    lag, scale, gas = (4.0 * SLOPES[name] for name in ("lag", "scale", "gas"))  # at four corners
    expected = lag**2 + scale**2 + 2.0 * correlation * lag * scale + gas**2
    assert sources.shock_covariance(np.array([row]), 0, 0) == pytest.approx(expected)


def test_combinations_of_correlated_parameters_are_named_after_both(known):
    entry = Uncertain("B/B", ("lag", "scale"), np.array([1.0, 2.0]), np.array([[0.04, 0.03], [0.03, 0.09]]))
    names = [one.parameter for one in known(entry).effects]
    assert names == ["gas", "lag and scale, combination 1", "lag and scale, combination 2"]


def test_the_vehicles_uncertainty_is_the_models_unless_the_file_adds_to_it_or_replaces_it(known):
    car = independent("car", {"scale": (2.0, 0.1)})
    assert known().vehicle is VehicleSource.MODEL
    assert known(car).vehicle is VehicleSource.ADDED
    replaced = known(car, vehicles=(Path("other.fmu"),))
    assert replaced.vehicle is VehicleSource.REPLACED and replaced.effects[-1].parameter == "other.fmu"


@pytest.mark.parametrize(
    ("part", "name", "message"),
    [
        ("D/D", "lag", "there is no part 'D/D'; the parts are car, B/B, C/C"),
        ("C/C", "none_such", "C/C: C-C.fmu has no parameter 'none_such'; remove it from the file"),
    ],
)
def test_an_entry_that_the_study_lacks_is_refused_by_name(known, part, name, message):
    with pytest.raises(InputError, match=message):
        known(independent(part, {name: (1.0, 0.1)}))


@pytest.fixture
def checked():
    """A function of the simulated deviations of four setups, for a lag of B/B at the right rear corner."""
    lag = Effect("B/B", "lag", 1.0, 0.0, {}, {"rr": {"B/B": {"a": 0.1}}})
    setups = STUDY.setups[:4]  # B/B, C/C at rr in turn; the levels are 1, 2, 2, 3
    levels = STUDY.values("a")[:4]

    def check(*deviations, measure="a", values=levels):
        draws = levels + np.outer([-1.0, 0.0, 1.0], deviations)
        return linearity_check(STUDY, Knowledge((lag,)), [Spread(measure, setups, values, draws)])

    return check


def test_draws_that_follow_the_linear_effects_differ_from_them_by_nothing(checked):
    # ln(changed / nominal) = 0.1 for B/B at rr: the leader and the third setup (level 2) vary, the other two do not
    assert STUDY.builds("rr")[:4] == ["B/B", "C/C", "B/B", "C/C"]
    found = checked(0.1, 0.0, 0.2, 0.0)
    assert found.linear == pytest.approx(0.1) and found.simulated == pytest.approx(found.linear) and found.draws == 3


def test_the_largest_difference_from_the_linear_effects_is_stated_by_its_setup(checked):
    found = checked(0.1, 0.0, 0.2, 0.3)  # the last one varies by 0.2 against the leader, not by the 0.1 of the effect
    assert (found.setup, found.linear, found.simulated) == pytest.approx((STUDY.setups[3], 0.1, 0.2))
    assert found.summary().endswith(f"differs most for setup {STUDY.setups[3]}, a: -50 %")
    too_wide = checked(0.1, 0.06, 0.2, 0.0)
    assert (too_wide.setup, too_wide.summary()[-6:]) == (STUDY.setups[1], "+150 %")


def test_a_difference_that_hardly_varies_is_not_checked(checked):
    assert checked(0.1, 0.095, 0.2, 0.0).setup != STUDY.setups[1]  # by 0.005, a twentieth of the others


def test_without_draws_of_a_measure_of_the_study_nothing_is_checked(checked):
    assert checked(0.1, 0.0, 0.2, 0.0, measure="objective") is None
    assert checked(0.1, 0.0, 0.2, 0.0, values=np.full(4, np.nan)) is None
    assert (
        linearity_check(STUDY, Knowledge(), [Spread("a", STUDY.setups, STUDY.values("a"), np.empty((0, 16)))]) is None
    )
