"""Main effects and interactions of constructed measures whose terms are known."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from cosim.study.choice.sensitivity import Factor, factors_of, indices_of, levels_of, sensitivities_of, sensitivity
from cosim.study.definition import SetupSpace
from eightpost.corners import CORNERS
from tests.unchanged import refusals

from .constructed import result

FACTORS = tuple(Factor(corner, ("AA/AA", "B/B", "C/C")) for corner in CORNERS)
LEVELS = np.array(list(product(range(3), repeat=4)))

LF = np.array([-1.0, 0.25, 0.75])
LR = np.array([0.5, -1.0, 0.5])
LF_RF = np.outer([-1.0, 0.0, 1.0], [0.5, -1.0, 0.5])


def constructed(levels: np.ndarray) -> np.ndarray:
    lf, rf, lr, _ = levels.T
    return 10.0 + LF[lf] + LR[lr] + LF_RF[lf, rf]


def test_the_terms_of_a_constructed_measure_are_found():
    found = sensitivity(FACTORS, LEVELS, constructed(LEVELS), "front ride height")
    assert found.mean == pytest.approx(10.0)
    np.testing.assert_allclose(found.main["lf"], LF, atol=1e-14)
    np.testing.assert_allclose(found.main["lr"], LR, atol=1e-14)
    np.testing.assert_allclose(found.main["rr"], 0.0, atol=1e-14)
    np.testing.assert_allclose(found.pairs["lf", "rf"], LF_RF, atol=1e-14)
    assert found.rest == pytest.approx(0.0, abs=1e-14)


def test_shares_of_the_variance_add_up_to_one():
    values = np.random.default_rng(1).normal(size=81)
    found = sensitivity(FACTORS, LEVELS, values)
    shares = [*(found.share(name) for name in found.main), *(found.share(*pair[::-1]) for pair in found.pairs)]
    assert sum(shares) + found.rest_share == pytest.approx(1.0) and len(shares) == 10
    assert found.variance == pytest.approx(values.var())


def test_a_triple_interaction_belongs_to_the_rest():
    contrast = np.array([-1.0, 0.0, 1.0])
    values = contrast[LEVELS[:, 0]] * contrast[LEVELS[:, 1]] * contrast[LEVELS[:, 2]]
    assert sensitivity(FACTORS, LEVELS, values).rest_share == pytest.approx(1.0)


@pytest.mark.parametrize("kept", [45, 80])
def test_a_part_of_the_bank_gives_the_same_terms(kept):
    part = np.random.default_rng(4).permutation(81)[:kept]
    found = sensitivity(FACTORS, LEVELS[part], constructed(LEVELS[part]))
    assert found.method == "fitted"
    np.testing.assert_allclose(found.main["lf"], LF, atol=1e-12)
    np.testing.assert_allclose(found.pairs["lf", "rf"], LF_RF, atol=1e-12)
    assert found.share("lf") == pytest.approx(sensitivity(FACTORS, LEVELS, constructed(LEVELS)).share("lf"))


def test_noise_appears_in_the_rest_with_its_variance():
    deviation = 0.3
    part = np.random.default_rng(5).permutation(81)[:70]
    noise = np.random.default_rng(6).normal(scale=deviation, size=(200, 70))
    rests = [sensitivity(FACTORS, LEVELS[part], constructed(LEVELS[part]) + row).rest for row in noise]
    assert np.mean(rests) == pytest.approx(deviation**2, rel=0.05)


def test_main_effects_are_fitted_if_setups_are_too_few_for_interactions():
    part = np.random.default_rng(7).permutation(81)[:20]
    values = 10.0 + LF[LEVELS[part, 0]] + LR[LEVELS[part, 2]]
    found = sensitivity(FACTORS, LEVELS[part], values)
    assert found.method == "fitted main effects"
    assert not found.pairs
    np.testing.assert_allclose(found.main["lf"], LF, atol=1e-12)


def test_factors_may_have_different_numbers_of_builds():
    factors = (Factor("front", ("A", "B")), Factor("rear", ("A", "B", "C", "D")))
    levels = np.array(list(product(range(2), range(4))))
    values = np.array([-1.0, 1.0])[levels[:, 0]] + np.array([-3.0, -1.0, 1.0, 3.0])[levels[:, 1]]
    found = sensitivity(factors, levels, values)
    assert found.share("front") == pytest.approx(1.0 / 6.0)
    assert found.total("rear") == pytest.approx(5.0 / 6.0)


def test_a_constant_measure_has_no_sensitivities():
    found = sensitivity(FACTORS, LEVELS, np.full(81, 2.0))
    assert [found.share("lf"), found.share("lf", "rr"), found.total("lr"), found.rest_share] == [0.0] * 4


def test_a_study_has_sensitivities_for_every_measure():
    def front(digits: np.ndarray) -> np.ndarray:
        return digits[:, 0] + digits[:, 1] + 0.0

    def rear(digits: np.ndarray) -> np.ndarray:
        return digits[:, 2] + 0.0

    found = {s.measure: s for s in sensitivities_of(result({"front": front, "rear": rear}))}
    assert [found["front"].share(corner) for corner in CORNERS] == pytest.approx([0.5, 0.5, 0.0, 0.0])
    assert [found["rear"].share(corner) for corner in CORNERS] == pytest.approx([0.0, 0.0, 1.0, 0.0])


# ==== Conversion of setups from numbers to factor levels and back ====================================================

BUILDS = ("AA/AA", "B/B", "C/C")


def test_corners_that_are_alike_are_one_factor_with_the_builds_that_they_share():
    space = SetupSpace({"lf": BUILDS, "rf": BUILDS[::-1][:2], "lr": BUILDS}, alike=(("lf", "rf"),))
    assert factors_of(space) == (Factor("lf+rf", ("B/B", "C/C")), Factor("lr", BUILDS))


def test_groups_that_share_a_corner_are_one():
    space = SetupSpace(dict.fromkeys(CORNERS, BUILDS), alike=(("lf", "rf"), ("rf", "rr")))
    assert [factor.name for factor in factors_of(space)] == ["lf+rf+rr", "lr"]


def test_every_setup_comes_back_from_its_levels():
    space = SetupSpace({"lf": BUILDS, "rf": BUILDS[::-1], "lr": BUILDS, "rr": BUILDS[:2]}, alike=(("lf", "rf"),))
    levels = levels_of(space, space.indices)
    np.testing.assert_array_equal(indices_of(space, levels), space.indices)
    assert np.unique(levels, axis=0).shape == (18, 3)
    for setup, row in zip(space, levels, strict=True):
        front, *rear = (factor.builds[level] for factor, level in zip(factors_of(space), row, strict=True))
        assert (front, front, *rear) == tuple(setup.builds.values())


def test_levels_without_sensitivities_are_refused(unchanged):
    alike = LEVELS[LEVELS[:, 0] == LEVELS[:, 1]]
    unchanged(refusals({
        "five setups": lambda: sensitivity(FACTORS, LEVELS[:5], constructed(LEVELS[:5]), "ride height"),
        "two alike": lambda: sensitivity(FACTORS, alike, constructed(alike)),
    }))  # fmt: skip
