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


def test_of_three_hundred_builds_only_the_setups_with_alike_corners_are_numbered():
    """All combinations, 8.1e9, would not fit into the memory."""
    builds = tuple(f"build {k}" for k in range(300))
    space = SetupSpace(dict.fromkeys(CORNERS, builds), alike=(("lf", "rf"), ("lr", "rr")))
    assert len(space) == 90_000
    assert space.setup(int(space.indices[-2])).builds == dict.fromkeys(("lf", "rf"), builds[299]) | dict.fromkeys(
        ("lr", "rr"), builds[298]
    )


def test_alike_corners_with_different_builds_in_a_different_order_share_those_that_they_have_in_common():
    corners = {"lf": ("a", "b", "c"), "lr": ("x", "y"), "rf": ("c", "d", "a"), "rr": ("a", "c")}
    space = SetupSpace(corners, alike=(("lf", "rf"), ("rf", "rr")))
    found = [tuple(setup.builds.values()) for setup in space]
    assert found == [(one, rear, one, one) for one in ("a", "c") for rear in ("x", "y")]
    assert space.indices.tolist() == sorted(space.indices.tolist())


def test_more_setups_than_the_memory_holds_are_refused_with_advice():
    space = SetupSpace(dict.fromkeys(CORNERS, tuple(map(str, range(3000)))))
    with pytest.raises(InputError, match=r"8.1e\+13 setups, more than the memory holds; name fewer builds"):
        len(space)


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
