"""The drive files and programs of the rig contain the tests of 4.5.1, 6.1.3 and 6.1.5."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from eightpost.errors import ParameterError
from eightpost.rig.geometry import force_modes
from eightpost.units import convert
from eightpost.virtual import (
    Actuators,
    LinearDamper,
    RigSensors,
    bump_test,
    identification_program,
    program,
    quarter_random,
    quarter_truth,
    random_drive,
    run_test,
    seven_dof_truth,
    sine_drive,
    stand_in_truth,
    static_drive,
    track_drive,
)
from eightpost.virtual.drivefiles import WHEELLOADER
from eightpost.virtual.program import _random_length

INCH, POUND = convert(1.0, "in", "m"), convert(1.0, "lbf", "N")
CAR, QUARTER = stand_in_truth(), quarter_truth()


@pytest.mark.nightly
def test_the_random_test_has_the_peaks_and_rms_values_of_the_text():
    series = random_drive(CAR, 3, duration=400.0).series
    assert np.abs(series["lf.road"]).max() == pytest.approx(0.4 * INCH)
    assert series["lf.road"].std() == pytest.approx(0.11 * INCH, rel=0.2)
    aero = series["rr.aero"] - series["rr.aero"].mean()
    assert np.abs(aero).max() == pytest.approx(560 * POUND, rel=0.01)
    assert aero.std() == pytest.approx(160 * POUND, rel=0.2)
    assert series["rr.aero"].mean() > 0.0  # downforce


@pytest.mark.nightly
def test_the_random_tests_spectrum_is_that_of_table_6_3():
    series = random_drive(CAR, 3, duration=800.0).series
    frequency, power = welch(series["rf.road"], 1250.0, nperseg=2**14)
    amplitude = np.sqrt(power)
    at = {f: amplitude[np.abs(frequency - f) < 0.3].mean() for f, _ in WHEELLOADER}
    for f, share in WHEELLOADER[2:-1]:
        assert at[f] / at[1.0] == pytest.approx(share, rel=0.1)
    frequency, power = welch(series["rf.aero"], 1250.0, nperseg=2**14)
    assert power[frequency > 6.0].sum() < 1e-4 * power.sum()


@pytest.mark.nightly
def test_the_eight_inputs_are_independent():
    series = random_drive(CAR, 3, duration=800.0).series
    likeness = np.corrcoef(series.values) - np.eye(8)
    assert np.abs(likeness).max() < 0.1


def test_a_single_input_test_moves_only_one_actuator():
    series = random_drive(CAR, 1, duration=5.0, active=["lr.aero"]).series
    assert [name for name in series.names if np.ptp(series[name]) > 0.0] == ["lr.aero"]
    both = random_drive(CAR, 1, duration=5.0).series
    assert np.array_equal(series["lr.aero"], both["lr.aero"])
    with pytest.raises(ParameterError, match=r"no input lr\.wing; the eight_post has lf\.road"):
        random_drive(CAR, 1, duration=5.0, active=["lr.wing"])


def test_the_quarter_cars_random_test_has_the_lines_of_table_4_3():
    values = quarter_random(1, duration=10.0).series["road"][:12500]
    lines = np.abs(np.fft.rfft(values))
    assert np.abs(values).max() == pytest.approx(0.4 * INCH)
    assert lines[50] / lines[10] == pytest.approx(0.5)
    assert lines[100] / lines[10] == pytest.approx(0.3)
    assert lines[201:].max() < 1e-6 * lines[10]


def test_sines_move_the_wheelloaders_in_their_mode():
    series = sine_drive(CAR, 2.0, 0.7 * INCH, mode="pitch").series
    assert np.abs(series["lf.road"]).max() == pytest.approx(0.7 * INCH, rel=1e-3)
    assert series["lr.road"] == pytest.approx(-series["lf.road"])
    assert series["rf.road"] == pytest.approx(series["lf.road"])
    with pytest.raises(ParameterError, match="no mode 'yaw'"):
        sine_drive(CAR, 2.0, 0.01, mode="yaw")


@pytest.mark.parametrize("kind", ["heave", "pitch", "roll", "warp"])
def test_static_loading_loads_only_its_mode(kind):
    series = static_drive(CAR, kind).series
    forces = -np.stack([series[f"{c}.aero"] for c in CAR.corners])
    modes = np.abs(np.diag([1.0, 1.5, 0.5, 0.5]) @ force_modes(CAR.geometry) @ forces).max(axis=1)
    assert np.argmax(modes) == ["heave", "pitch", "roll", "warp"].index(kind)
    _, counts = np.unique(np.round(np.abs(series["lf.aero"]), 6), return_counts=True)
    assert np.count_nonzero(counts > 1000) == 6  # zero and 5 levels (6.1.3)


@pytest.mark.parametrize("kind", ["warp", "lf.aero"])
def test_static_loading_lifts_no_wheel(kind):
    drive = static_drive(CAR, kind, levels=1, hold=0.5)
    held = run_test(CAR, drive, [LinearDamper(3500.0)] * 4, lead=0.5, sensors=RigSensors.perfect()).series
    assert min(held[f"{corner}.tire_force"].min() for corner in CAR.corners) > 50 * POUND


def test_static_loading_of_one_actuator_leaves_the_others_at_rest():
    series = static_drive(CAR, "rr.aero").series
    assert [name for name in series.names if np.ptp(series[name]) > 0.0] == ["rr.aero"]
    assert series["rr.aero"].max() == pytest.approx(1000 * POUND)
    with pytest.raises(ParameterError, match="needs four aeroloaders"):
        static_drive(seven_dof_truth())


def test_a_track_lap_gives_the_aeroloaders_the_laps_downforce():
    stand_in, seven = track_drive(CAR, 1, duration=5.0).series, track_drive(seven_dof_truth(), 1, duration=5.0).series
    whole = sum(stand_in[f"{c}.aero"] for c in CAR.corners)
    assert whole == pytest.approx(-seven["heave_force"])
    assert stand_in["lr.road"] == pytest.approx(seven["lr.road"])
    with pytest.raises(ParameterError, match="four wheels"):
        track_drive(quarter_truth(), 1)


def test_a_lap_has_a_lower_rms_than_the_identification_about_the_same_mean():
    lap, random = track_drive(CAR, 1).series, random_drive(CAR, 1, duration=30.0).series
    roads = np.stack([lap[name] for name in CAR.named("road")])
    assert np.sqrt(np.mean(roads**2)) == pytest.approx(0.07 * INCH)
    assert lap.duration == pytest.approx(33.0)
    for name in CAR.named("aero"):
        assert lap[name][0] == pytest.approx(random[name].mean(), rel=0.02)
        assert lap[name].std() < 0.75 * random[name].std()


def test_an_aeroloader_attenuates_above_its_bandwidth_and_a_wheelloader_hardly_does():
    sine = sine_drive(CAR, 9.0, 0.01, duration=5.0)
    command = sine.series.with_channel("lf.aero", "N", 1000.0 * np.sin(2 * np.pi * 9.0 * sine.series.time))
    drive = Actuators().follow(command, CAR)
    settled = slice(2500, None)
    assert np.abs(drive["lf.aero"][settled]).max() == pytest.approx(1000.0 / np.sqrt(2.0), rel=0.01)
    assert np.abs(drive["lf.road"][settled]).max() == pytest.approx(0.01, rel=0.01)


def names_of(name, car=CAR):
    return [test.name for test in program(name, car, 1)]


def test_identification_tests_share_one_drive_file_unless_draws_is_other():
    assert (_random_length(CAR), _random_length(QUARTER)) == (800.0, 120.0)
    same = [test.draw() for test in identification_program(CAR, 1, duration=2.0)]
    assert all(drivefile is same[0] for drivefile in same)
    other = [test.draw().series["lf.road"] for test in identification_program(CAR, 1, duration=2.0, draws="other")]
    assert not any(np.array_equal(a, b) for i, a in enumerate(other) for b in other[:i])


def test_the_sines_have_the_values_of_tables_6_2_and_4_4():
    printed = {"heave": (1, 2, 4, 6, 8, 10, 15, 20), "pitch": (1, 2, 3, 5, 6), "roll": (1, 2, 3, 5, 6)}
    assert names_of("sine") == [f"sine_{mode}_{f}hz" for mode, row in printed.items() for f in row]
    assert names_of("sine", QUARTER) == [f"sine_heave_{f}hz" for f in ("1", "2.8", "3.5", "5", "9", "12")]
    road = program("sine", CAR, 1)[9].draw().series["lf.road"]  # pitch, 2 Hz, 0.7 in
    assert np.abs(road).max() == pytest.approx(0.7 * INCH, rel=1e-3)


def test_each_rig_has_its_own_bump():
    for car, height, period, duration in ((CAR, 0.4, 10.0, 50.0), (QUARTER, 1.0, 20.0, 60.0)):
        series = bump_test(car).series
        road = series[car.named("road")[0]]
        assert np.ptp(road) == pytest.approx(height * INCH)
        assert np.abs(np.diff(road)).max() * 1250.0 < 180 * INCH  # what a wheelloader can do (6.1.1)
        assert series.duration == pytest.approx(duration)
        edges = series.time[:-1][np.diff(np.sign(road)) > 0]
        assert np.diff(edges) == pytest.approx(period, abs=0.01)


def test_the_spring_rating_has_four_modes_and_four_single_actuators():
    assert names_of("static") == [f"static_{k}" for k in ("heave", "pitch", "roll", "warp", "lf", "rf", "lr", "rr")]
    with pytest.raises(ParameterError, match="lacks the actuators"):
        program("static", seven_dof_truth(), 1)


def test_all_contains_every_program_that_the_rig_can_run():
    parts = ("identification", "single", "sine", "bump", "static", "track")
    assert names_of("all") == [name for part in parts for name in names_of(part)]
    assert len(set(names_of("all"))) == len(names_of("all"))
    assert not [name for name in names_of("all", QUARTER) if name.startswith(("static", "track"))]
    with pytest.raises(ParameterError, match="no program 'sines'; there are identification"):
        program("sines", CAR, 1)
