"""Conversion of setups from numbers to factor levels and back."""

from __future__ import annotations

import numpy as np

from cosim.study.choice.sensitivity import Factor, factors_of, indices_of, levels_of
from cosim.study.definition import SetupSpace
from eightpost.corners import CORNERS

BUILDS = ("AA/AA", "B/B", "C/C")


def test_every_corner_is_a_factor_if_none_are_alike():
    space = SetupSpace({"lf": BUILDS, "rf": BUILDS[:2]})
    assert factors_of(space) == (Factor("lf", BUILDS), Factor("rf", BUILDS[:2]))


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


def test_levels_are_indices_of_the_setups_builds():
    space = SetupSpace({"lf": BUILDS, "rf": BUILDS[::-1], "lr": BUILDS}, alike=(("lf", "rf"),))
    factors = factors_of(space)
    for setup, levels in zip(space, levels_of(space, space.indices), strict=True):
        front, rear = (factor.builds[level] for factor, level in zip(factors, levels, strict=True))
        assert (front, front, rear) == tuple(setup.builds.values())
