"""Several shocks on many records: pairing, verdict and notes."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import ParameterError
from eightpost.ident.shock.result import digest_of
from eightpost.ident.validation.records import dyno_record, recognise_motion
from eightpost.ident.validation.shocks import (
    keep_verdicts,
    notes_on,
    random_table,
    shock_verdict,
    static_table,
    validate_shocks,
)
from eightpost.rig.dyno_test import DynoConditions, DynoTest
from eightpost.shock import read_shock
from eightpost.verdict import Grade

from .conftest import record, shock_of, sine_path


def test_each_law_is_compared_with_each_record(lagged, static_curve, random_test, bump_test, static_test):
    records = [dyno_record(test, name=str(k)) for k, test in enumerate((random_test(1), bump_test, static_test))]
    study = validate_shocks([static_curve, lagged], records)
    assert list(study.shocks) == ["known Polylinear", "known LPF1"]
    assert [(case.label, case.record.name) for case in study.cases] == [
        (label, name) for name in "012" for label in study.shocks
    ]
    assert len(random_table(study).rows) == 2
    assert len(static_table(study).rows) == 2


def test_the_verdict_is_kept_in_the_file_of_each_shock_that_was_compared(lagged, static_test, tmp_path):
    """The second shock is of another build than the record, so there is nothing to say about it."""
    other = replace(lagged, name="other", conditions={**lagged.conditions, "build": "X"})
    test = replace(static_test, conditions=DynoConditions(build="A"))
    study = validate_shocks([lagged, other], [dyno_record(test, name="static")])
    paths = [tmp_path / "lagged.json", tmp_path / "other.json"]
    assert [*keep_verdicts(study, paths)] == paths[:1]
    assert not paths[1].exists()
    kept = read_shock(paths[0])
    assert kept.law == lagged.law
    assert {reason.rule for reason in shock_verdict(study.of_shock(next(iter(study.shocks)))).reasons} <= {
        reason.rule for reason in kept.validity.verdict.reasons
    }


def test_shocks_of_one_name_and_law_are_numbered(lagged, random_test):
    study = validate_shocks([lagged, lagged], [dyno_record(random_test(1))])
    assert list(study.shocks) == ["known LPF1", "known LPF1 (2)"]


@pytest.mark.parametrize(
    ("stated", "conditions", "why"),
    [
        ({"clicks": 2}, DynoConditions(), ""),
        ({"build": "A"}, DynoConditions(build="a"), ""),
        ({"build": "A"}, DynoConditions(build="B"), "the build of the fit is 'A', that of the record 'B'"),
        ({"gas_pressure [Pa]": 5e5}, DynoConditions(gas_pressure=1e6),
         "the gas pressure of the fit is 5 bar, that of the record 10 bar"),
    ],
)  # fmt: skip
def test_records_under_other_conditions_are_left_out_and_the_verdict_says_why(
    truth, random_test, stated, conditions, why, monkeypatch
):
    monkeypatch.setenv("EIGHTPOST_UNITS", "si")
    study = validate_shocks([shock_of(truth, **stated)], [dyno_record(random_test(1, conditions))])
    together = not why
    assert len(study.cases) == together
    assert why in str(shock_verdict(study).reasons)
    assert shock_verdict(study).is_acceptable is together
    assert bool(study.unpaired) is not together
    assert bool(notes_on(study)) is not together


def test_the_record_of_the_fit_is_recognised(lagged, random_test):
    own = replace(lagged, inputs=({"name": "fit.csv", "sha256": digest_of(random_test(1))},))
    study = validate_shocks([own], [dyno_record(random_test(1)), dyno_record(random_test(2))])
    assert [case.is_fit_record for case in study.cases] == [True, False]
    (reason,) = [reason for reason in shock_verdict(study).reasons if "validates nothing" in reason.statement]
    assert (reason.grade, reason.figure) == (Grade.LIMITED, "1 of 2 predictions")
    alone = shock_verdict(validate_shocks([own], [dyno_record(random_test(1))]))
    assert [reason.rule for reason in alone.reasons] == ["not validated"]  # an error of the fit is no validation
    too_much = shock_verdict(validate_shocks([own], [dyno_record(random_test(1))]), 1e-3)
    assert "large error of a prediction" in {reason.rule for reason in too_much.reasons}


def test_a_record_that_is_mostly_beyond_the_fit_is_not_acceptable(truth, random_test):
    narrow = replace(truth, curve=replace(truth.curve, compression_speed=0.1, rebound_speed=0.1))
    study = validate_shocks([shock_of(narrow)], [dyno_record(random_test(1))])
    assert study.cases[0].outcome.beyond > 0.5
    assert shock_verdict(study).grade is Grade.NOT_USABLE
    assert "record mostly outside the fitted velocities" in {r.rule for r in shock_verdict(study).decisive}


def test_the_verdict_depends_on_the_limit(lagged, static_curve, random_test):
    record = dyno_record(random_test(1))
    assert shock_verdict(validate_shocks([lagged], [record]), 1.0).grade is Grade.USABLE
    assert shock_verdict(validate_shocks([static_curve], [record]), 1.0).grade is Grade.NOT_USABLE


def test_a_different_zero_of_the_load_cell_is_reported(truth, random_test):
    shifted = shock_of(replace(truth, port=replace(truth.port, gas_preload=0.0)))
    study = validate_shocks([shifted], [dyno_record(random_test(1))])
    assert "offset of a prediction" in {reason.rule for reason in shock_verdict(study).reasons}
    assert study.cases[0].outcome.prediction.offset == pytest.approx(truth.port.gas_preload, abs=0.5)


def test_a_study_needs_a_shock_and_a_record(lagged):
    with pytest.raises(ParameterError, match="1 and 0"):
        validate_shocks([lagged], [])


@pytest.mark.parametrize("segment", [(1.0, 4.1), (-0.1, 1.0), (2.0, 2.0)])
def test_a_segment_must_be_within_every_record(lagged, bump_test, segment):
    record = dyno_record(bump_test, name="run 7")
    with pytest.raises(ParameterError, match=r"run 7 lasts 3 s, and the segment from .* both from 0 to 3 s"):
        validate_shocks([lagged], [record], segment=segment)
    validate_shocks([lagged], [record], segment=(0.0, 3.0))


def test_a_segment_applies_to_every_kind_of_record(lagged, random_test, sine_test, bump_test, static_test):
    tests = {"random": random_test(1), "sine": sine_test(0.5, 5.0), "bump": bump_test, "static": static_test}
    records = [dyno_record(test, kind=kind) for kind, test in tests.items()]
    for one in records:
        duration = one.test.series.duration
        segment = (0.1 * duration, 0.6 * duration)
        whole, part = (validate_shocks([lagged], [one], segment=given).cases[0] for given in (None, segment))
        assert whole.outcome.rms != part.outcome.rms


@pytest.mark.parametrize(("amplitude", "velocity"), [(1.0, 6.0), (1.0, 30.0), (0.25, 10.0), (0.1, 10.0)])
def test_a_sine_of_table_3_3_is_a_sine_of_its_frequency(sine_test, amplitude, velocity):
    seen = recognise_motion(sine_test(amplitude, velocity))
    assert seen.kind == "sine"
    assert seen.frequency == pytest.approx(velocity / (2.0 * np.pi * amplitude), rel=2e-3)


def test_the_multisine_is_random(random_test):
    assert recognise_motion(random_test(1)).kind == "random"


def test_steps_with_long_holds_are_static(static_test):
    assert recognise_motion(static_test).kind == "static"


def test_a_fast_step_is_a_bump(bump_test):
    assert recognise_motion(bump_test).kind == "bump"


@pytest.mark.parametrize("name", ["static_test", "bump_test"])
def test_the_velocity_is_integrated_if_displacement_was_not_measured(request, name):
    test = request.getfixturevalue(name)
    assert recognise_motion(DynoTest(test.series.select(("velocity", "force")))).kind == name.partition("_")[0]


def test_one_period_is_no_sine_test(truth):
    assert recognise_motion(record(truth, sine_path(0.5, 5.0, periods=1), 2000.0)).kind != "sine"


def test_a_given_kind_takes_precedence_over_the_recognised_one(sine_test):
    record = dyno_record(sine_test(0.1, 5.0), kind="random")
    assert (record.kind, record.reason) == ("random", "given by the user")
