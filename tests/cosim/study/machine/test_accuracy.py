"""The machine and the FMUs agree at a fine step, with every law, port parameter and friction."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from builder.build import build
from cosim.components.fmu_component import FmuComponent
from cosim.study import Build, Drive, Measure, Vehicle
from cosim.study.running import machine
from cosim.study.running.machine import read_vehicle
from eightpost.corners import CORNERS
from eightpost.machine import car
from eightpost.machine.car import instruction_set
from eightpost.vehicle import write_vehicle
from tests.double_modes import car_with_seat

from .lanes import (
    CHANNELS,
    LAWS,
    TRACK,
    apart_from_fmus,
    knots_of,
    largest_apart,
    on_machine,
    random_builds,
    random_setups,
    study_of,
)

IDENTIFIED = Path(__file__).resolve().parents[4] / "examples" / "identified" / "car.json"
#: Largest difference of a channel from the FMUs, both at a fine step, in percent of its standard deviation.
AGREED = 0.1
FRICTION = {
    "friction that creeps": {"friction_force": 90.0, "friction_velocity": 0.004},
    "friction that sticks": {"bristle_force": 120.0, "bristle_static_ratio": 1.3},
    "friction that sticks evenly": {"bristle_force": 60.0},
    "port springs": {"port_spring": 2e5},
    "all of them": {"friction_force": 40.0, "bristle_force": 70.0, "bristle_static_ratio": 1.2, "port_spring": -1e5},
}


def at_corners(values, corners=("lf", "rf", "lr", "rr")):
    """Return parameters at every corner, none of them twice the same."""
    return {f"{corner}.{n}": v * (1.0 + 0.1 * k) for k, corner in enumerate(corners) for n, v in values.items()}


@pytest.mark.repeated
@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_every_law_agrees_with_its_fmu(fmus, law):
    study = study_of(fmus, random_builds(fmus, [law], 8, seed=LAWS.index(law)))
    assert apart_from_fmus(study, random_setups(study, 8)) < AGREED


@pytest.mark.nightly
def test_laws_can_be_mixed_in_a_batch(fmus):
    study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=11))
    assert apart_from_fmus(study, random_setups(study, 8)) < AGREED


@pytest.mark.nightly
def test_curves_through_knots_and_polynomials_can_be_mixed(fmus):
    knots = knots_of(FmuComponent(fmus["hysteresis"], "shock"))
    builds = random_builds(fmus, ["lpnl2", "polylinear"], 6, seed=21)
    through = {f"{name} knots": Build(b.fmu, {**b.parameters, **knots}) for name, b in builds.items()}
    study = study_of(fmus, {**builds, **through})
    assert apart_from_fmus(study, random_setups(study, 8)) < AGREED
    study = study_of(fmus, through)
    assert apart_from_fmus(study, random_setups(study, 8)) < AGREED


@pytest.mark.nightly
@pytest.mark.parametrize("kind", FRICTION)
def test_every_friction_agrees_with_that_of_the_vehicle(fmus, kind):
    vehicle = Vehicle(fmus["seven_dof"], parameters=at_corners(FRICTION[kind]))
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 6, seed=31), vehicle)
    assert apart_from_fmus(study, random_setups(study, 8)) < AGREED


@pytest.mark.nightly
def test_a_car_with_a_real_mode_agrees_with_its_fmu(fmus, tmp_path):
    """The other cars have pairs of modes only; this one decays alone, in 0.04 s."""
    car, rng = json.loads(IDENTIFIED.read_text()), np.random.default_rng(3)
    car["A"] = [[*row, 0.0] for row in car["A"]] + [[0.0] * len(car["A"]) + [-25.0]]
    car["C"] = [[*row, 0.01 * np.abs(row).max() * rng.normal()] for row in car["C"]]
    car["B"].append((0.01 * np.abs(car["B"]).max(axis=0) * rng.normal(size=len(car["B"][0]))).tolist())
    (tmp_path / "car.json").write_text(json.dumps(car))
    fmu = build([tmp_path / "car.json"], tmp_path)[0].path
    vehicle = Vehicle(fmu, inputs={f"{corner}.aero": 10.0 for corner in CORNERS})
    drive = Drive("track", TRACK, 2.0, targets={f"{corner}.road": f"car.{corner}.road" for corner in CORNERS})
    builds, measures = random_builds(fmus, ["lpnl2", "lpf1"], 4, seed=45), (Measure("v", ("car.lf.velocity",)),)
    study = study_of(fmus, builds, vehicle, measures=measures, drives=(drive,))
    channels = tuple(f"car.{corner}.velocity" for corner in CORNERS) + tuple(f"{corner}.force" for corner in CORNERS)
    assert apart_from_fmus(study, random_setups(study, 4), channels) < AGREED


@pytest.mark.nightly
@pytest.mark.parametrize("friction", [{}, at_corners({"bristle_force": 70.0})], ids=["free", "rubbing"])
def test_a_car_with_coupled_states_agrees_with_its_fmu(fmus, tmp_path, friction):
    write_vehicle(tmp_path / "car.json", car_with_seat())
    vehicle = Vehicle(build([tmp_path / "car.json"], tmp_path)[0].path, parameters=friction)
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 4, seed=47), vehicle)
    assert apart_from_fmus(study, random_setups(study, 4), (*CHANNELS, "car.driver.acceleration")) < AGREED


def test_an_fmu_that_was_built_before_there_were_coupled_states_has_the_same_matrices(fmus, monkeypatch):
    component, path = FmuComponent(fmus["seven_dof"], "car"), fmus["seven_dof"]
    new, files = read_vehicle(component, path, {}), machine._headers(path, 0, 0)
    text = files["vehicle_data.h"]
    before = "\n".join(line for line in text.splitlines() if "static const double" not in line or "COUPLED" not in line)
    before = re.sub(r"COUPLED\w* = \d+, ", "", before.replace("COUPLING", "OTHER"))
    assert "COUPLED" in text and "COUPLED" not in before
    monkeypatch.setattr(machine, "_headers", lambda *_: {**files, "vehicle_data.h": before})
    old = read_vehicle(component, path, {})
    assert all(np.array_equal(getattr(old, name), getattr(new, name)) for name in ("A", "B", "C", "D", "offset"))


@pytest.mark.nightly
def test_a_quarter_car_agrees_with_its_fmu(fmus):
    channels = ("car.velocity", "car.tire_force", "corner.force", "corner.lagged_force")
    builds = random_builds(fmus, ["lpnl2", "hysteresis"], 4, seed=41)
    drive = Drive("track", TRACK, 2.0, targets={"lf.road": "car.road"})
    measures = (Measure("tire", ("car.tire_force",)),)
    vehicle = Vehicle(fmus["quarter_car"], inputs={"aero_force": 300.0})
    study = study_of(fmus, builds, vehicle, measures=measures, drives=(drive,))
    setups = [study.space.setup(k) for k in range(4)]
    assert apart_from_fmus(study, setups, channels, step=3.125e-5) < 0.01


def test_a_step_longer_than_the_drives_follows_its_points(fmus):
    """Its points are 2 ms apart."""
    study = study_of(fmus, random_builds(fmus, ["lpnl2"], 3, seed=43), record_step=4e-3)
    setups, rides = random_setups(study, 4), ("car.front.ride_height", "car.rear.ride_height")
    fine = on_machine(study, setups, rides).values.copy()
    assert largest_apart(on_machine(study, setups, rides, step=4e-3).values, fine) < 0.3


#: Narrower instruction sets by that of the processor; each takes a compilation.
NARROWER = {"avx512dq": ("avx2", ""), "avx2": ("",)}


@pytest.mark.nightly
def test_the_bits_of_a_setup_do_not_depend_on_its_lane_or_its_neighbours(fmus):
    study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=51))
    setups = random_setups(study, 8)

    def bits(order):
        found = on_machine(study, [setups[k] for k in order], step=2e-3).values
        return {k: np.ascontiguousarray(found[:, :, lane]).tobytes() for lane, k in enumerate(order)}

    whole = bits(range(8))
    assert len(set(whole.values())) == 8
    assert bits([5, 2, 7, 0, 1, 6, 3, 4]) == whole
    assert bits([3]) == {3: whole[3]} and bits([6, 3]) == {6: whole[6], 3: whole[3]}


def test_a_shock_with_a_motion_ratio_does_not_change_the_bits_of_its_neighbours_without_one(fmus):
    study = study_of(fmus, {name: Build(fmus["lpnl2"], {"motion_ratio": r}) for name, r in (("1", 1.0), ("2", 1.3))})
    plain, geared = (study.space.find(dict.fromkeys(study.corners, name)) for name in ("1", "2"))
    alone = on_machine(study, [plain], step=2e-3).values.copy()
    together = on_machine(study, [plain, geared], step=2e-3).values
    assert together[:, :, :1].tobytes() == alone.tobytes() and (together[:, :, 1] != together[:, :, 0]).any()


@pytest.mark.nightly
def test_the_width_of_the_processor_changes_the_last_digits_only(fmus, monkeypatch):
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 6, seed=61))
    setups = random_setups(study, 2)
    widest = on_machine(study, setups, step=2e-3).values.copy()
    for width in NARROWER.get(instruction_set(), ()):
        monkeypatch.setattr(car, "instruction_set", lambda width=width: width)
        assert largest_apart(on_machine(study, setups, step=2e-3).values, widest) < 1e-7


def test_the_damping_around_which_the_ports_are_solved_changes_the_result_by_less_than_the_step(fmus):
    study = study_of(fmus, random_builds(fmus, ["lpnl2"], 2, seed=63))
    setups = random_setups(study, 2)
    usual, exact = on_machine(study, setups, step=2e-3).values.copy(), on_machine(study, setups).values.copy()
    other = on_machine(study, setups, step=2e-3, damping=3000.0).values
    assert largest_apart(other, usual) < 2.0 * largest_apart(usual, exact)


def test_the_error_of_a_step_is_small_and_falls_fast(fmus):
    """The figures are those of docs/explanation/machine.md."""
    study = study_of(fmus, {"lpnl2": Build(fmus["lpnl2"], {})})
    kinds = np.repeat(("velocity", "tire_force", "hub_acceleration"), 4)
    channels = tuple(f"car.{corner}.{what}" for what, corner in zip(kinds, CORNERS * 3, strict=True))
    setups = random_setups(study, 1)
    exact = on_machine(study, setups, channels).values.copy()

    def errors(step):
        found = on_machine(study, setups, channels, step=step).values
        return np.array([largest_apart(found[:, kinds == kind], exact[:, kinds == kind]) for kind in kinds[::4]])

    at_2_ms, at_half_a_ms = errors(2e-3), errors(5e-4)
    assert (at_2_ms < (0.1, 0.05, 0.2)).all() and (at_half_a_ms < at_2_ms / 12.0).all()


@pytest.mark.nightly
def test_a_setup_that_diverges_is_retired_and_changes_no_other(fmus):
    builds = random_builds(fmus, ["lpnl2"], 4, seed=71)
    wild = Build(fmus["polylinear"], {"compression_scale": 4000.0, "rebound_scale": 4000.0})
    study = study_of(fmus, {**builds, "wild": wild})
    tame = [study.space.find(dict.fromkeys(study.corners, name)) for name in builds]
    diverging = study.space.find(dict.fromkeys(study.corners, "wild"))
    alone = on_machine(study, tame, step=2e-3).values.copy()
    found = on_machine(study, [tame[0], diverging, *tame[1:]], step=2e-3)
    assert (found.ended >= 0).tolist() == [False, True, False, False, False]
    assert np.isfinite(found.values).all()
    assert found.values[:, :, [0, 2, 3, 4]].tobytes() == alone.tobytes()


def test_channels_are_compared_that_move(fmus):
    """The comparisons above would be empty if the series were constant."""
    study = study_of(fmus, random_builds(fmus, ["lpnl2"], 2, seed=81))
    assert np.ptp(on_machine(study, random_setups(study, 2), step=2e-3).values, axis=0).any(axis=1).all()
