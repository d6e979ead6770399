"""Setups are numbered without gaps, and back."""

import numpy as np
import pytest

from cosim.study import SetupSpace
from eightpost.errors import InputError

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")
CORNERS = ("lf", "rf", "lr", "rr")


def test_seven_builds_at_four_corners_are_the_2401_setups_of_table_7_1():
    assert len(SetupSpace(dict.fromkeys(CORNERS, BUILDS))) == 2401


def test_a_number_is_written_in_the_radices_of_the_corners():
    space = SetupSpace({"lf": ("a", "b"), "rf": ("a", "b", "c"), "lr": ("c",)})
    assert space.radices == (2, 3, 1)
    assert space.setup(1 * 3 + 2).builds == {"lf": "b", "rf": "c", "lr": "c"}


def test_every_number_finds_its_setup_and_back():
    space = SetupSpace({"lf": ("a", "b"), "rf": ("a", "b", "c"), "lr": ("c", "a")})
    assert [space.find(setup.builds).index for setup in space] == list(range(12))
    assert (space.digits(space.indices) == [list(np.unravel_index(k, (2, 3, 2))) for k in range(12)]).all()


def test_corners_that_are_alike_leave_setups_out_and_keep_the_numbers():
    space = SetupSpace(dict.fromkeys(CORNERS, BUILDS), alike=(("lf", "rf"), ("lr", "rr")))
    assert len(space) == 49
    assert all(s.builds["lf"] == s.builds["rf"] and s.builds["lr"] == s.builds["rr"] for s in space)
    free = SetupSpace(dict.fromkeys(CORNERS, BUILDS))
    assert all(free.setup(s.index) == s for s in space)


@pytest.mark.parametrize(
    ("corners", "alike", "said"),
    [
        ({"lf": ()}, (), "lf needs a build"),
        ({"lf": ("a", "a")}, (), "each once"),
        ({"lf": ("a",)}, (("lf", "rear"),), "no corner 'rear'"),
        ({"lf": ("a",), "rf": ("b",)}, (("lf", "rf"),), "no build in common"),
    ],
)
def test_spaces_that_hold_nothing_are_refused(corners, alike, said):
    with pytest.raises(InputError, match=said):
        SetupSpace(corners, alike)


def test_a_setup_that_is_none_is_refused_with_what_is_close():
    space = SetupSpace(dict.fromkeys(CORNERS, BUILDS))
    with pytest.raises(InputError, match=r"lf cannot have the build 'C/D'.*did you mean C/"):
        space.find(dict.fromkeys(CORNERS, "B/B") | {"lf": "C/D"})
    with pytest.raises(InputError, match="numbered 0 to 2400"):
        space.setup(2401)
