"""The flexible car obeys its equations, its friction sticks exactly, and its integration is of second order."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.signal import StateSpace, lsim

from eightpost.errors import ParameterError
from eightpost.signals import TimeSeries
from eightpost.virtual import LinearDamper, Run, flexible_truth, shim_build, simulate, truth_named
from eightpost.virtual.drivefiles import RATE
from eightpost.virtual.flexible import Sliders, base_car, numbers_of
from eightpost.virtual.kernel import slide
from eightpost.virtual.truths import TRUTHS

DAMPING = 3000.0


def drive_of(car, duration, *, road=4e-3, load=400.0):
    """Incommensurate sines on every input, which grow from zero within half a second."""
    time = np.arange(round(duration * RATE) + 1) / RATE
    growth = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / 0.5, 1.0))
    channels = {}
    for i, name in enumerate(car.inputs):
        wave = sum(np.sin(2 * np.pi * f * (1 + 0.03 * i) * time + i) for f in (1.7, 5.3, 14.1)) / 3
        channels[name] = ("m", growth * wave * road) if i < 4 else ("N", growth * wave * load)
    return TimeSeries.from_channels(time, channels)


def straightened(car):
    """Return the car without friction, hysteresis, curvature, stops and lift-off."""
    ratio = car.suspension.ratio * np.array([1.0, 0.0, 0.0])
    suspension = replace(car.suspension, ratio=ratio, stop_gap=np.full(4, np.inf))
    tires = replace(
        car.tires, stiffening=np.full(4, 1e-6), hysteresis=car.tires.hysteresis.scaled(0.0), static_load=np.full(4, 1e9)
    )
    return replace(car.without_friction(), suspension=suspension, tires=tires)


def matrices(car):
    """Return M, C, K and the input matrices of roads, of their rates and of loads of the straightened car.

    They come from the energies of the elements, each of which is a row from the eleven coordinates to its travel.
    """
    M = np.diag(numbers_of(car).masses)
    shell, engine, own = car.shell, car.engine, car.suspension
    K, C = np.zeros((11, 11)), np.zeros((11, 11))
    for k, (mass, frequency, ratio) in zip((3, 4), (shell.bending, shell.torsion), strict=True):
        K[k, k], C[k, k] = mass * (2 * np.pi * frequency) ** 2, 2 * ratio * mass * 2 * np.pi * frequency
    for arm, stiffness, damping in zip(engine.arms, engine.stiffness, engine.damping, strict=True):
        row = np.concatenate((-shell.row(engine.ahead + arm, 0.0), [1.0, -arm], np.zeros(4)))
        K += stiffness * np.outer(row, row)
        C += damping * np.outer(row, row)
    wheels = np.eye(11)[7:]
    travel = wheels - np.hstack([car.corner_rows, np.zeros((4, 6))])
    r0 = own.ratio[:, 0]
    K += travel.T @ np.diag(own.rate * r0**2) @ travel
    C += travel.T @ np.diag(DAMPING * r0**2 + own.damping) @ travel
    for axle, bar in enumerate(own.bars):
        row = travel[2 * axle] - travel[2 * axle + 1]
        K += bar * np.outer(row, row)
    K += wheels.T @ np.diag(car.tires.stiffness) @ wheels
    C += wheels.T @ np.diag(car.tires.damping) @ wheels
    loads = -np.hstack([car.load_rows, np.zeros((4, 6))]).T
    return M, C, K, wheels.T * car.tires.stiffness, wheels.T * car.tires.damping, loads


@pytest.mark.parametrize("seed", [None, 3])
def test_without_its_nonlinear_parts_it_moves_as_the_linear_equations_say(seed):
    car = straightened(truth_named("flexible", seed))
    M, C, K, road, road_rate, load = matrices(car)
    drive = drive_of(car, 3.0)
    inputs = np.stack([drive[name] for name in car.inputs])
    rates = np.gradient(inputs[:4], 1.0 / RATE, axis=1, edge_order=2)
    A = np.block([[np.zeros((11, 11)), np.eye(11)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack([np.zeros((11, 12)), np.linalg.solve(M, np.hstack([road, load, road_rate]))])
    system = StateSpace(A, B, np.eye(22), np.zeros((22, 12)))
    _, y, _ = lsim(system, np.vstack([inputs, rates]).T, drive.time)
    motion = simulate(car, [Run(drive, (LinearDamper(DAMPING),) * 4)], lead=0.0)[0]
    expected = np.vstack([y.T[7:11], car.corner_rows @ y.T[:5]])
    found = np.vstack([car.wheel @ motion.position, car.chassis @ motion.position])
    error = np.abs(found - expected).max(axis=1) / expected.std(axis=1)
    assert error.max() < 2e-3
    travel = numbers_of(car).suspension[:, :1] * (expected[:4] - expected[4:])
    assert np.abs(car.shock @ motion.position - travel).max() < 2e-3 * travel.std()


def test_its_engine_and_its_chassis_have_modes_near_11_and_23_hz():
    car = straightened(base_car())
    M, _, K, *_ = matrices(car)
    held = K[5:7, 5:7]  # the engine on a shell that does not move
    engine = np.sqrt(eigh(held, M[5:7, 5:7], eigvals_only=True)) / (2 * np.pi)
    assert engine.min() == pytest.approx(11.0, abs=1.5)
    frequencies = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
    assert np.abs(frequencies - 23.0).min() < 3.0


@pytest.mark.slow
def test_rms_measures_converge_with_second_order_and_are_accurate_at_the_default_steps():
    car, drive = flexible_truth(2), drive_of(flexible_truth(2), 4.0)

    def measures(shock, steps):
        motion = simulate(car, [Run(drive, (shock,) * 4)], lead=0.5, steps=steps)[0]
        rows = [car.shock @ motion.velocity, motion.tire_force, car.wheel @ motion.acceleration]
        return np.concatenate([row.std(axis=1) for row in rows])

    linear = LinearDamper(DAMPING)
    finest = measures(linear, 64)
    errors = [np.abs(measures(linear, steps) / finest - 1.0).max() for steps in (4, 8, 16)]
    assert errors[0] < 5e-4
    assert all(coarse / fine > 3.0 for coarse, fine in pairwise(errors))
    physical = shim_build("B/B")
    assert np.abs(measures(physical, 8) / measures(physical, 32) - 1.0).max() < 1e-3


def test_a_wheel_sticks_until_the_force_exceeds_the_breakaway_force():
    """The wheels stay where they are while the load is held: the car rings about a place that does not creep."""
    car = base_car()
    time = np.arange(round(8.0 * RATE) + 1) / RATE
    level = 20.0 * np.minimum(time, 1.0)  # a load of 80 N in all, below the breakaway force of 241 N
    drive = TimeSeries.from_channels(
        time, {n: ("m", 0.0 * time) if n.endswith("road") else ("N", level) for n in car.inputs}
    )
    travel = car.shock @ simulate(car, [Run(drive, (LinearDamper(DAMPING),) * 4)], lead=0.0)[0].position
    early, late = (travel[:, round(a * RATE) : round(b * RATE)].mean(axis=1) for a, b in ((2.0, 4.0), (6.0, 8.0)))
    assert np.abs(late - early).max() < 2e-3 * np.abs(late).min()
    bare = car.without_friction()
    free = bare.shock @ simulate(bare, [Run(drive, (LinearDamper(DAMPING),) * 4)], lead=0.0)[0].position
    assert np.abs(travel[:, -1]).max() < 0.3 * np.abs(free[:, -1]).min()


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    sliding=st.floats(1.0, 100.0),
    ratio=st.floats(1.0, 1.5),
    stiffness=st.floats(1e5, 1e7),
    moves=st.lists(st.floats(-1e-3, 1e-3), min_size=2, max_size=30),
)
def test_a_slider_never_gives_energy_and_never_exceeds_its_breakaway_force(sliding, ratio, stiffness, moves):
    slider, state = np.array([sliding, ratio * sliding, stiffness]), np.zeros(3)
    place, work = 0.0, 0.0
    for move in moves:
        for part in np.linspace(place, place + move, 50)[1:]:
            before = state[0]
            force = slide(slider, state, part)
            assert abs(force) <= ratio * sliding + 1e-9
            work += 0.5 * (before + force) * (move / 49)
        place += move
    # A jump from the breakaway to the sliding force within a step may return half of what the spring still stores.
    stored = 0.5 * state[0] ** 2 / stiffness
    assert work >= -1e-9 - stored
    assert np.all(Sliders(*slider[:, None]).scaled(0.0).sliding == 0.0)


def test_a_seed_gives_one_car_and_other_seeds_give_others():
    one, same, other = flexible_truth(5), flexible_truth(5), flexible_truth(6)
    assert one.shell.mass == same.shell.mass
    assert np.array_equal(one.friction.sliding, same.friction.sliding)
    assert abs(one.shell.mass / other.shell.mass - 1.0) > 1e-4
    masses = [flexible_truth(seed).shell.mass for seed in range(200)]
    assert np.std(masses) / np.mean(masses) == pytest.approx(0.06, abs=0.015)


def test_only_the_flexible_car_has_a_seed():
    assert truth_named("flexible", 5).name == "flexible:5"
    for name in TRUTHS:
        if name != "flexible":
            with pytest.raises(ParameterError, match="no random parameters"):
                truth_named(name, 1)
