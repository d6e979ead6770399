"""The verdict on the rig tests of an identification names what was wrong with them, in which test, and what to do."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from eightpost.corners import CORNERS
from eightpost.ident.preparation import Prepared
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.plan import reasons_of_tests
from eightpost.ident.vehicle.trust import UNUSABLE, Trust
from eightpost.ident.vehicle.vehicle_fit import fit_verdict
from eightpost.uncertainty import TOTAL, MeasuredLevel, MeasureUncertainty
from eightpost.verdict import Grade
from tests.ident.vehicle_uncertainty.test_agreement import BAR, MEANS, SPRING, WEIGHT, of_all, record

EXPERIMENT = Experiment(
    "car",
    tuple(f"{corner}.road" for corner in CORNERS),
    tuple(f"{corner}.force" for corner in CORNERS),
    tuple(f"{corner}.velocity" for corner in CORNERS),
    dict.fromkeys(CORNERS, 3000.0),
)


def reasons(*records, means=None):
    """Return the reasons of tests named a, b, c, ..."""
    names = tuple("abcdefgh"[: len(records)])
    stated = tuple(means or [MEANS] * len(records))
    return reasons_of_tests(Prepared(records, stated, names, CORNERS, (), (), (), {}), EXPERIMENT)


def only(*records, means=None):
    (found,) = reasons(*records, means=means)
    return found


def with_rows(series, **factors):
    """Return a record in which the channels of quantities are multiplied by factors."""
    for name in series.names:
        if (factor := factors.get(name.rpartition(".")[2])) is not None:
            series = series.with_channel(name, series.unit(name), factor * series[name])
    return series


def lifted(series, samples):
    """Return a record in which the right rear tire leaves the ground in the first samples."""
    force = np.where(np.arange(len(series)) < samples, -WEIGHT, series["rr.tire_force"])
    return series.with_channel("rr.tire_force", "N", force)


def test_good_tests_give_no_reason():
    assert reasons(*map(record, range(5)), means=[MEANS] * 5) == ()


def test_a_broken_bar_is_named_with_the_test_that_must_be_repeated():
    found = only(record(0), record(1), record(2, bar={"lf": 0.0, "rf": 0.0}), record(3), record(4))
    share = f"{-100 * BAR / (SPRING + BAR):.0f}"
    assert found.grade is Grade.NOT_USABLE
    assert found.statement == "the anti-roll bar changed between tests"
    assert found.figure.startswith(f"front {share} % of the wheel's rate from a, b, d, e; limit 3 %")
    assert found.origin == "c"
    assert found.remedy == "restore the car and repeat these tests"


def test_a_small_change_limits_the_use_and_a_large_one_forbids_it():
    def grade(factor):
        return only(record(0), record(1), record(2, spring={"lf": factor}), record(3), record(4)).grade

    assert grade(1.10) is Grade.LIMITED
    assert grade(1.25) is Grade.NOT_USABLE


def test_friction_that_falls_is_a_change_within_the_tests():
    falling = of_all(np.linspace(1.0, 0.6, 3000))
    found = only(*[record(seed, friction=falling) for seed in range(5)])
    assert found.statement == "the friction changed within 5 tests"
    assert "from the first to the second half; limit 10 %" in found.figure
    assert only(record(0, friction=falling), *map(record, range(1, 5))).statement.endswith("within a test")


def gentle(size, friction):
    """Return tests with shocks that move and push less, by a factor, with friction that differs between tests."""
    factors = [friction * (0.5 + 0.25 * k) for k in range(5)]
    return [with_rows(record(k, friction=of_all(f)), velocity=size, force=size) for k, f in enumerate(factors)]


@pytest.mark.parametrize(
    ("size", "grade", "statement", "limits"),
    [
        (0.1, Grade.NOT_USABLE, "friction holds the car", "; limits 60 and 30 %"),
        (0.2, Grade.LIMITED, "friction is large beside the shock force", "; limit 25 %"),
    ],
)
def test_friction_that_holds_the_car_is_the_only_reason_of_such_tests(size, grade, statement, limits):
    found = only(*gentle(size, 1.0))
    assert (found.grade, found.statement) == (grade, statement)
    assert found.figure.endswith(limits)


def test_large_friction_limits_the_use_of_a_car_that_slides_and_its_tests_are_compared():
    def rules(*, others):
        tests = [record(seed, friction=of_all(8.0)) for seed in range(4)]
        return {one.rule for one in reasons(*tests, record(4, friction=of_all(8.0), **others))}

    assert "friction is large" in rules(others={})
    assert rules(others={"spring": of_all(1.25)}) > rules(others={})


def test_slow_shocks_that_hardly_rub_slide():
    assert not any("friction" in one.rule for one in reasons(*gentle(0.1, 0.01)))


@pytest.mark.parametrize(("samples", "grade"), [(2, None), (15, Grade.LIMITED), (60, Grade.NOT_USABLE)])
def test_tires_that_lift_limit_the_use_by_the_share_of_the_time(samples, grade):
    tests = [*map(record, range(4)), lifted(record(4), samples)]
    for test in tests:
        assert len(test) == 3000
    found = [reason for reason in reasons(*tests) if "ground" in reason.rule]
    assert [reason.grade for reason in found] == ([] if grade is None else [grade])
    if found:
        assert found[0].origin == "e"
        assert found[0].figure.startswith(f"rr.tire_force for {samples / 30:.1f} % of the time")


def test_tests_without_mean_forces_cannot_show_lifted_tires():
    zero = [dict.fromkeys(MEANS, 0.0)] * 5
    assert not any("ground" in one.rule for one in reasons(*map(record, range(4)), lifted(record(4), 60), means=zero))


def short(seconds, same):
    """Return the reasons that tests give by their length; their roads are the same or not."""
    tests = []
    for seed in range(5):
        drive = np.random.default_rng(0 if same else seed).standard_normal((4, 3000))
        test = record(seed)
        for corner, row in zip(CORNERS, drive, strict=True):
            test = test.with_channel(f"{corner}.road", "m", row)
        tests.append(test.window(0.0, seconds))
    return [(one.grade, one.figure) for one in reasons(*tests) if "short" in one.rule]


def test_short_tests_say_how_long_they_must_be():
    # 4.5 (1 + 8 / 5) = 11.7 and, with the same four roads in all tests, 4.5 (1 + 4) = 22.5
    assert short(15.0, same=False) == []
    assert short(14.0, same=False) == [(Grade.LIMITED, "14 s; 5 tests with 8 inputs need 15 s")]
    assert short(7.0, same=False)[0][0] is Grade.NOT_USABLE
    figure = "16 s; 5 tests with 8 inputs, 4 of them the same in all tests, need 29 s"
    assert short(16.0, same=True) == [(Grade.LIMITED, figure)]


# ---- Verdict on the fit: levels of the car's own tests -------------------------------------------------------------


@dataclass
class Fit:
    """What the verdict needs of a fit."""

    recipe: str = "boggs"
    sources: dict = field(default_factory=lambda: {"a.mat": ""})
    stable: bool = True
    residual: dict = field(default_factory=lambda: {"lf.tire_force": 0.2})
    trust: Trust | None = None
    choice: None = None


def with_errors(errors, **flags):
    """Return the trust in a car whose levels of its own tests have given mean errors, without a variation."""
    levels = {name: (MeasuredLevel(error, 0.0, 0.0, (1.0,)),) for name, error in errors.items()}
    measures = {name: MeasureUncertainty(0.001, 0.0, 0.0, one) for name, one in levels.items()}
    return Trust({}, flags=flags, measures=measures)


def verdict_of(errors, **flags):
    return fit_verdict(Fit(trust=with_errors(errors, **flags)))


@pytest.mark.parametrize(
    ("error", "grade", "limits"),
    [
        (0.0099, Grade.USABLE, ""),
        (0.0101, Grade.LIMITED, "; limits 1 and 2 %"),
        (0.0299, Grade.LIMITED, "; limits 1 and 2 %"),
        (0.0301, Grade.NOT_USABLE, "; limits 3 and 5 %"),
    ],
)
def test_every_recipe_is_judged_by_the_levels_of_its_own_tests(error, grade, limits):
    errors = {"lf.velocity": 0.6 * error, TOTAL: -error * np.sqrt(2.0 - 0.36), "lf.hub_acceleration": 9.0}
    (reason,) = verdict_of(errors).reasons
    assert reason.grade is grade
    assert reason.figure == f"RMS {100 * error:.1f} %, worst {TOTAL} {128.06 * error:.1f} %{limits}"


@pytest.mark.parametrize(
    ("error", "grade"),
    [(0.0199, Grade.USABLE), (0.0201, Grade.LIMITED), (0.0499, Grade.LIMITED), (0.0501, Grade.NOT_USABLE)],
)
def test_one_wrong_level_among_many_right_ones_is_a_reason(error, grade):
    errors = {f"{corner}.{name}": 0.0 for corner in CORNERS for name in ("velocity", "tire_force")}
    (reason,) = verdict_of({**errors, "front.ride_height": error}).reasons
    assert reason.grade is grade
    assert f"worst front.ride_height {100 * error:.1f} %" in reason.figure


def test_a_car_whose_tests_cannot_be_simulated_is_not_usable():
    (reason,) = verdict_of({TOTAL: 0.001}, **{UNUSABLE: "it diverges."}).decisive
    assert (reason.rule, reason.figure) == ("vehicle cannot be simulated", "it diverges")


@pytest.mark.parametrize("trust", [None, Trust({}), Trust({}, measures={TOTAL: MeasureUncertainty(0.5, 0.0)})])
def test_without_measured_errors_a_car_is_at_most_limited_and_a_large_misfit_is_not_usable(trust):
    assert [one.rule for one in fit_verdict(Fit(trust=trust)).reasons] == ["tests not simulated"]
    assert fit_verdict(Fit(residual={"lf.tire_force": 0.31}, trust=trust)).grade is Grade.NOT_USABLE


def test_a_large_misfit_forbids_the_use_even_if_the_levels_are_right():
    fit = Fit(residual={"lf.tire_force": 0.3}, trust=with_errors({TOTAL: 0.001}))
    assert [one.grade for one in fit_verdict(fit).reasons] == [Grade.NOT_USABLE, Grade.USABLE]


def test_flags_of_effects_that_a_linear_model_lacks_are_no_reasons():
    assert len(verdict_of({TOTAL: 0.001}, misfit="It is large.").reasons) == 1
