"""Setups in lanes have the bits of the FMUs, with every law, port parameter and friction, at any place in any batch."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from builder.build import build
from cosim.components.fmu_component import FmuComponent
from cosim.study import Build, Drive, Measure, Vehicle
from eightpost.machine.library import instruction_set
from cosim.study.batch.car import _car
from cosim.study.batch.library import instruction_set
from cosim.study.batch.sources import Sources
from eightpost.corners import CORNERS
from eightpost.vehicle import write_vehicle
from tests.double_modes import car_with_seat

from .batched import (
    CHANNELS,
    COUPLING,
    LAWS,
    TRACK,
    differing,
    in_lanes,
    knots_of,
    random_builds,
    random_setups,
    study_of,
)

IDENTIFIED = Path(__file__).resolve().parents[4] / "examples" / "identified" / "car.json"
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
def test_every_law_has_the_bits_of_its_fmu(fmus, law):
    study = study_of(fmus, random_builds(fmus, [law], 8, seed=LAWS.index(law)))
    assert differing(study, random_setups(study, 8)) == []


@pytest.mark.nightly
def test_laws_can_be_mixed_in_a_batch(fmus):
    study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=11))
    assert differing(study, random_setups(study, 8)) == []


@pytest.mark.nightly
def test_curves_through_knots_and_polynomials_can_be_mixed(fmus):
    knots = knots_of(FmuComponent(fmus["hysteresis"], "shock"))
    builds = random_builds(fmus, ["lpnl2", "polylinear"], 6, seed=21)
    through = {f"{name} knots": Build(b.fmu, {**b.parameters, **knots}) for name, b in builds.items()}
    study = study_of(fmus, {**builds, **through})
    assert differing(study, random_setups(study, 8)) == []
    study = study_of(fmus, through)
    assert differing(study, random_setups(study, 8)) == []


@pytest.mark.nightly
@pytest.mark.parametrize("kind", FRICTION)
def test_every_friction_has_the_bits_of_the_vehicle(fmus, kind):
    vehicle = Vehicle(fmus["seven_dof"], parameters=at_corners(FRICTION[kind]))
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 6, seed=31), vehicle)
    assert differing(study, random_setups(study, 8)) == []


@pytest.mark.nightly
def test_a_car_with_a_real_mode_has_the_bits_of_its_fmu(fmus, tmp_path):
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
    assert differing(study, random_setups(study, 4), channels) == []


@pytest.mark.nightly
@pytest.mark.parametrize("friction", [{}, at_corners({"bristle_force": 70.0})], ids=["free", "rubbing"])
def test_a_car_with_coupled_states_has_the_bits_of_its_fmu(fmus, tmp_path, friction):
    write_vehicle(tmp_path / "car.json", car_with_seat())
    vehicle = Vehicle(build([tmp_path / "car.json"], tmp_path)[0].path, parameters=friction)
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 4, seed=47), vehicle)
    assert differing(study, random_setups(study, 4), (*CHANNELS, "car.driver.acceleration")) == []


def test_an_fmu_that_was_built_before_there_were_coupled_states_has_the_same_data(fmus):
    component, path = FmuComponent(fmus["seven_dof"], "car"), fmus["seven_dof"]
    text = Sources.of(component, path).files["vehicle_data.h"]
    before = "\n".join(line for line in text.splitlines() if "static const double" not in line or "COUPLED" not in line)
    before = re.sub(r"COUPLED\w* = \d+, ", "", before)
    assert "COUPLED" in text and "COUPLED" not in before
    old, new = (_car(component, content, {}, 4) for content in (before, text))
    assert (old.sizes, old.data) == (new.sizes, new.data)


@pytest.mark.nightly
def test_a_quarter_car_has_the_bits_of_its_fmu(fmus):
    channels = ("car.velocity", "car.tire_force", "corner.force", "corner.lagged_force")
    builds = random_builds(fmus, ["lpnl2", "hysteresis"], 4, seed=41)
    drive = Drive("track", TRACK, 2.0, targets={"lf.road": "car.road"})
    measures = (Measure("tire", ("car.tire_force",)),)
    vehicle = Vehicle(fmus["quarter_car"], inputs={"aero_force": 300.0})
    study = study_of(fmus, builds, vehicle, measures=measures, drives=(drive,))
    setups = [study.space.setup(k) for k in range(4)]
    assert differing(study, setups, channels) == []


def test_a_step_longer_than_the_drives_follows_its_points(fmus):
    study = study_of(fmus, random_builds(fmus, ["lpnl2"], 3, seed=43), record_step=4e-3)
    coarse = replace(COUPLING, step=4e-3)
    assert differing(study, random_setups(study, 4), coupling=coarse) == []


#: Narrower instruction sets by that of the processor; each takes a compilation.
NARROWER = {"avx512dq": ("avx2", ""), "avx2": ("",)}


@pytest.mark.nightly
@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.nightly)], ids=["narrowest", "all widths"])
def test_the_bits_of_a_setup_do_not_depend_on_its_lane_its_neighbours_or_the_width_of_the_processor(fmus, count):
    study = study_of(fmus, random_builds(fmus, LAWS, 10, seed=51))
    setups = random_setups(study, 8)

    def bits(order, width=None):
        found = in_lanes(study, [setups[k] for k in order], width=width).series
        return {k: np.ascontiguousarray(found[:, :, lane]).tobytes() for lane, k in enumerate(order)}

    whole = bits(range(8))
    assert len(set(whole.values())) == 8
    assert bits([5, 2, 7, 0, 1, 6, 3, 4]) == whole
    assert bits([3]) == {3: whole[3]} and bits([6, 3]) == {6: whole[6], 3: whole[3]}
    widths = NARROWER.get(instruction_set(), ())[-count:]
    assert all(bits(range(8), width) == whole for width in widths)


@pytest.mark.nightly
def test_fused_operations_change_the_last_bits_only(fmus):
    study = study_of(fmus, random_builds(fmus, ["lpnl2", "lpf1"], 6, seed=61))
    setups = random_setups(study, 8)
    exact, fast = in_lanes(study, setups).series.copy(), in_lanes(study, setups, fast=True).series
    scale = np.abs(exact).max(axis=(0, 2), keepdims=True)
    assert np.max(np.abs(fast - exact) / np.maximum(scale, 1e-9)) < 1e-9
    if instruction_set():
        assert (fast != exact).any()


@pytest.mark.nightly
def test_a_setup_that_diverges_is_retired_and_changes_no_other(fmus):
    builds = random_builds(fmus, ["lpnl2"], 4, seed=71)
    wild = Build(fmus["polylinear"], {"compression_scale": 400.0, "rebound_scale": 400.0})
    study = study_of(fmus, {**builds, "wild": wild})
    names = list(builds)
    tame = [study.space.find(dict.fromkeys(study.corners, name)) for name in names]
    diverging = study.space.find(dict.fromkeys(study.corners, "wild"))
    alone = in_lanes(study, tame).series.copy()
    found = in_lanes(study, [tame[0], diverging, *tame[1:]])
    assert (found.ended >= 0).tolist() == [False, True, False, False, False]
    assert np.isfinite(found.series).all()
    assert found.series[:, :, [0, 2, 3, 4]].tobytes() == alone.tobytes()


def test_channels_are_compared_that_move(fmus):
    """The comparisons above would be empty if the series were constant."""
    study = study_of(fmus, random_builds(fmus, ["lpnl2"], 2, seed=81))
    moving = np.ptp(in_lanes(study, random_setups(study, 2)).series, axis=0)
    still = {name for column, name in enumerate(CHANNELS) if not moving[column].any()}
    assert still <= {"lf.beyond_fit"}
