"""Motions, records, drive files and parameters of the virtual rig and dynamometer are those in tests/results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eightpost.signals import TimeSeries
from eightpost.signals.drivefile import Drivefile
from eightpost.virtual import (
    LinearDamper,
    RigSensors,
    Run,
    demo_damper,
    flexible_truth,
    identification_program,
    program,
    run_test,
    shim_build,
    simulate,
    stand_in_truth,
    truth_named,
)
from eightpost.virtual.car import AnyCar
from eightpost.virtual.drivefiles import RATE, track_drivefile
from eightpost.virtual.dynamometer import Specimen, bump, drivefile_of, sine_tests, static_steps
from eightpost.virtual.dynamometer import program as dynamometer_program
from eightpost.virtual.program import Bench, Drift
from eightpost.virtual.shocks import shocks_named

Unchanged = Callable[..., None]

CARS = ("quarter_car", "seven_dof", "eight_post", "flexible:4")


def car_named(name: str) -> AnyCar:
    return flexible_truth(4) if name == "flexible:4" else truth_named(name)


def channels(series: TimeSeries) -> dict[str, np.ndarray]:
    rows = zip(series.names, series.units, series.values, strict=True)
    return {"time": series.time} | {f"{name} [{unit}]": row for name, unit, row in rows}


def sines(car: AnyCar, *, road: float, load: float, seconds: float = 1.0) -> TimeSeries:
    """Return another sine on each input, from rest."""
    time = np.arange(round(seconds * RATE) + 1) / RATE
    units = (*("m",) * len(car.corners), *car.load_units)
    size = {"m": road, "N": load, "N.m": load}
    waves = [(1.0 - np.cos(6.0 * time)) * np.sin((11.0 + 7.0 * k) * time + k) for k in range(len(units))]
    rows = zip(car.inputs, units, waves, strict=True)
    return TimeSeries.from_channels(time, {name: (unit, size[unit] * wave) for name, unit, wave in rows})


@pytest.mark.parametrize("name", CARS)
def test_the_parameters_of_a_car(name: str, unchanged: Unchanged) -> None:
    car = car_named(name)
    matrices = {part: getattr(car, part) for part in ("shock", "wheel", "chassis", "load", "points", "static_load")}
    numbers = {name: np.nan_to_num(array, posinf=9e99, neginf=-9e99) for name, array in car.numbers()._asdict().items()}
    unchanged({"car": car, "numbers": numbers} | matrices)


@pytest.mark.parametrize("name", CARS)
def test_the_motion_of_a_car_that_slides_lifts_and_meets_its_stops(name: str, unchanged: Unchanged) -> None:
    car = car_named(name)
    shocks = (demo_damper("A"), shim_build("B/C"), LinearDamper(3000.0), demo_damper("C"))[: len(car.corners)]
    runs = [Run(sines(car, road=road, load=load), shocks) for road, load in ((1e-3, 40.0), (0.05, 2000.0))]
    gentle, violent = simulate(car, runs, lead=0.05)
    unchanged({"gentle": gentle, "violent": violent})


@pytest.mark.parametrize("name", CARS)
def test_the_record_of_a_rig_with_noise_and_drift(name: str, unchanged: Unchanged) -> None:
    car = car_named(name)
    drive = Drivefile(sines(car, road=0.01, load=500.0, seconds=0.4))
    shocks = [LinearDamper(2000.0 + 500.0 * k) for k in range(len(car.corners))]
    unchanged(channels(run_test(car, drive, shocks, seed=4, lead=0.2).series))


@pytest.mark.parametrize(
    ("name", "test", "options"),
    [
        ("quarter_car", "random", {"duration": 12.0}),
        ("quarter_car", "bump", {"duration": 25.0}),
        ("eight_post", "random", {"duration": 5.0}),
        ("seven_dof", "single", {"duration": 3.0, "only": "pitch_moment"}),
        ("flexible", "sine", {"duration": 2.0, "mode": "warp"}),
        ("eight_post", "bump", {}),
        ("eight_post", "static", {}),
        ("eight_post", "static", {"mode": "pitch"}),
        ("eight_post", "static", {"only": "lr.aero"}),
        ("seven_dof", "track", {"duration": 4.0}),
        ("eight_post", "track", {}),
    ],
)
def test_the_drive_file_of_a_test(name: str, test: str, options: dict[str, float], unchanged: Unchanged) -> None:
    unchanged(channels(Bench.of(name, noise=False).drivefile(test, 3, **options).series))


def test_the_drive_file_of_a_track(unchanged: Unchanged) -> None:
    unchanged(channels(track_drivefile(5, duration=4.0).series))


@pytest.mark.parametrize("name", ["quarter_car", "seven_dof", "eight_post"])
def test_the_tests_of_a_program(name: str, unchanged: Unchanged) -> None:
    tests = program("all", truth_named(name), 5)
    others = identification_program(truth_named(name), 5, duration=3.0, draws="other")
    lines = {test.name: f"{test.drivefile}; {test.alternate}" for test in tests}
    unchanged(lines | {f"other {test.name}": test.drivefile for test in others})
    assert others[1].draw().series.duration == pytest.approx(3.0)


def test_a_summary_of_a_record(unchanged: Unchanged) -> None:
    bench = Bench.of("quarter_car", noise=True, run=3, seed=5)
    record = bench.record(Drivefile(sines(bench.car, road=0.01, load=500.0)), ["demo:B"], "sines", 2)
    text = bench.summary(record)
    assert record.conditions.seed == 5
    unchanged(text)


def test_the_noise_of_each_sensor() -> None:
    sensors = RigSensors(1.0, 2.0, 3.0, 4.0, 5.0)
    named = (("lf.road", "m"), ("lf.displacement", "m"), ("lf.tire_force", "N"), ("lf.force", "N"), ("a", "m/s2"))
    assert [sensors.noise_of(*one) for one in named] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert sensors.noise_of("roll_moment", "N.m") == 0.0


def test_zeros_drift_from_run_to_run_by_the_stated_deviations() -> None:
    drift, generator = Drift(load_zero=3.0, travel_zero=2e-3), np.random.default_rng(1)
    names = ("displacement", "rr.force", "lf.aero", "lf.tire_force", "lf.road")
    zeros = np.array([[drift.zero(name, generator) for name in names] for _ in range(400)])
    assert zeros.std(axis=0) == pytest.approx((2e-3, 3.0, 3.0, 3.0, 0.0), rel=0.15)
    cars = [Drift(friction=0.2, tire=0.1).of(stand_in_truth(), generator) for _ in range(400)]
    parts = np.array([(car.friction.coulomb[0, 0], car.tires.stiffness[0, 0]) for car in cars])
    assert parts.std(axis=0) / parts.mean(axis=0) == pytest.approx((0.2, 0.1), rel=0.15)


def test_the_shocks_of_the_virtual_rig(unchanged: Unchanged) -> None:
    names = [*(f"demo:{build}" for build in "ABC"), "configuration:1", "configuration:12", "build:A/B", "build:C/A"]
    rows = {}
    for name, shock in shocks_named(names).items():
        row = shock.row
        rows |= {f"{name} {k}": np.array(part) for k, part in enumerate(np.array_split([row.kind, *row.numbers], 4))}
        rows |= {f"{name} at the start": np.array(row.start)}
    static = {f"static force of {name}": demo_damper(name).static_force(v) for name in "ABC" for v in (0.02, -0.6)}
    unchanged(rows | static)


@pytest.mark.parametrize("name", ["demo:A", "demo:C", "configuration:3", "build:B/C"])
def test_the_response_of_a_shock_on_the_dynamometer(name: str, unchanged: Unchanged) -> None:
    command = bump().series.window(0.9, 1.2)
    (shock,) = shocks_named([name]).values()
    unchanged({f"at {rate:g} Hz": channels(shock.respond(command, rate=rate)) for rate in (2000.0, 500.0)})


def test_the_motions_of_the_dynamometer(unchanged: Unchanged) -> None:
    kept = {test.name: {"start": test.start, **channels(test.drivefile.series)} for test in sine_tests()}
    kept |= {name: channels(drive.series) for name, drive in (("static", static_steps()), ("bump", bump()))}
    kept["random"] = channels(drivefile_of("random", 4).series)
    kept["short"] = channels(drivefile_of("random", 4, duration=2.0, amplitude=0.01).series)
    assert list(dynamometer_program(seed=1))[:3] == ["random", "random_validation", "sine_1in_1ips"]
    unchanged(kept)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_record_of_the_dynamometer(suffix: str, tmp_path: Path, unchanged: Unchanged) -> None:
    specimen, path = Specimen.configured(4), tmp_path / f"record.{suffix}"
    said = specimen.test(drivefile_of("bump", 1), "bump", 3, path)
    kept: dict[str, object] = {"said": said.partition("; wrote")[0], "built": Specimen.built("A/C").title}
    if suffix == "csv":
        lines = path.read_text(encoding="utf-8").splitlines()
        kept |= {"first": lines[:6], "middle": lines[1010:1015], "last": lines[-1]}
    unchanged(kept)
