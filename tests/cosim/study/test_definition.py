"""Numbering of setups, and studies that are refused before anything runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.study import Build, Drive, Measure, SetupSpace, Term, Vehicle
from cosim.study.running.sweep import Sweep
from eightpost.corners import CORNERS
from eightpost.errors import FmuError, InputError, StepError, WiringError

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


# ==== Invalid studies are refused before any simulation ==============================================================

HEIGHT = ("car.front.ride_height",)


@pytest.fixture
def refused(small_study, tmp_path):
    """Return a function refused(error, message, **changes) that checks that a study is refused."""

    def check(error, message, **changes):
        with pytest.raises(error, match=message):
            Sweep(small_study(**changes), tmp_path / "out")
        assert not (tmp_path / "out").exists()

    return check


def test_a_corner_without_a_shock_is_refused(refused):
    refused(InputError, "rr has no shock", corners=dict.fromkeys(CORNERS[:3], ("soft",)))


def test_a_corner_that_the_vehicle_does_not_have_is_refused(refused):
    refused(InputError, "no port 'middle'", corners=dict.fromkeys((*CORNERS, "middle"), ("soft",)))


def test_a_build_with_a_missing_file_is_refused(refused, tmp_path):
    bank = {"soft": Build(tmp_path / "none.fmu"), "stiff": Build(tmp_path / "none.fmu")}
    refused(FmuError, "none.fmu", bank=bank)


def test_a_build_that_is_not_a_shock_is_refused(refused, fmus):
    refused(WiringError, "has no variable 'velocity'", bank=dict.fromkeys(("soft", "stiff"), Build(fmus["seven_dof"])))


def test_a_parameter_that_a_shock_does_not_have_is_refused(refused, fmus):
    bank = {"soft": Build(fmus["lpnl2"]), "stiff": Build(fmus["lpnl2"], {"stifness": 1.0})}
    refused(WiringError, "no variable 'stifness'", bank=bank)


def test_a_measure_of_an_unknown_channel_is_refused(refused):
    message = r"measure 'camber': car\.lf\.camber: component 'car' has no variable 'lf.camber'"
    refused(WiringError, message, measures=(Measure("camber", ("car.lf.camber",)),))


def test_a_measure_with_a_display_unit_of_another_dimension_is_refused(refused):
    refused(
        InputError, "cannot be converted to the display unit 'lbf'", measures=(Measure("h", HEIGHT, display="lbf"),)
    )


def test_an_objective_with_a_weight_unit_of_another_dimension_is_refused(refused):
    terms = (Term("front ride height, RMS", 1.0, "lbf"),)
    refused(InputError, "cannot be converted to 'lbf', the unit of its weight", objective=terms)


@pytest.mark.parametrize("statistic", ["mean", "variation", "maximum", "rms_with_mean"])
def test_a_mean_is_refused_if_the_vehicles_gain_at_0_hz_is_not_trusted(refused, fmus, statistic):
    untrusted = Vehicle(fmus["seven_dof"], means_trusted=False)
    refused(InputError, "no trusted gain at 0 Hz", vehicle=untrusted, measures=(Measure("h", HEIGHT, statistic),))


def test_measures_independent_of_the_mean_need_no_trusted_gain_at_0_hz(small_study, fmus, tmp_path):
    untrusted = Vehicle(fmus["seven_dof"], means_trusted=False)
    measures = (Measure("r", HEIGHT), Measure("p", HEIGHT, "peak"), Measure("m", HEIGHT, "mean", band=(0.5, 9.0)))
    assert Sweep(small_study(vehicle=untrusted, measures=measures), tmp_path / "out").left == 16


def test_a_section_beyond_the_run_is_refused(refused):
    refused(InputError, "section 1 to 9 s must lie", measures=(Measure("h", HEIGHT, section=(1.0, 9.0)),))


def test_a_band_above_the_recorded_frequencies_is_refused(refused):
    refused(InputError, "smaller record_step", measures=(Measure("h", HEIGHT, band=(1.0, 200.0)),))


def test_a_user_defined_measure_that_does_not_exist_is_refused(refused):
    refused(InputError, "no Python file", measures=(Measure("h", HEIGHT, function="none.py:f"),))


def test_a_run_beyond_the_end_of_its_drive_file_is_refused(refused, small_study):
    drive = small_study().drives[0]
    refused(InputError, "contains 0 to 30 s", drives=(replace(drive, start=28.0),))


def test_a_drive_with_an_unknown_target_is_refused(refused, small_study):
    drive = small_study().drives[0]
    refused(WiringError, "nowhere", drives=(replace(drive, targets={"lf.road": "car.nowhere"}),))


def test_a_study_without_drives_or_with_duplicate_drive_names_is_refused(refused, small_study):
    drive: Drive = small_study().drives[0]
    refused(InputError, "has no drive", drives=())
    refused(InputError, "two drives are called 'track'", drives=(drive, drive))


def test_an_fmu_that_fails_in_every_setup_ends_the_study_with_its_message(small_study, here, fmus, tmp_path):
    bad = Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0})
    sweep = Sweep(small_study(bank={"soft": bad, "stiff": bad}), tmp_path / "out")
    with pytest.raises(StepError, match=r"no setup could be run.*lag_zero_force"):
        sweep.coupling(here)
