"""Chapter 7's statements about setups are true of measures that were made so, and false of others."""

from itertools import product

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_7 as chapter
from dissertation.chapter_7 import _Study

from .conftest import claims

BUILDS = ("AA/AA", "B/B", "C/C")
SETUPS = np.array(list(product(range(3), repeat=4)), dtype=float)
LF, RF, LR, RR = SETUPS.T


@pytest.fixture
def study(monkeypatch):
    """Set the measures of all setups of three builds, given over the stiffness 0, 1, 2 of the shocks."""

    def given(**measures):
        default = {"front": 10.0 - LF - RF, "rear": 3.0 + LR, "rf": 5.0 - RF, "lr": 5.0 + RR, "tire": 9.0 + LF}
        one = _Study(BUILDS, SETUPS, {name: np.asarray(row) for name, row in (default | measures).items()})
        monkeypatch.setattr(chapter, "_study", lambda _: one)
        return one

    return given


def test_independent_shocks_share_the_variance_by_the_squares_of_their_effects(study):
    """A sum of independent terms 4, 2, 1 and 0 has the shares 16, 4, 1 and 0 of 21."""
    one = study(front=50.0 - 4.0 * LF + 2.0 * RF - LR)
    assert [one.influence("front", (k,)) for k in range(4)] == pytest.approx([16 / 21, 4 / 21, 1 / 21, 0.0])
    assert one.influence("front", (0, 1, 2, 3)) == pytest.approx(1.0)


def test_builds_are_listed_from_the_lowest_mean_level(study):
    means = study(front=50.0 - 4.0 * LF - LR).mean_by_build("front", 0)
    assert list(means) == ["C/C", "B/B", "AA/AA"]
    assert list(means.values()) == pytest.approx([0.1, 0.5, 0.9])


def test_extremes_are_the_lowest_setups_and_the_highest_ones_first(study):
    one = study(front=27.0 * LF + 9.0 * RF + 3.0 * LR + RR)
    assert one.extremes("front", 2) == ([0, 1], [80, 79])
    assert one.label(1) == "AA/AA, AA/AA, AA/AA, B/B"
    assert one.label(80) == "C/C, C/C, C/C, C/C"


def test_a_front_ride_height_of_the_front_shocks_agrees_with_fig_7_1(study, plots):
    """Of 80 to 0 from soft to stiff front shocks, the best setup with another front shock has 20 + 1."""
    study(front=80.0 - 20.0 * LF - 20.0 * RF + 1.5 - LR + LR * LR / 4.0 + RR / 1e6)
    found = chapter.figure_7_1(QUICK)
    assert found.values["share"] == pytest.approx(100.0 * 20.0 / 81.0, rel=1e-5)
    assert claims(found) == {"best": True, "rear": True}
    assert "rear shocks 0 %" in found.claims["rear"][1]
    trend = plots[0].lines[0]
    assert (trend.x[0], trend.x[-1], trend.y[0], trend.y[-1]) == (0.0, 80.0, 0.0, 1.0)
    assert [plot.lines[0].y[-1] for plot in plots[1:]] == [0.0, 0.0, 0.0, 2.0]


@pytest.mark.parametrize(
    ("front", "expected"),
    [(LR + RR, {"best": False, "rear": False}), (20.0 - 3.0 * LF - 3.0 * RF - 2.5 * LR, {"best": True, "rear": False})],
)
def test_a_front_ride_height_of_the_rear_shocks_disagrees_with_fig_7_1(front, expected, study, plots):
    study(front=front)
    assert claims(chapter.figure_7_1(QUICK)) == expected


def test_fig_7_2_states_what_the_best_front_ride_heights_cost(study, plots):
    """Stiff front shocks: levels 0, 1.8 and 3.6 % with the rear shock, of which 2 % admits two and 5 % three."""
    front = 80.0 - 20.0 * LF - 20.0 * RF - 1.5 * LR
    study(front=front, rear=2.0 * LF + LR, tire=2.0 * LF + LR, rf=front, lr=RR)
    found = chapter.figure_7_2(QUICK)
    assert found.values == pytest.approx({"rear": 100.0 * 4.0 / 6.0, "tire": 100.0 * 5.0 / 6.0})
    assert found.claims == {"hub": (True, "Spearman 1.00"), "independent": (True, "Spearman 0.00")}
    assert [plot.y.title for plot in plots] == [
        "rear ride height",
        "right front hub acceleration",
        "left rear hub acceleration",
        "total tire force",
    ]
    study(rf=RF, lr=LF + RF)
    assert claims(chapter.figure_7_2(QUICK)) == {"hub": False, "independent": False}


def test_stiff_front_and_soft_rear_shocks_are_the_worst_for_the_tires_in_fig_7_3(study, plots):
    study(tire=3.0 * LF - LR)
    assert claims(chapter.figure_7_3(QUICK)) == {"front": True, "rear": True}
    study(tire=LR - 3.0 * LF)
    assert claims(chapter.figure_7_3(QUICK)) == {"front": False, "rear": False}


def test_fig_7_4_tells_what_falls_with_the_tire_force_from_what_rises(study, plots):
    study(tire=LF + LR, rear=LR, lr=LR, front=-LF, rf=-LF)
    assert claims(chapter.figure_7_4(QUICK)) == {"together": True, "against": True}
    study(tire=LF + LR, rear=LR, lr=RR, front=-LF, rf=RF + LF)
    assert claims(chapter.figure_7_4(QUICK)) == {"together": False, "against": False}


def test_fig_7_5_finds_the_best_front_builds_and_the_share_of_the_rear_shocks(study, plots):
    study(rf=(RF - 1.0) ** 2 * -1.0 + 0.2 * LR)
    assert claims(chapter.figure_7_5(QUICK)) == {"front": True, "rear": True}
    study(rf=(RF - 1.0) ** 2 + LR)
    assert claims(chapter.figure_7_5(QUICK)) == {"front": False, "rear": False}


def test_fig_7_6_tells_independent_hubs_from_dependent_ones(study, plots):
    study(rf=RF, lr=LR, rear=-RF)
    assert claims(chapter.figure_7_6(QUICK)) == {"independent": True, "rear": True}
    study(rf=RF, lr=-RF, rear=RF)
    assert claims(chapter.figure_7_6(QUICK)) == {"independent": False, "rear": False}


def test_table_7_4_has_the_lowest_and_the_highest_level_of_each_measure(study):
    study(front=10.0 - LF, rear=3.0 + LR, rf=5.0 - RF, lr=5.0 + RR, tire=9.0 + LF)
    lowest = {"front": 8.0, "rear": 3.0, "rf": 3.0, "lr": 5.0, "tire": 9.0}
    found = chapter.table_7_4(QUICK).values
    assert found == {
        f"{name}/{end}": low + add for name, low in lowest.items() for end, add in (("min", 0), ("max", 2))
    }


def test_table_7_5_chooses_four_four_and_two_setups_at_each_end(study):
    study(front=10.0 - LF - RF, tire=9.0 - LR - RR)
    found = chapter.table_7_5(QUICK)
    assert found.values == {"count": 20}
    assert set(found.claims.values()) == {(True, "4 of 4 setups")}
    study(front=LF + 0.1 * RF, tire=9.0 - LR)
    found = chapter.table_7_5(QUICK)
    assert found.claims == {
        "low": (False, "0 of 4 setups"),
        "high": (False, "0 of 4 setups"),
        "tire_low": (False, "1 of 4 setups"),
        "tire_high": (False, "1 of 4 setups"),
    }


def test_fig_7_7_compares_the_chosen_setups_with_the_true_car(study, plots, monkeypatch):
    """A true car with 1.25 times each measure, but for one setup: 19 of 20 are inside, the levels 20 % too low."""
    measures = {
        "front": 100.0 - 9.0 * LF - 8.0 * RF - LR - RR / 7.0,
        "tire": 200.0 - 9.0 * LR - 8.0 * RR - LF - RF / 7.0,
        "rf": 50.0 - 9.0 * RF - LF - RR / 7.0 - LR / 50.0,
    }
    one = study(**measures)
    odd = one.extremes("tire", 4)[0][2]

    def true_channels(_rig, _lap, setups):
        for place, builds in enumerate(setups):
            number = int(np.flatnonzero(([BUILDS.index(build) for build in builds] == SETUPS).all(axis=1))[0])
            level = {name: 1.25 * row[number] + 1e-6 * (-1) ** place for name, row in measures.items()}
            level["tire"] += 1e-3 if number == odd else 0.0
            wave = np.resize([1.0, -1.0], 5000)
            corners = {f"{corner}.tire_force": level["tire"] / 4.0 * wave for corner in ("lf", "rf", "lr", "rr")}
            yield {"front.ride_height": level["front"] * wave, "rf.hub_acceleration": level["rf"] * wave, **corners}

    monkeypatch.setattr(chapter, "true_channels", true_channels)
    monkeypatch.setattr(chapter, "lap_of", lambda *_: None)
    monkeypatch.setattr(chapter, "_law", lambda build: build)
    found = chapter.figure_7_7(QUICK)
    assert found.values["inside"] == pytest.approx(95.0)
    assert found.claims["ranks"][0]
    holds, text = found.claims["levels"]
    assert holds
    assert text.endswith("front ride height -20, total tire force -20, right front hub acceleration -20")
    setups, fit, band = plots[1].lines
    assert setups.x == pytest.approx(measures["tire"][[*one.extremes("tire", 4)[0], *one.extremes("tire", 4)[1]]])
    assert fit.y == pytest.approx(1.25 * fit.x, abs=1e-3)
    half = 0.5 * (band.y[::-1][:2] - band.y[:2])
    residual = setups.y - np.polyval(np.polyfit(setups.x, setups.y, 1), setups.x)
    assert half == pytest.approx([2.0 * np.sqrt(residual @ residual / 6.0)] * 2, rel=1e-6)
    assert 0.5 * (band.y[::-1][:2] + band.y[:2]) == pytest.approx(fit.y)
