"""Numbering of setups."""

import numpy as np
import pytest

from cosim.study import SetupSpace
from eightpost.corners import CORNERS
from eightpost.errors import InputError

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")


def test_seven_builds_at_four_corners_are_the_2401_setups_of_table_7_1():
    assert len(SetupSpace(dict.fromkeys(CORNERS, BUILDS))) == 2401


def test_a_setup_number_is_a_mixed_radix_number_of_the_builds():
    space = SetupSpace({"lf": ("a", "b"), "rf": ("a", "b", "c"), "lr": ("c",)})
    assert space.radices == (2, 3, 1)
    assert space.setup(1 * 3 + 2).builds == {"lf": "b", "rf": "c", "lr": "c"}


def test_numbers_and_setups_are_converted_both_ways():
    space = SetupSpace({"lf": ("a", "b"), "rf": ("a", "b", "c"), "lr": ("c", "a")})
    assert [space.find(setup.builds).index for setup in space] == list(range(12))
    assert (space.digits(space.indices) == [list(np.unravel_index(k, (2, 3, 2))) for k in range(12)]).all()


def test_corners_that_are_alike_reduce_the_setups_but_keep_the_numbers():
    space = SetupSpace(dict.fromkeys(CORNERS, BUILDS), alike=(("lf", "rf"), ("lr", "rr")))
    assert len(space) == 49
    assert all(s.builds["lf"] == s.builds["rf"] and s.builds["lr"] == s.builds["rr"] for s in space)
    free = SetupSpace(dict.fromkeys(CORNERS, BUILDS))
    assert all(free.setup(s.index) == s for s in space)


@pytest.mark.parametrize(
    ("corners", "alike", "message"),
    [
        ({"lf": ()}, (), "lf needs one or more different builds"),
        ({"lf": ("a", "a")}, (), "one or more different builds"),
        ({"lf": ("a",)}, (("lf", "rear"),), "no corner 'rear'"),
        ({"lf": ("a",), "rf": ("b",)}, (("lf", "rf"),), "no build in common"),
    ],
)
def test_invalid_spaces_are_refused(corners, alike, message):
    with pytest.raises(InputError, match=message):
        SetupSpace(corners, alike)


def test_the_message_on_an_unknown_build_suggests_a_similar_one():
    space = SetupSpace(dict.fromkeys(CORNERS, BUILDS))
    with pytest.raises(InputError, match=r"lf cannot have the build 'C/D'.*did you mean C/"):
        space.find(dict.fromkeys(CORNERS, "B/B") | {"lf": "C/D"})
    with pytest.raises(InputError, match="numbered 0 to 2400"):
        space.setup(2401)
