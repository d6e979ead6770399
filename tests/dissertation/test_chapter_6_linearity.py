"""Statements about one input at a time (6.2) are true of paths that were made so, and false of others."""

from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_6_linearity as chapter
from eightpost.ident.linearity import Condition, Path
from eightpost.vehicle import CORNERS
from eightpost.vehicle.statespace import Channel

from .conftest import claims

F = np.arange(1, 251) / 10.0
OUTPUTS = (*(f"{corner}.{kind}" for kind in ("velocity", "tire_force") for corner in CORNERS), "front.ride_height",
           "rear.ride_height")  # fmt: skip
INPUTS = tuple(f"{corner}.{kind}" for kind in ("road", "aero", "force") for corner in CORNERS)


@pytest.fixture
def paths(monkeypatch):
    """Set magnitude and coherence of paths by (output, input); all others have the values 0.01 and 1."""

    def given(levels=None, coherence=None, conditions=()):
        made = []
        for output in OUTPUTS:
            for source in INPUTS:
                H = np.broadcast_to(np.asarray((levels or {}).get((output, source), 0.01), complex), F.shape)
                share = np.broadcast_to(np.asarray((coherence or {}).get((output, source), 1.0)), F.shape)
                one = np.ones(F.size)
                made.append(
                    Path("", Channel(source, ""), Channel(output, ""), F, H, share, one, one, one, 0.1, one, 125.0)
                )
        verdicts = [SimpleNamespace(condition=one) for one in conditions]
        found = SimpleNamespace(paths=tuple(made), verdicts=verdicts)
        monkeypatch.setattr(chapter, "_linearity", lambda _seconds: found)

    return given


def falling(level):
    """Return a response that falls from a level to a tenth of it below 0.6 Hz."""
    return np.where(F < 0.55, 0.1 * level, level)


def test_fig_6_9_states_how_far_other_wheelloaders_are_below_the_nearest(paths, plots):
    """A tenth is -20 dB, a hundredth -40 dB, and their mean is -30 dB; frequencies above 15 Hz do not count."""
    rear = dict(zip(CORNERS, (0.1, 0.01, 1.0, 0.5), strict=True))
    front = dict(zip(CORNERS, (0.1, falling(1.0), 0.01, np.where(F > 15.05, 5.0, 0.01)), strict=True))
    levels = {"rf": front, "lr": rear}
    paths({(f"{own}.velocity", f"{corner}.road"): row[corner] for own, row in levels.items() for corner in CORNERS})
    found = chapter.figure_6_9(QUICK)
    assert found.values == pytest.approx({"front": 100.0 / 3.0, "rear": 30.0, "across": 20.0 * np.log10(2.0)}, rel=1e-3)
    assert found.claims["low"] == (True, "below 0.6 Hz 10.0 % of the largest")
    assert claims(found) == {"coherence": True, "low": True}
    paths({("rf.velocity", "rf.road"): 1.0}, {("lr.velocity", "lr.road"): 0.89})
    assert claims(chapter.figure_6_9(QUICK)) == {"coherence": False, "low": False}


def test_time_responses_magnitudes_and_coherences_are_shown_below_each_other(paths, plots):
    paths({("rf.velocity", "rf.aero"): 1.0}, {("rf.velocity", "rf.aero"): 0.7})
    chapter.figure_6_10(QUICK)
    assert [plot.title for plot in plots] == ["rf.velocity", "lr.velocity"] * 3
    time, level, share = (plots[k].lines[CORNERS.index("rf")] for k in (0, 2, 4))
    assert time.x[-1] == (F.size - 1) / 125.0
    assert level.y[0] == pytest.approx(20.0 * np.log10(39.3700787 * 4.44822162))  # in/s per lbf
    assert share.y[0] == 0.7


@pytest.mark.parametrize(
    ("figure", "corner", "quantity", "kind", "limit"),
    [(chapter.figure_6_10, "lr", "velocity", "aero", 0.8), (chapter.figure_6_16, "rf", "velocity", "force", 0.9)],
)
def test_the_nearest_input_explains_the_output(figure, corner, quantity, kind, limit, paths):
    for share in (limit - 0.01, limit + 0.01):
        paths(coherence={(f"{corner}.{quantity}", f"{corner}.{kind}"): share})
        assert claims(figure(QUICK))["coherence"] is (share > limit)


def test_the_nearest_wheelloader_has_the_largest_effect_on_a_tire_and_the_other_rear_one_the_second(paths):
    levels = {("rf.tire_force", "rf.road"): 1.0, ("lr.tire_force", "lr.road"): 1.0, ("lr.tire_force", "rr.road"): 0.5}
    paths(levels)
    found = chapter.figure_6_11(QUICK)
    assert claims(found) == {"nearest": True, "across": True}
    assert found.claims["across"][1] == "left rear: lf -40 dB, rf -40 dB, lr 0 dB, rr -6 dB"
    paths(levels | {("lr.tire_force", "lf.road"): 0.6})
    assert claims(chapter.figure_6_11(QUICK)) == {"nearest": True, "across": False}
    paths(levels | {("rf.tire_force", "lf.road"): 1.1})
    assert claims(chapter.figure_6_11(QUICK)) == {"nearest": False, "across": True}


def test_aeroloaders_act_on_the_nearest_tire_and_at_the_rear_on_the_other_one_too(paths):
    """Only 0.3 to 1.5 Hz count."""
    low = np.where((F > 0.25) & (F < 1.55), 1.0, 0.0)
    own = {(f"{corner}.tire_force", f"{corner}.aero"): 0.01 + low for corner in CORNERS}
    other = {("rr.tire_force", "lr.aero"): 0.01 + 0.4 * low, ("lf.tire_force", "rf.aero"): 0.01 + 0.1 * low}
    paths(own | other)
    found = chapter.figure_6_12(QUICK)
    assert claims(found) == {"nearest": True, "rear": True}
    assert found.claims["rear"][1].endswith("rear 0.41, front 0.11")
    paths(own | {("rr.tire_force", "lr.aero"): 0.01 + 1.1 * low, ("lf.tire_force", "rf.aero"): 0.01 + 1.2 * low})
    assert claims(chapter.figure_6_12(QUICK)) == {"nearest": False, "rear": False}


@pytest.mark.parametrize(("figure", "kind", "claim"), [(chapter.figure_6_14, "road", "axle"),
                                                       (chapter.figure_6_15, "aero", "nearest")])  # fmt: skip
def test_the_actuators_of_the_nearest_axle_have_the_largest_effect_on_a_ride_height(figure, kind, claim, paths):
    own = {
        (f"{axle}.ride_height", f"{side}{axle[0]}.{kind}"): falling(1.0) for axle in ("front", "rear") for side in "lr"
    }
    paths(own)
    assert claims(figure(QUICK))[claim]
    for output, source in (("front", "rr"), ("front", "lr"), ("rear", "lf"), ("rear", "rf")):
        paths(own | {(f"{output}.ride_height", f"{source}.{kind}"): 1.1})
        assert not claims(figure(QUICK))[claim]


def test_wheelloaders_do_not_change_the_ride_height_at_low_frequency(paths):
    paths({("front.ride_height", "rf.road"): falling(1.0)})
    assert chapter.figure_6_14(QUICK).claims["low"] == (True, "below 0.6 Hz 10.0 % of the largest")
    paths({("front.ride_height", "rf.road"): falling(-2.0) + 3.0})
    assert not claims(chapter.figure_6_14(QUICK))["low"]


def test_the_antiresonance_over_the_own_shock_force_is_between_2_5_and_12_hz(paths):
    notch = np.abs(F - 4.3) + 0.1
    notch[(F < 2.45) | (F > 12.05)] = 0.01
    paths({("rf.velocity", "rf.force"): notch, ("lr.velocity", "lr.force"): 1.0})
    found = chapter.figure_6_16(QUICK)
    assert found.values["anti"] == pytest.approx(4.3)
    assert claims(found) == {"own": True, "coherence": True}
    paths({("rf.velocity", "rf.force"): 1.0, ("lr.velocity", "rr.force"): 1.0})
    assert claims(chapter.figure_6_16(QUICK))["own"] is False


@pytest.mark.parametrize(("own", "other", "expected"), [(0.91, 0.49, (True, True)), (0.89, 0.51, (False, False))])
def test_a_shock_force_explains_the_nearest_tire_and_not_that_across(own, other, expected, paths):
    paths(coherence={("lr.tire_force", "lr.force"): own, ("lf.tire_force", "rf.force"): other})
    assert tuple(claims(chapter.figure_6_17(QUICK)).values()) == expected


def test_the_front_ride_height_over_the_shock_forces_is_stated_for_100_lb_from_5_to_20_hz(paths):
    level = np.where((F > 5.05) & (F < 19.95), 2e-6, 9e-6)
    share = np.where((F > 0.95) & (F < 4.05), 0.85, 0.1)
    heights = {("front.ride_height", f"{corner}.force"): level for corner in CORNERS}
    paths(heights, {("front.ride_height", f"{corner}.force"): share for corner in ("lf", "rf")})
    found = chapter.figure_6_18(QUICK)
    assert found.values["level"] == pytest.approx(2e-6 * 444.822162)
    assert found.claims["coherence"] == (True, "left front 0.850, right front 0.850")
    paths(heights, {("front.ride_height", "rf.force"): 0.79})
    assert not claims(chapter.figure_6_18(QUICK))["coherence"]


def test_the_paths_in_each_condition_are_counted(paths):
    paths(conditions=[Condition.I, Condition.IV, Condition.I])
    found = chapter.table_6_4(QUICK)
    assert found.claims["high"] == (True, "0 of 3 paths are in condition III")
    assert [(row[0], row[2]) for row in found.blocks[0].rows] == [("I", "2"), ("II", "0"), ("III", "0"), ("IV", "1")]
    paths(conditions=[Condition.I, Condition.III])
    assert chapter.table_6_4(QUICK).claims["high"] == (False, "1 of 2 paths are in condition III")
