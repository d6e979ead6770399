"""Spreads of constructed measures: certain and uncertain differences, and properties of the draws."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.study.choice.robust import Spread, Uncertain, drawn_studies, read_spreads, spreads_of, write_spreads
from cosim.study.definition import Term
from eightpost.errors import FileFormatError, InputError
from eightpost.uncertainty import LeftOutBlocks

from .constructed import independent, result, study

COVARIANCE = np.array([[4e-4, -1e-4], [-1e-4, 1e-4]])
SHOCK = Uncertain("C/B", ("compression_scale", "rebound_scale"), np.array([1.0, 1.0]), COVARIANCE)


def spread(values: list[float], draws: np.ndarray | None = None, **noise: float) -> Spread:
    sampled = np.empty((0, len(values))) if draws is None else draws
    return Spread("ride height", np.arange(len(values)), np.array(values), sampled, **noise)


def parameters(studies, build: str, name: str) -> np.ndarray:
    return np.array([drawn.bank[build].parameters[name] for drawn in studies])


def test_draws_have_the_covariance_that_they_are_drawn_from():
    studies = drawn_studies(study(("front",)), [SHOCK], draws=2000)
    drawn = np.stack([parameters(studies, "C/B", name) for name in SHOCK.names])
    np.testing.assert_allclose(drawn.mean(axis=1), 1.0, atol=1e-4)
    np.testing.assert_allclose(np.cov(drawn), COVARIANCE, rtol=0.1)


def test_parts_with_the_same_test_are_drawn_with_the_correlation_of_their_fits():
    blocks = LeftOutBlocks.of(np.linspace(0.1, 0.2, 20), {"compression_scale": np.sin(np.arange(20.0))})
    names, values, covariance = ("rebound_scale", "compression_scale"), np.ones(2), np.diag([9e-4, 1e-4])
    parts = [Uncertain(build, names, values, covariance, left_out=blocks) for build in ("C/B", "C/C")]
    studies = drawn_studies(study(("front",)), parts, draws=500)
    drawn = np.stack([parameters(studies, build, name) for build in ("C/B", "C/C") for name in names])
    np.testing.assert_allclose(drawn[1], drawn[3])  # one error
    np.testing.assert_allclose(drawn.std(axis=1), [0.03, 0.01, 0.03, 0.01], rtol=0.05)
    assert np.abs(np.corrcoef(drawn)[[0, 0, 1], [1, 2, 2]]).max() < 0.15


def test_the_same_seed_draws_the_same_studies():
    first, again, other = (drawn_studies(study(("front",)), [SHOCK], draws=4, seed=s) for s in (1, 1, 2))
    assert first == again
    assert first != other


def test_only_the_uncertain_part_is_drawn():
    car = independent("car", {"lf.friction_force": (60.0, 5.0)})
    for drawn in drawn_studies(study(("front",)), [SHOCK, car], draws=3):
        assert set(drawn.bank["C/B"].parameters) == set(SHOCK.names)
        assert not drawn.bank["C/C"].parameters
        assert set(drawn.vehicle.parameters) == {"lf.friction_force"}


def test_draws_are_limited_to_the_bounds():
    lag = independent("C/B", {"time_constant": (1e-3, 1e-3)}, lowest=1e-4)
    drawn = parameters(drawn_studies(study(("front",)), [lag], draws=50), "C/B", "time_constant")
    assert drawn.min() == 1e-4


def test_one_part_may_have_two_uncertainties():
    lag = independent("C/B", {"time_constant": (1e-3, 1e-5)})
    drawn = drawn_studies(study(("front",)), [SHOCK, lag], draws=2)[0]
    assert set(drawn.bank["C/B"].parameters) == {"compression_scale", "rebound_scale", "time_constant"}


@pytest.mark.parametrize(
    ("covariance", "what"),
    [
        (np.array([[1.0, 0.5], [0.0, 1.0]]), "not symmetric"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), "negative variances"),
        (np.eye(3), "square covariance"),
    ],
)
def test_an_invalid_covariance_is_refused(covariance, what):
    with pytest.raises(InputError, match=what):
        Uncertain("C/B", ("compression_scale", "rebound_scale"), np.ones(2), covariance)


def test_the_message_on_an_unknown_part_lists_the_parts():
    with pytest.raises(InputError, match=r"no part 'D/D'.*AA/AA"):
        drawn_studies(study(("front",)), [independent("D/D", {"time_constant": (1.0, 1.0)})], draws=2)


def test_an_error_that_all_setups_share_does_not_hide_which_is_better():
    shared = np.random.default_rng(1).normal(size=(64, 1))
    found = spread([1.0, 1.1, 1.2], np.array([1.0, 1.1, 1.2]) + shared)
    assert (found.deviation > 0.5).all()
    assert found.worse_than(0).tolist() == [False, True, True]


def test_independent_errors_make_close_setups_a_tie():
    own = np.random.default_rng(2).normal(scale=0.1, size=(64, 3))
    found = spread([1.0, 1.1, 2.0], np.array([1.0, 1.1, 2.0]) + own)
    assert found.worse_than(0).tolist() == [False, False, True]


def test_a_difference_of_two_runs_has_twice_the_variance_of_one():
    found = spread([1.0, 2.0], run_to_run=0.3)
    _, deviation = found.difference(0)
    assert deviation.tolist() == pytest.approx([0.0, 0.3 * np.sqrt(2.0)])
    assert found.deviation.tolist() == pytest.approx([0.3, 0.3])


def test_more_runs_resolve_smaller_differences():
    once, often = (spread([1.0, 1.5], run_to_run=0.3, runs=runs) for runs in (1, 9))
    assert [found.worse_than(0)[1] for found in (once, often)] == [False, True]


def test_equal_setups_are_rarely_called_different():
    generator = np.random.default_rng(3)
    noise = 0.1
    claims = 0
    for _ in range(2000):
        seen = 1.0 + noise * generator.normal(size=2)
        claims += int(spread(seen.tolist(), run_to_run=noise).worse_than(int(seen.argmin())).sum())
    assert claims / 2000 == pytest.approx(0.0455, abs=0.015)  # two-sided, beyond two standard deviations


def test_a_spread_contains_the_setups_that_every_draw_has():
    def front(scale: float):
        return lambda digits: scale * digits.sum(axis=1)

    nominal = result({"front": front(1.0)})
    draws = [result({"front": front(s)}, kept=np.array(k)) for s, k in ((0.9, [0, 3, 8]), (1.1, [0, 1, 3, 8]))]
    (found,) = spreads_of(nominal, draws, {"front": 0.5}, runs=4)
    assert found.setups.tolist() == [0, 3, 8]
    np.testing.assert_allclose(found.values, [0.0, 3.0, 2.0])
    np.testing.assert_allclose(found.deviation, np.sqrt(0.02 * found.values**2 + 0.0625))


def test_noise_of_a_measure_that_the_study_lacks_is_refused():
    with pytest.raises(InputError, match="did you mean 'front'"):
        spreads_of(result({"front": lambda digits: digits.sum(axis=1)}), [], {"frnt": 0.5})


@pytest.mark.parametrize("draws", [0, 3])
def test_spreads_are_read_back_from_their_file(tmp_path, draws):
    sampled = np.random.default_rng(4).normal(size=(draws, 3))
    kept = spread([1.0, np.nan, 2.0], sampled, run_to_run=0.5, runs=2)
    write_spreads([kept], tmp_path / "robust.parquet", digest="a")
    (found,) = read_spreads(tmp_path / "robust.parquet", digest="a")
    assert (found.measure, found.run_to_run, found.runs) == ("ride height", 0.5, 2)
    for one, other in ((found.setups, kept.setups), (found.values, kept.values), (found.draws, kept.draws)):
        np.testing.assert_array_equal(one, other)


def test_the_objective_has_its_own_spread():
    measures = {"front": lambda digits: 1.0 + digits.sum(axis=1), "rear": lambda digits: 2.0 + digits[:, 0]}
    study = result(measures, objective=(Term("front", 2.0, "m"), Term("rear", 3.0, "m")))
    spreads = {found.measure: found for found in spreads_of(study, [], {"front": 0.5, "rear": 0.25}, runs=4)}
    assert list(spreads) == ["objective", "front", "rear"]
    np.testing.assert_allclose(spreads["objective"].values, 2.0 * study.values("front") + 3.0 * study.values("rear"))
    np.testing.assert_array_equal(spreads["front"].values, study.values("front"))
    # Averages of four runs with independent measures.
    expected = {"front": 0.25, "rear": 0.125, "objective": np.hypot(2.0 * 0.25, 3.0 * 0.125)}
    for name, deviation in expected.items():
        np.testing.assert_allclose(spreads[name].deviation, deviation)


def test_spreads_of_another_study_are_refused(tmp_path):
    write_spreads([spread([1.0, 2.0])], tmp_path / "robust.parquet", digest="a")
    with pytest.raises(FileFormatError, match="belongs to another study"):
        read_spreads(tmp_path / "robust.parquet", digest="b")


def test_a_spread_needs_two_draws_and_may_have_one_setup():
    assert spread([1.0], np.array([[1.0], [3.0]])).deviation == pytest.approx(np.sqrt(2.0))
    with pytest.raises(InputError, match="a spread cannot be computed from one draw"):
        spread([1.0, 2.0], np.ones((1, 2)))
