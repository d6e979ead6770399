"""What a fit states about its test: the velocity of each block, and the changes when the block is left out."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from builder.reference import Disclosure, validity_member
from eightpost.ident import fit_shock
from eightpost.ident.shock.problem import blocks_of
from eightpost.ident.shock.result import _by_speed
from eightpost.shock import Lpf1
from eightpost.shock.file import shock_uncertainty
from eightpost.uncertainty import FittedParameter, correlation_of, left_out_of
from eightpost.validity import MEMBER, Validity, judged
from tests.ident.test_confidence_figures import runs_of

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


@pytest.mark.nightly
def test_the_order_of_the_runs_does_not_matter(fitted):
    first, second = (left_out_of(fitted(0, *seeds).fit) for seeds in ((1, 2), (2, 1)))
    np.testing.assert_allclose(first.velocity, second.velocity, rtol=1e-3)
    half = len(first.velocity) // 2
    assert min(first.velocity[:half]) > max(first.velocity[half:])  # the blocks of the fastest run come first
    for name in NAMES:
        assert np.dot(first.changes[name], second.changes[name]) == pytest.approx(1.0, abs=1e-3)


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
