"""Spreads of constructed measures: certain and uncertain differences, and properties of the draws."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet
import pytest

from cosim.study.choice.robust import Uncertain, Uncertainty, drawn_studies, spreads_of, write_spreads
from cosim.study.definition import Term
from eightpost.errors import InputError
from eightpost.uncertainty import LeftOutBlocks

from .constructed import independent, result, study

COVARIANCE = np.array([[4e-4, -1e-4], [-1e-4, 1e-4]])
SHOCK = Uncertain("C/B", ("compression_scale", "rebound_scale"), np.array([1.0, 1.0]), COVARIANCE)


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


def test_a_spread_contains_the_setups_that_every_draw_has():
    def front(scale: float):
        return lambda digits: scale * digits.sum(axis=1)

    nominal = result({"front": front(1.0)})
    draws = [result({"front": front(s)}, kept=np.array(k)) for s, k in ((0.9, [0, 3, 8]), (1.1, [0, 1, 3, 8]))]
    (found,) = spreads_of(nominal, draws, [8, 3, 0, 5])
    assert found.setups.tolist() == [0, 3, 8]
    np.testing.assert_allclose(found.values, [0.0, 3.0, 2.0])
    np.testing.assert_allclose(found.draws, np.outer([0.9, 1.1], found.values))


@pytest.mark.parametrize("drawn", [True, False])
def test_the_file_of_spreads_has_the_objective_and_the_stated_noise_of_each_measure(tmp_path, drawn):
    measures = {"front": lambda digits: 1.0 + digits.sum(axis=1), "rear": lambda digits: 2.0 + digits[:, 0]}
    nominal = result(measures, objective=(Term("front", 2.0, "m"), Term("rear", 3.0, "mm")), failed=(1,))
    spreads = spreads_of(nominal, [nominal, nominal] if drawn else [], [0, 1, 8])
    write_spreads(spreads, tmp_path / "robust.parquet", nominal, Uncertainty(run_to_run={"front": 0.5}, runs=4))
    table = pyarrow.parquet.read_table(tmp_path / "robust.parquet")
    assert table.schema.metadata == {b"study": nominal.provenance.digest.encode()}
    rows = {row["measure"]: row for row in table.to_pylist()}
    assert [(name, row["run_to_run"], row["runs"]) for name, row in rows.items()] == [
        ("objective", 1.0, 4), ("front", 0.5, 4), ("rear", 0.0, 4),
    ]  # fmt: skip
    levels = 2.0 * nominal.values("front") + 3000.0 * nominal.values("rear")
    np.testing.assert_allclose(rows["objective"]["values"], levels[[0, 1, 8]])
    assert np.isnan(rows["rear"]["values"][1]) and rows["rear"]["setups"] == [0, 1, 8]
    assert len(rows["front"]["draws"]) == (2 if drawn else 0)
