"""The true cars of benchmarks/cars obey what they state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from benchmarks.cars import judge, rig
from benchmarks.cars.car import CORNERS, contact, rubber
from benchmarks.cars.draw import KINDS, draw
from benchmarks.cars.rig import tests_of as five_tests
from eightpost.rig import read_rig_test
from eightpost.shock import Shock
from eightpost.signals import ChannelMap

pytestmark = pytest.mark.nightly  # evidence, not the product


def short(car, *, steps=rig.STEPS, scale=1.0):
    drive = rig.random_drive(car, 4.5, 3, road=0.0045 * scale)
    return rig.run(car, [car.bank[k] for k in (3, 0, 6, 2)], drive, steps=steps)


def linear_car():
    car = draw("rubber", 2)
    none = (0.0,) * 4
    shock = replace(car.bank[0], compression=(4000.0, 4000.0, 0.1), rebound=(4000.0, 4000.0, 0.1), fades=(0.0, 1e-3))
    return replace(
        car, bank=(shock,), rising=none, links=none, bushes=none, bar_friction=(0.0, 0.0), tire_growth=0.0,
        bumps=(1.0, 0.0), downforce=(0.0, 0.0),
    )  # fmt: skip


def test_linear_car_moves_as_the_state_space_of_its_matrices():
    car = linear_car()
    n, (k_mount, c_mount), c = car.numbers(), car.mounts, 4000.0
    ratio, spring = np.array(car.ratio), np.array(car.springs)
    bars = np.kron(np.diag(car.bars), [[1.0, -1.0], [-1.0, 1.0]])
    W, T, size = n.travel, n.wheel, 11
    share = 1.0 / (c + c_mount)  # v = share (k_mount (r w - x) + c_mount r w')
    K = n.stiffness + W.T @ (np.diag(ratio**2 * (spring + c * share * k_mount)) + bars) @ W + (T.T * car.tires) @ T
    C = n.damping + W.T @ np.diag(ratio**2 * c * share * c_mount) @ W + car.tire_damping * T.T @ T
    x_force = (W.T * ratio) * (c * share * k_mount)
    A = np.block(
        [
            [np.zeros((size, size)), np.eye(size), np.zeros((size, 4))],
            [-n.inverse @ K, -n.inverse @ C, n.inverse @ x_force],
            [share * k_mount * ratio[:, None] * W, share * c_mount * ratio[:, None] * W, -share * k_mount * np.eye(4)],
        ]
    )
    B = np.zeros((26, 12))
    B[size : 2 * size] = n.inverse @ np.hstack([T.T * car.tires, -n.load.T, car.tire_damping * T.T])
    drive = rig.random_drive(car, 6.0, 3)
    rate = rig.RATE * 4
    values = drive.at(rate)
    lead = round(rig.LEAD * rate)
    whole = np.concatenate([values[:, -lead:], values], axis=1)
    whole[:, :lead] *= 0.5 - 0.5 * np.cos(np.pi * np.arange(lead) / lead)
    u = np.vstack([whole, np.gradient(whole[:4], 1.0 / rate, axis=1)]).T
    _, _, x = lsim(StateSpace(A, B, np.eye(26), np.zeros((26, 12))), u, np.arange(len(u)) / rate)
    x = x[lead::4].T
    motion = rig.run(car, car.bank * 4, drive, steps=4)
    for k, corner in enumerate(("lf", "rf", "lr", "rr")):
        travel = motion.channels[f"{corner}.displacement"]
        assert np.std(travel - x[22 + k]) < 3e-4 * np.std(travel)
        tire = motion.channels[f"{corner}.tire_force"]
        linear = car.tires[k] * (values[k, ::4] - x[7 + k]) + car.tire_damping * (u[lead::4, 8 + k] - x[18 + k])
        assert np.std(tire - tire.mean() - linear + linear.mean()) < 1e-3 * np.std(tire)


@pytest.mark.parametrize("kind", KINDS)
def test_half_the_step_changes_no_measure_by_a_twentieth_of_a_percent(kind):
    car = draw(kind, 1)
    coarse, fine = (judge.measures(short(car, steps=steps)) for steps in (rig.STEPS, 2 * rig.STEPS))
    assert all(abs(coarse[name] / fine[name] - 1.0) < 5e-4 for name in judge.NAMES)


@pytest.mark.parametrize("kind", KINDS)
def test_static_loads_carry_the_car(kind):
    car = draw(kind, 1)
    weight = car.body[0] + car.engine[0] + sum(car.hubs)
    assert car.static_loads.sum() == pytest.approx(9.80665 * weight)
    drive = rig.random_drive(replace(car, downforce=(0.0, 0.0)), 1.0, 1, road=0.0, load=0.0)
    rest = rig.run(car, car.bank[:4], drive).channels
    assert [rest[f"{corner}.tire_force"][-1] for corner in CORNERS] == pytest.approx(car.static_loads)


def test_five_tests_differ_in_one_shock():
    car = draw("links", 1)
    tests = dict(five_tests(car, 4.0, 1))
    assert list(tests) == ["baseline", "alternate_lf", "alternate_rf", "alternate_lr", "alternate_rr"]
    softer = [np.std(tests[f"alternate_{c}"].channels[f"{c}.force"]) for c in CORNERS]
    assert all(np.array(softer) < [0.9 * np.std(tests["baseline"].channels[f"{c}.force"]) for c in CORNERS])


def test_tires_lift_and_do_not_pull():
    motion = short(draw("links", 1), scale=4.0)
    tire = motion.channels["lf.tire_force"]
    assert tire.min() == 0.0
    assert 0.0 < np.mean(tire == 0.0) < 0.2


def test_dry_contact_sticks_as_a_spring_up_to_its_limit():
    assert contact(10.0, 55.0, 20.0) == 30.0
    assert contact(-50.0, 55.0, -20.0) == -55.0


def test_rubber_behind_a_contact_slides_at_its_limit():
    assert rubber(1e-4, 60.0, 1e5, 100.0, 1e-4, 0.1, 1e-3) == (2e-4, 30.0)
    bend, force = rubber(1e-4, 60.0, 1e5, 100.0, 1e-3, 1.0, 1e-3)
    assert force == 60.0
    assert 1e5 * bend + 100.0 * (bend - 1e-4) / 1e-3 == pytest.approx(60.0)


@pytest.mark.parametrize("kind", ["links", "rubber"])
def test_records_read_in_the_teams_units_are_those_of_the_sensors(kind, tmp_path):
    car = replace(draw(kind, 1), sensors=replace(draw(kind, 1).sensors, noise=0.0, gain=0.0, delays={}))
    motion = rig.run(car, car.bank[:4], rig.random_drive(car, 4.5, 1))
    channels = rig.recorded(car, motion, 1)
    path, map_ = rig.write_record(car, channels, tmp_path / "a"), rig.write_map(car, channels, tmp_path / "map.toml")
    read, motion = read_rig_test(path, channel_map=ChannelMap.read(map_)).series, motion.channels
    for name in set(motion) & set(read.names) - {f"{c}.velocity" for c in ("lf", "rf", "lr", "rr")}:
        assert np.allclose(read[name], motion[name], rtol=1e-4, atol=1e-4 * np.abs(motion[name]).max()), name


def test_fitted_shock_has_nearly_the_force_of_its_law():
    true = Shock("soft", draw("links", 1).bank[0].law)
    (found,) = judge.fitted([true], 1)
    for v in (-0.5, -0.1, 0.1, 0.5):
        assert found.law.curve.force(v) == pytest.approx(true.law.curve.force(v), rel=0.02)
    assert found.name == "soft"
