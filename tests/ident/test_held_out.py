"""Parts of the records are left out of the fit and predicted."""

import json
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from builder.reference import Disclosure, validity_member
from eightpost.errors import ParameterError
from eightpost.ident import fit_shock
from eightpost.ident.shock.law_fit import (
    CrossValidation,
    HeldOut,
    HeldOutErrors,
    LawFit,
    left_out_blocks,
    left_out_groups,
)
from eightpost.ident.shock.problem import blocks_of
from eightpost.ident.shock.result import _by_speed
from eightpost.ident.shock.runs import Runs, prepare
from eightpost.rig.dyno_test import DynoTest
from eightpost.shock import Lpf1
from eightpost.shock.file import shock_uncertainty
from eightpost.signals import TimeSeries
from eightpost.uncertainty import FittedParameter, correlation_of, left_out_of
from eightpost.validity import MEMBER, Validity, judged
from tests.ident.test_confidence_figures import runs_of

RATE = 500.0


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


def held(*percents):
    return HeldOut(tuple((percent / 100.0) ** 2 for percent in percents))


# ---- What is left out -----------------------------------------------------------------------------------------------


def test_the_quarters_are_apart_from_the_rows_that_are_fitted():
    runs = Runs.of([prepare(sine()), prepare(sine())])
    blocks = left_out_blocks(runs)
    predicted = np.concatenate([np.arange(runs.target.size)[part] for block in blocks for part in block.parts])
    assert sorted(predicted.tolist()) == list(range(runs.target.size))
    for block in blocks:
        for part in block.parts:
            assert not block.kept[part].any()
        assert 0.55 < block.kept.mean() < 0.74


def test_a_part_of_every_quarter_is_fitted_so_that_no_speed_of_stepped_sines_is_left_out():
    for block in left_out_blocks(Runs.of([prepare(sine())])):
        assert all(0.4 < quarter.mean() < 0.9 for quarter in np.array_split(block.kept, 4))


@pytest.mark.parametrize(("count", "fits"), [(2, 2), (8, 8), (11, 8)])
def test_each_run_is_left_out_once_by_at_most_eight_fits(count, fits):
    runs = Runs.of([prepare(sine(duration=2.0))] * count)
    left = left_out_groups(runs, range(len(runs.prepared)))
    assert len(left) == fits
    assert sum(len(part.parts) for part in left) == count
    assert all(part.is_whole and not part.kept[part.parts[0]].any() for part in left)


@pytest.mark.parametrize(
    ("speeds", "left_out"), [((0.3,), "quarters"), ((0.3, 0.3), "runs"), ((0.1, 0.3), "quarters"),
                             ((0.1, 0.3, 0.31), "quarters"), ((0.1, 0.11, 0.3, 0.31), "runs")]
)  # fmt: skip
def test_runs_are_left_out_if_each_has_another_of_its_speed_else_quarters(speeds, left_out):
    runs = Runs.of([prepare(sine(speed=speed, duration=4.0)) for speed in speeds])
    assert CrossValidation(SimpleNamespace(runs=runs)).left_out == left_out


@pytest.mark.parametrize(("speeds", "gain", "offset"), [((0.3, 0.3), 4.0 / 3.0, 0.0), ((0.1, 0.3), 1.0, 50.0)])
def test_the_error_on_whole_runs_has_their_size_and_not_their_offset_that_on_quarters_has_both(speeds, gain, offset):
    runs = Runs.of([prepare(sine(speed=speed, duration=4.0)) for speed in speeds])
    counted = np.ones(runs.target.size)
    counted[7], predicted = 0.0, gain * runs.target + 50.0
    predicted[7] = 1e6
    fit = SimpleNamespace(runs=runs, refitted_rows=lambda _: predicted)
    deviations = [2000.0 * speed / np.sqrt(2.0) for speed in speeds]
    expected = 100.0 * np.mean([gain - 1.0 + offset / size for size in deviations])
    assert CrossValidation(fit).errors(counted).percent == pytest.approx(expected, rel=0.02)


# ---- The errors -----------------------------------------------------------------------------------------------------


def test_the_error_is_the_mean_of_the_pieces():
    assert held(1.0, 2.0, 6.0).percent == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("without", "stopped", "is_beaten"),
    [
        ((2.0, 2.0), (1.97, 1.97), False),  # by 1.5 % only
        ((2.0, 2.0), (1.95, 1.95), True),
        ((2.0, 2.0, 2.0), (1.0, 2.1, 2.2), False),  # not by more than one standard error
        ((2.0, 2.1, 19.0, 2.0), (1.0, 1.1, 20.0, 1.0), True),  # one piece that both predict badly does not decide
        ((1.0,), (0.9,), True),
        ((1.0,), (1.1,), False),
    ],
)
def test_an_addition_must_be_better_by_two_percent_and_a_standard_error(without, stopped, is_beaten):
    assert held(*without).is_beaten_by(held(*stopped)) is is_beaten


@pytest.fixture(scope="module")
def record(rising, law_record):
    return law_record(Lpf1(rising, 3e-3), 1, rate=RATE)


def test_a_fit_states_its_error_beside_that_of_lpnl2_on_the_same_quarters(record):
    fit, other = (fit_shock(record, law, segment=(1.0, 5.0)) for law in ("polylinear", "lpnl2"))
    assert fit.held_out.left_out == other.held_out.left_out == "quarters"
    assert fit.held_out.percent > 5.0 * fit.held_out.lpnl2_percent
    assert fit.held_out.lpnl2_percent == pytest.approx(other.held_out.percent, rel=1e-6)
    assert other.held_out.lpnl2_percent is None
    assert fit.shock.fit["held_out"] == json.loads(json.dumps(fit.held_out.to_json()))
    assert set(other.shock.fit["held_out"]) == {"left_out", "percent"}


def test_the_error_is_one_line():
    both = HeldOutErrors("runs", 1.234, 5.678)
    assert str(both) == "held-out error 1.23 % of the force's standard deviation (LPNL2: 5.68 %), on whole runs"
    assert str(HeldOutErrors("quarters", 2.0)).endswith(
        "2 % of the force's standard deviation, on quarters of the record"
    )


@pytest.mark.parametrize("law", ["polylinear", "lpnl2"])
def test_a_law_that_rejects_a_part_of_the_record_has_no_error_and_says_so(law, record, monkeypatch):
    own = LawFit.refitted_rows

    def refitted_rows(found, weights):
        if found.law == "lpnl2":
            raise ValueError("the curve falls")
        return own(found, weights)

    monkeypatch.setattr(LawFit, "refitted_rows", refitted_rows)
    fit = fit_shock(record, law, segment=(1.0, 4.0))
    (note,) = [change for change in fit.changes if "the curve falls" in change]
    if law == "lpnl2":
        assert fit.held_out is None and "held_out" not in fit.shock.fit
        assert note == "no held-out error: a part of the record cannot be fitted: the curve falls"
    else:
        assert fit.held_out.lpnl2_percent is None
        assert note == "no held-out error of LPNL2: the curve falls"


@pytest.mark.parametrize(("given", "law"), [({}, "hysteresis"), ({"recipe": "boggs"}, "lpnl2")])
def test_without_a_name_hysteresis_is_fitted_and_lpnl2_by_the_dissertations_recipe(given, law, record):
    fit = fit_shock(record, segment=(1.0, 4.0), **given)
    assert fit.shock.law_name == law
    assert fit.shock.law.curve.has_knots is (law == "hysteresis")
    assert (fit.held_out is None) is bool(given)


def test_the_choice_among_laws_is_refused_with_a_hint():
    with pytest.raises(ParameterError, match="was removed; omit the law"):
        fit_shock(sine(), "auto")


NAMES = ("compression_scale", "rebound_scale", "time_constant")


@pytest.fixture(scope="module")
def fitted(law_record, rising):
    """Fit the law of one of two shocks, of which the second has twice the lag, to records: fitted(which, seeds)."""
    laws = Lpf1(rising, time_constant=1.7e-3), Lpf1(rising, time_constant=3.4e-3)

    @cache
    def fit(which, *seeds):
        return fit_shock([law_record(laws[which], seed, slower=seed) for seed in seeds], "lpf1").shock

    return fit


@pytest.mark.nightly
def test_shocks_with_the_same_test_have_correlated_errors_and_with_another_test_independent_ones(fitted):
    """The records of the same seed also have the same noise here, relative to the force."""
    first, second, other = (left_out_of(fitted(*which).fit) for which in ((0, 1), (1, 1), (0, 2)))
    assert set(first.changes) == set(NAMES)
    for name in NAMES:
        found = correlation_of([FittedParameter(one, name) for one in (first, second, other)])
        assert 0.5 < found[0, 1] < 1.0
        np.testing.assert_array_equal(found[2], [0.0, 0.0, 1.0])


def test_blocks_are_in_the_order_of_the_speed_of_their_runs_and_those_of_a_run_in_the_order_of_time():
    runs = runs_of((300, 300, 300))
    runs.row_velocity = np.repeat([0.1, -0.3, 0.2], 300)
    blocks = blocks_of(runs)
    starts = [blocks[k].start for k in _by_speed(runs)]
    size = blocks[0].stop
    assert len(starts) == len(blocks) > 20
    assert starts == [*range(300, 600, size), *range(600, 900, size), *range(0, 300, size)]


@pytest.mark.nightly
def test_the_fmu_states_what_the_shock_file_does_and_nothing_for_a_band_without_factors(fitted):
    shock = fitted(0, 1)
    document = json.loads(validity_member(shock, "shock", Disclosure.FULL)[MEMBER])
    assert Validity.from_json(document).uncertainty.left_out == left_out_of(shock.fit)
    band = {name: value for name, value in shock.fit["curve_band"].items() if name != "factor_half_width"}
    assert shock_uncertainty(judged(shock, fit={**shock.fit, "curve_band": band})).left_out is None
