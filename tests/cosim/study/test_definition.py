"""Numbering of setups, and studies that are refused before anything runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.study import Build, Measure, SetupSpace, Term, Vehicle
from cosim.study.running.sweep import Sweep
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from tests.unchanged import refusals

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")


def test_seven_builds_at_four_corners_are_the_2401_setups_of_table_7_1():
    assert len(SetupSpace(dict.fromkeys(CORNERS, BUILDS))) == 2401


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


# ==== Invalid studies are refused before any simulation ==============================================================

HEIGHT = ("car.front.ride_height",)


def height(statistic: str = "rms", **options) -> tuple[Measure, ...]:
    return (Measure("h", HEIGHT, statistic, **options),)


REFUSED = {
    "a corner without a shock": lambda *_: {"corners": dict.fromkeys(CORNERS[:3], ("soft",))},
    "no such port": lambda *_: {"corners": dict.fromkeys((*CORNERS, "middle"), ("soft",))},
    "no such FMU": lambda *_: {"bank": dict.fromkeys(("soft", "stiff"), Build("none.fmu"))},
    "a car as a shock": lambda fmus, _: {"bank": dict.fromkeys(("soft", "stiff"), Build(fmus["seven_dof"]))},
    "no such parameter": lambda fmus, _: {
        "bank": {"soft": Build(fmus["lpnl2"]), "stiff": Build(fmus["lpnl2"], {"stifness": 1.0})}},
    "no such channel": lambda *_: {"measures": (Measure("camber", ("car.lf.camber",)),)},
    "another display": lambda *_: {"measures": height(display="lbf")},
    "another weight": lambda *_: {"objective": (Term("front ride height, RMS", 1.0, "lbf"),)},
    "no trusted mean": lambda fmus, _: {
        "vehicle": Vehicle(fmus["seven_dof"], means_trusted=False), "measures": height("variation")},
    "a section beyond the run": lambda *_: {"measures": height(section=(1.0, 9.0))},
    "a band beyond the record": lambda *_: {"measures": height(band=(1.0, 200.0))},
    "no such function": lambda *_: {"measures": height(function="none.py:f")},
    "a drive that is too short": lambda _, drive: {"drives": (replace(drive, start=28.0),)},
    "no such input": lambda _, drive: {"drives": (replace(drive, targets={"lf.road": "car.nowhere"}),)},
    "no drive": lambda *_: {"drives": ()}, "two drives of a name": lambda _, drive: {"drives": (drive, drive)},
}  # fmt: skip


@pytest.mark.slow
def test_an_invalid_study_is_refused_before_anything_is_written(small_study, fmus, tmp_path, unchanged):
    drive, many = small_study().drives[0], SetupSpace(dict.fromkeys(CORNERS, tuple(map(str, range(3000)))))
    calls = {name: lambda made=made: Sweep(small_study(**made(fmus, drive)), tmp_path / "out")
             for name, made in REFUSED.items()}  # fmt: skip
    unchanged(refusals(calls | {"more setups than the memory holds": lambda: len(many)}))
    assert not (tmp_path / "out").exists()


def test_measures_independent_of_the_mean_need_no_trusted_gain_at_0_hz(small_study, fmus, tmp_path):
    untrusted = Vehicle(fmus["seven_dof"], means_trusted=False)
    measures = (Measure("r", HEIGHT), Measure("p", HEIGHT, "peak"), Measure("m", HEIGHT, "mean", band=(0.5, 9.0)))
    assert Sweep(small_study(vehicle=untrusted, measures=measures), tmp_path / "out").left == 16


def test_an_fmu_that_fails_in_every_setup_ends_the_study_with_its_message(small_study, here, fmus, tmp_path):
    bad = Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0})
    sweep = Sweep(small_study(bank={"soft": bad, "stiff": bad}), tmp_path / "out")
    with pytest.raises(StepError, match=r"no setup could be run.*lag_zero_force"):
        sweep.coupling(here)
