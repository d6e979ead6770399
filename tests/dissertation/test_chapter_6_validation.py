"""Statements about the identified stand-in (6.4) are true of signals that were made so, and false of others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import QUICK
from dissertation import chapter_6_validation as chapter
from dissertation.rig_bench import EIGHT_POST
from dissertation.true_cars import TOTAL
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.signals import TimeSeries
from eightpost.vehicle import CORNERS

from .conftest import claims

TRENDS = ("lr.velocity", TOTAL, "front.ride_height", "lr.hub_acceleration")
SIGNALS = ("lf.velocity", "lf.tire_force", "front.ride_height", "lf.hub_acceleration")


def pair(true, found, seconds=10.0):
    """Return channels of the true car at 1250 Hz and of the identified car at 250 Hz, functions of the time."""
    fast, slow = np.arange(round(1250 * seconds)) / 1250.0, np.arange(round(250 * seconds)) / 250.0
    rows = [{name: of(time) for name, of in one.items()} for one, time in ((true, fast), (found, slow))]
    return chapter._Pair(*rows)


def tone(size, frequency=5.0, third=0.0):
    """Return a tone with a third harmonic, about a mean of 7."""
    turn = 2.0 * np.pi * frequency
    return lambda time: 7.0 + size * (np.sin(turn * time) + third * np.sin(3.0 * turn * time))


# ---- A lap ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("errors", "expected"), [((0.1, 0.2, 0.58, 0.3), (True, True)), ((0.3, 0.2, 0.62, 0.3), (False, False))]
)
def test_errors_of_a_lap_are_relative_to_the_signals_after_3_s(errors, expected, monkeypatch, plots):
    def late(size):
        return lambda time: np.where(time < 2.99, 50.0, tone(size)(time) - 7.0)

    true = dict.fromkeys(TRENDS, lambda time: tone(1.0)(time) * (time >= 0.0))
    found = {name: late(1.0 + error) for name, error in zip(TRENDS, errors, strict=True)}
    monkeypatch.setattr(chapter, "_lap", lambda _effort: [pair(true, found)])
    result = chapter.figure_6_26(QUICK)
    assert tuple(claims(result).values()) == expected
    assert f"front.ride_height {100.0 * errors[2]:.0f} %" in result.claims["good"][1]
    assert (plots[0].lines[0].x[0], plots[0].lines[0].x[-1]) == (6.0, 7.996)


def trends(monkeypatch, true, found):
    """Set the levels of all signals by setup."""
    rows = tuple({name: (np.array(true), np.array(found))} for name in TRENDS)
    monkeypatch.setattr(chapter, "_trends", lambda _effort: {k: v for row in rows for k, v in row.items()})


def test_levels_of_setups_are_compared_by_their_correlation_and_mean_difference(monkeypatch, plots):
    trends(monkeypatch, [1.0, 2.0, 3.0, 4.0, 5.0], [1.5, 2.5, 3.5, 4.5, 5.5])
    found = chapter.figure_6_27(QUICK)
    assert found.values["offset"] == pytest.approx(0.5)
    assert found.claims == {"velocity": (True, "correlation 1.000"), "hub": (True, "correlation 1.000")}
    assert f"lr.velocity {100.0 * np.mean([0.5, 0.25, 0.5 / 3, 0.125, 0.1]):+.1f} %" in found.note
    trends(monkeypatch, [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 3.0, 2.0, 5.0, 4.0])  # correlation 0.8
    assert claims(chapter.figure_6_27(QUICK)) == {"velocity": False, "hub": False}


def test_trends_are_those_of_the_rms_after_settling(monkeypatch):
    true, found = (dict.fromkeys(TRENDS, lambda t, a=a: a * np.where(t < 2.99, 9.0, np.sign(np.sin(157.0 * t + 0.1))))
                   for a in (2.0, 3.0))  # fmt: skip
    monkeypatch.setattr(chapter, "_lap", lambda _effort: [pair(true, found)])
    rows = chapter._trends(QUICK)
    assert list(rows) == list(TRENDS)
    for t, y in rows.values():
        assert (t, y) == (pytest.approx([2.0], rel=0.01), pytest.approx([3.0], rel=0.01))


@pytest.mark.parametrize(
    ("found", "left_out"),
    [([1, 2, 3, 4, 5], 0), ([5, 4, 3, 2, 1], 4), ([2, 3, 4, 5, 1], 1), ([2, 1, 4, 3, 5], 2), ([1, 1, 2, 3, 4], 1)],
)
def test_as_few_setups_as_possible_are_left_out_until_the_order_agrees(found, left_out, monkeypatch, plots):
    assert chapter._out_of_order(np.array([10, 20, 30, 40, 50]), np.array(found)) == left_out
    trends(monkeypatch, [50.0, 40.0, 30.0, 20.0, 10.0], found[::-1])
    assert chapter.figure_6_28(QUICK).values == {"tire": left_out, "ride": left_out}
    assert plots[0].lines[1].x.tolist() == plots[0].lines[1].y.tolist() == [10.0, 50.0]


def test_pairs_have_the_channels_of_both_cars_with_the_same_dampers_and_the_sum_of_the_tire_forces(monkeypatch):
    asked = []
    channels = {f"{corner}.tire_force": np.array([10.0**k]) for k, corner in enumerate(CORNERS)}
    monkeypatch.setattr(chapter, "follow", lambda car, drive: asked.append(drive) or "motion")
    monkeypatch.setattr(chapter, "lap_of", lambda _rig, seconds: asked.append(seconds) or "lap")
    monkeypatch.setattr(
        chapter, "true_channels", lambda _rig, motion, setups: asked.append((motion, setups)) or [channels]
    )
    monkeypatch.setattr(chapter, "identified", lambda _rig, seconds: seconds)
    monkeypatch.setattr(chapter, "identified_channels", lambda *given: asked.append(given) or [channels])
    (one,) = chapter._pairs(QUICK, "drive", [[0, 1, 0, 0]])
    assert one.true[TOTAL] == one.found[TOTAL] == [1111.0]
    baseline, alternate = EIGHT_POST.dampers
    assert asked[:2] == ["drive", ("motion", [[baseline, alternate, baseline, baseline]])]
    seconds, motion, laws, setups = asked[2]
    assert (seconds, motion, setups) == (QUICK.rig_seconds, "motion", [[0, 1, 0, 0]])
    for law, damper in zip(laws, (baseline, alternate), strict=True):
        assert law.curve.force(-0.5) == pytest.approx(-0.5 * damper.damping)
    chapter._pairs(QUICK, None, [[0, 0, 0, 0]])
    assert asked[3] == QUICK.lap_seconds and asked[4][0] == "lap"


# ---- Sines and a bump -----------------------------------------------------------------------------------------------


def sines(monkeypatch, true_third, found_third, size=1.0, frequencies=(1.0, 4.0, 8.0)):
    """Set sines with third harmonics; at 8 Hz, where none counts, the identified car has no harmonic."""
    made = []
    for f in frequencies:
        third = (true_third, found_third) if f < 8.0 else (0.9, 0.0)
        rows = [dict.fromkeys(SIGNALS, tone(a, f, b)) for a, b in zip((1.0, size), third, strict=True)]
        made.append((f, pair(*rows)))
    monkeypatch.setattr(chapter, "_sines", lambda _effort: tuple(made))


@pytest.mark.parametrize(
    ("true", "found", "holds"), [(0.12, 0.05, True), (0.08, 0.01, False), (0.12, 0.07, False), (0.4, 0.15, True)]
)
def test_the_third_harmonic_of_the_stand_in_is_not_in_the_simulation(true, found, holds, monkeypatch, plots):
    sines(monkeypatch, true, found)
    claim = chapter.figure_6_29(QUICK).claims["harmonic"]
    assert claim[0] is holds
    assert claim[1].endswith(f"Hz, {100.0 * true:.0f} %, simulation {100.0 * found:.1f} %")
    assert [plot.lines[0].x.size for plot in plots[::4]] == [500, 125, 62]  # two periods


@pytest.mark.parametrize(("size", "holds", "text"), [(1.14, True, "median 14.0 %, largest 14 %"),
                                                     (0.84, False, "median 16.0 %, largest 16 %")])  # fmt: skip
def test_levels_of_sines_are_similar_within_15_percent(size, holds, text, monkeypatch, plots):
    sines(monkeypatch, 0.0, 0.0, size)
    monkeypatch.setattr(chapter, "_STEADY", 1250)
    sines(monkeypatch, 0.0, 0.0, size, frequencies=(1.0, 4.0, 5.0))
    assert chapter.figure_6_30(QUICK).claims["similar"] == (holds, text)
    assert plots[0].lines[0].y == pytest.approx([np.sqrt(0.5)] * 3, rel=1e-3)


@pytest.mark.parametrize(("size", "holds", "text"), [(1.24, True, "+24 %"), (0.74, False, "-26 %")])
def test_the_bump_is_compared_from_peak_to_peak_around_its_ramp(size, holds, text, monkeypatch, plots):
    """Fast noise of the true car, above 60 Hz, and what happens before 24.8 s and after 26 s do not count."""

    def bump(height, noise=0.0):
        def of(time):
            ramp = height * np.clip((time - 25.2) / 0.4, 0.0, 1.0) + np.where(abs(time - 25.4) > 0.8, 3.0 * height, 0.0)
            return ramp + noise * np.sin(800.0 * np.pi * time)

        return of

    one = pair(dict.fromkeys(SIGNALS, bump(1.0, 0.3)), dict.fromkeys(SIGNALS, bump(size)), 30.0)
    monkeypatch.setattr(chapter, "_pairs", lambda *_: [one])
    claim = chapter.figure_6_31(QUICK).claims["good"]
    assert claim[0] is holds and claim[1].count(text) == 4
    assert 24.8 < plots[0].lines[0].x[0] < 24.805 and plots[0].lines[0].y[0] == 0.0


# ---- Static loading -------------------------------------------------------------------------------------------------

STIFFNESS = 4e4


SIGNS = {"heave": (1, 1, 1, 1), "pitch": (1, 1, -1, -1), "roll": (1, -1, 1, -1), "warp": (1, -1, -1, 1)}


def levels_of(_car, test, *, most):
    """Return a drive in levels of 6 s, five up and five down, at 50 Hz."""
    time = np.arange(3300) / 50.0
    share = np.minimum(time // 6.0, 10.0 - time // 6.0) / 5.0
    signs = SIGNS.get(test) or [int(test.startswith(corner)) for corner in CORNERS]
    rows = {f"{corner}.aero": ("N", sign * most * share) for corner, sign in zip(CORNERS, signs, strict=True)}
    return SimpleNamespace(series=TimeSeries.from_channels(time, rows))


def loading(car, drive, _shocks, **_options):
    """Return the record of a car on a spring at each aeroloader; with friction it does not return on the way back.

    Only the last two seconds of a hold of 5 s are steady. A positive force pulls down, a positive position is up.
    """
    time, rows = drive.series.time, {}
    steady = (time % 6.0 > 2.999) & (time % 6.0 < 5.001)
    for corner, left in zip(CORNERS, (1.0, -2.0, 3.0, 5.0), strict=True):
        force = drive.series[f"{corner}.aero"]
        stuck = np.where(time > 33.0, 2e-4 * left, 0.0) if car.friction.coulomb.any() else 0.0
        rows[f"{corner}.aero_position"] = ("m", np.where(steady, stuck - force / STIFFNESS, 1.0))
        rows[f"{corner}.aero"] = ("N", np.where(steady, force, 0.0))
    return SimpleNamespace(series=TimeSeries.from_channels(time, rows))


@pytest.fixture
def springs(monkeypatch):
    """Replace the rig by a car on a spring at each aeroloader."""
    computed = chapter._static
    computed.cache_clear()
    monkeypatch.setattr(chapter, "static_drive", levels_of)
    monkeypatch.setattr(chapter, "run_test", loading)
    yield
    computed.cache_clear()


@pytest.mark.usefixtures("springs")
def test_springs_at_the_aeroloaders_are_found_in_modes():
    levels, K, left = chapter._static(False)
    geometry = EIGHT_POST.car.geometry
    wanted = STIFFNESS * force_modes(geometry) @ np.linalg.inv(displacement_modes(geometry))
    assert pytest.approx(wanted, rel=1e-6, abs=1e-3) == K and left == pytest.approx([0.0] * 4, abs=1e-6)
    _, force = levels["heave"]
    shares = np.array([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]) / 5.0
    assert force[0] == pytest.approx(-4.0 * 2224.11 * shares, rel=1e-5)  # four times 500 lb
    assert len(levels) == 8


@pytest.mark.usefixtures("springs")
def test_the_stand_in_has_a_hysteresis_that_the_car_without_friction_does_not_have(monkeypatch, plots):
    assert claims(chapter.figure_6_32(QUICK)) == {"hysteresis": True}
    x, force = chapter._static(True)[0]["roll"]
    assert (plots[2].lines[0].x == x[2]).all() and (plots[2].lines[0].y == force[2]).all()
    assert plots[2].lines[1].y.mean() == pytest.approx(force[2].mean())
    found = chapter._static
    monkeypatch.setattr(chapter, "_static", lambda has_friction: found(not has_friction))
    assert claims(chapter.figure_6_32(QUICK)) == {"hysteresis": False}


@pytest.mark.parametrize(
    ("factor", "coupling", "expected"),
    [(1.0, 0.9, (True, True)), (1.09, 0.0, (True, True)), (0.89, -1.1, (False, False)), (1.11, 1.1, (False, False))],
)
def test_the_spring_matrix_is_stated_per_inch_and_degree(factor, coupling, expected, monkeypatch):
    linear = np.diag(np.diag(chapter._analytic(EIGHT_POST.car)))
    K = factor * linear
    pound, degree = 4448.22162, np.pi / 180.0
    units = {"heave/heave": 0.0254 / pound, "roll/roll": degree / 1355.81795, "heave/pitch": degree / pound}
    diagonal = np.sqrt(K[0, 0] * units["heave/heave"] * K[1, 1] * units["roll/roll"])
    K[0, 1] = coupling * diagonal / units["heave/pitch"]
    monkeypatch.setattr(chapter, "_static", lambda _friction: ({}, K, np.zeros(4)))
    found = chapter.equation_6_11(QUICK)
    places = {"heave/heave": (0, 0), "roll/roll": (2, 2), "heave/pitch": (0, 1)}
    for name, unit in units.items():
        assert found.values[name] == pytest.approx(K[places[name]] * unit)
    assert tuple(claims(found).values()) == expected


def test_a_car_with_rigid_springs_stands_on_its_tires():
    """In heave it has the sum of their rates."""
    car = EIGHT_POST.car
    rigid = replace(car, springs=replace(car.springs, rate=1e9 + 0.0 * car.springs.rate))
    assert chapter._analytic(rigid)[0, 0] == pytest.approx(car.tires.stiffness.sum(), rel=0.01)
