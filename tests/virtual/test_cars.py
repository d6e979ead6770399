"""The virtual rig's cars obey mechanics, and the linear ones agree with the models that chapters 4 and 5 print."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.signal import lsim

from eightpost.errors import ParameterError, StepError
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle.structural import Corners, QuarterCar, SevenDof
from eightpost.virtual import (
    TRUTHS,
    LinearDamper,
    Run,
    demo_damper,
    flexible_truth,
    quarter_truth,
    seven_dof_truth,
    shim_build,
    simulate,
    simulate_setups,
    stand_in_truth,
    truth_named,
)
from eightpost.virtual.car import base_car
from eightpost.virtual.drivefiles import RATE
from eightpost.virtual.kernel import slide

POUND, INCH = convert(1.0, "lbf", "N"), convert(1.0, "in", "m")
RATE_UNIT, DAMPING_UNIT = convert(1.0, "lbf/in", "N/m"), convert(1.0, "lbf.s/in", "N.s/m")
MASS = convert(1.0, "lbm", "kg")
MIDDLE = 20 * DAMPING_UNIT


def moved(car, drive, damping=MIDDLE, *, lead=0.1, steps=4):
    """Return the motion of a car with linear dampers, one damping or one for each corner [N.s/m]."""
    shocks = tuple(LinearDamper(c) for c in np.broadcast_to(damping, len(car.corners)).tolist())
    return simulate(car, [Run(drive, shocks)], lead=lead, steps=steps)[0]


def same_inputs(car, time, road, load):
    """Return a drive with one motion of all roads and one force of all loads."""
    channels = {name: ("m", road) if name.endswith("road") else ("N", load) for name in car.inputs}
    return TimeSeries.from_channels(time, channels)


def drive_of(car, duration, *, road=0.2 * INCH, load=100.0 * POUND):
    """Three incommensurate sines on every input, which grow from zero within half a second."""
    time = np.arange(round(duration * RATE) + 1) / RATE
    growth = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / 0.5, 1.0))
    channels = {}
    for i, name in enumerate(car.inputs):
        wave = sum(np.sin(2 * np.pi * f * (1 + 0.03 * i) * time + i) for f in (1.7, 5.3, 14.1)) / 3
        unit = "m" if i < len(car.corners) else car.load_units[i - len(car.corners)]
        channels[name] = (unit, growth * wave * (road if unit == "m" else load))
    return TimeSeries.from_channels(time, channels)


def printed_response(model, drive, names):
    """Return the response of the printed state space to the drive, computed by scipy on a grid four times as fine."""
    fine = np.arange(4 * (len(drive) - 1) + 1) / (4 * RATE)
    inputs = [n for n in model.input_names if n in drive]
    rows = CubicSpline(drive.time, np.stack([drive[n] for n in inputs], axis=1))(fine)
    columns = [model.input_names.index(n) for n in inputs]
    _, outputs, _ = lsim((model.A, model.B[:, columns], model.C, model.D[:, columns]), rows, fine)
    return {n: outputs[::4, model.output_names.index(n)] for n in names}


def error(found, expected):
    return np.abs(found - expected).max() / np.std(expected)


def test_the_quarter_car_agrees_with_the_printed_equations():
    car = quarter_truth()
    drive = drive_of(car, 2.0)
    motion = moved(car, drive, 16.67 * DAMPING_UNIT)
    printed = QuarterCar(
        sprung_mass=675 * MASS, unsprung_mass=75 * MASS, suspension_stiffness=1280 * RATE_UNIT,
        tire_stiffness=1300 * RATE_UNIT, damping=16.67 * DAMPING_UNIT,
    )  # fmt: skip
    expected = printed_response(printed.with_damper(), drive, ["tire_force", "velocity"])
    assert error(motion.tire_force[0], expected["tire_force"]) < 1e-3
    assert error((car.shock @ motion.velocity)[0], expected["velocity"]) < 1e-3


def test_the_seven_dof_car_agrees_with_the_printed_equations():
    car = seven_dof_truth()
    drive = drive_of(car, 2.0)
    motion = moved(car, drive, 30 * DAMPING_UNIT)
    inertia = MASS * INCH**2
    printed = SevenDof(
        track_width=70 * INCH, cg_to_front_axle=60 * INCH, cg_to_rear_axle=50 * INCH, sprung_mass=2550 * MASS,
        roll_inertia=1.5e6 * inertia, pitch_inertia=5.5e6 * inertia,
        unsprung_mass=Corners.axles(101 * MASS, 124 * MASS),
        spring_rate=Corners.axles(1280 * RATE_UNIT, 588 * RATE_UNIT),
        tire_stiffness=Corners.same(2000 * RATE_UNIT), damping=Corners.same(30 * DAMPING_UNIT),
    )  # fmt: skip
    names = [f"{c}.{q}" for q in ("tire_force", "velocity") for c in car.corners]
    expected = printed_response(printed.with_damper(), drive, names)
    for k, corner in enumerate(car.corners):
        assert error(motion.tire_force[k], expected[f"{corner}.tire_force"]) < 1e-3
        assert error((car.shock @ motion.velocity)[k], expected[f"{corner}.velocity"]) < 1e-3


def spring_energy(springs, compression):
    """Return the change of stored energy from static (C, B) [J], without the work of the static force."""
    into = np.maximum(compression - springs.stop_gap, 0.0)
    spring = springs.rate * compression**2 * (0.5 + springs.progression * compression / 3.0)
    return spring + springs.stop_rate * into**3 / 3.0


def test_the_stand_in_conserves_energy():
    springs = stand_in_truth().springs
    car = replace(stand_in_truth(), springs=replace(springs, stop_gap=0.1 * springs.stop_gap))
    m = moved(car, drive_of(car, 2.0, road=0.4 * INCH))
    assert (car.spring @ m.position > car.springs.stop_gap).any()  # the bump stops are reached
    shock, wheel, load = car.shock @ m.velocity, car.wheel @ m.velocity, car.load @ m.velocity
    power = (m.tire_force * wheel).sum(axis=0) + (m.drive[4:] * load).sum(axis=0)
    lost = ((m.shock_force + m.friction_force) * shock).sum(axis=0)
    lost += np.einsum("it,ij,jt->t", m.velocity, car.damping, m.velocity)
    stored = 0.5 * (car.mass @ m.velocity**2) + spring_energy(car.springs, car.spring @ m.position).sum(axis=0)
    stored += 0.5 * np.einsum("it,ij,jt->t", m.position, car.stiffness, m.position)
    net = trapezoid(power - lost, m.time)
    turned_over = trapezoid(np.abs(power), m.time)
    assert abs(stored[-1] - stored[0] - net) < 2e-3 * turned_over


def test_shocks_and_tires_of_the_stand_in_have_their_own_laws():
    car, drive = stand_in_truth(), drive_of(stand_in_truth(), 1.0, road=0.5 * INCH)
    dampings = np.array([9.0, 20.0, 30.0, 12.0]) * DAMPING_UNIT
    m = moved(car, drive, dampings)
    # The velocity in a shock's force is the one that the step predicts.
    assert error(m.shock_force, dampings[:, None] * (car.shock @ m.velocity)) < 2e-3
    speed = np.gradient(m.drive[:4], m.time, axis=1, edge_order=2) - car.wheel @ m.velocity
    free = car.tires.stiffness * (m.drive[:4] - car.wheel @ m.position) + car.tires.damping * speed
    inner = slice(2, -2)  # where the slope of the road is known
    assert error(m.tire_force[:, inner], np.maximum(free, -car.tires.static_load)[:, inner]) < 2e-3
    assert error(m.tire_force, free - car.tires.damping * speed) > 1e-2


def test_friction_holds_the_car_against_a_load_below_it():
    car = stand_in_truth()
    time = np.arange(round(1.5 * RATE)) / RATE
    push = 8.0 * POUND * (0.5 - 0.5 * np.cos(np.pi * np.minimum(time, 1.0)))
    drive = same_inputs(car, time, 0.0 * time, push)
    held, free = (moved(one, drive) for one in (car, car.without_friction()))
    travel = [np.abs(car.shock @ m.position)[:, -1] for m in (held, free)]
    assert (travel[0] < 0.5 * travel[1]).all()
    assert np.abs(held.friction_force[:, -1]).max() < car.friction.coulomb.min()
    assert np.abs((car.shock @ held.velocity)[:, -50:]).max() < 1e-4


def test_friction_is_elastic_before_sliding_and_never_exceeds_its_breakaway_force():
    """A quarter car whose shock is pushed slowly by its road, and whose chassis is held by its mass."""
    own = stand_in_truth().friction
    friction = replace(own, **{name: getattr(own, name)[:1] for name in ("coulomb", "breakaway", "stiffness")})
    car = replace(quarter_truth(), mass=np.array([1e9, 1.0]), friction=friction)
    reach, time = float(friction.coulomb[0, 0] / friction.stiffness[0, 0]), np.arange(round(4.0 * RATE)) / RATE
    small, far = 0.1 * reach * np.sin(2 * np.pi * time), 10.0 * reach * np.minimum(time, 1.0)
    for place in (small, far):
        # The tire is stiff against the spring, the friction and the damper.
        stiff = replace(car, tires=replace(car.tires, stiffness=car.tires.stiffness * 100.0))
        m = moved(stiff, same_inputs(stiff, time, place, 0.0 * time), 100.0)
        force, travel = m.friction_force[0], (car.shock @ m.position)[0]
        if place is small:
            assert error(force, friction.stiffness[0, 0] * travel) < 0.15
        else:
            assert float(friction.coulomb[0, 0]) < force.max() <= float(friction.breakaway[0, 0])


def test_a_wheel_leaves_the_ground_and_its_tire_does_not_pull():
    car = stand_in_truth()
    time = np.arange(round(1.0 * RATE)) / RATE
    wave = 0.6 * INCH * np.minimum(time, 1.0) * np.sin(2 * np.pi * 14.0 * time)
    motion = moved(car, same_inputs(car, time, wave, 0.0 * time), 3500.0)
    whole = motion.tire_force + car.tires.static_load
    assert whole.min() == 0.0
    assert (whole == 0.0).any(axis=1).all()


def test_the_far_wheel_of_the_solid_axle_moves_a_rear_shock_ten_decibels_less():
    car = stand_in_truth()
    axle, roll = car.shock[2, 6], car.shock[2, 7]
    half = 35 * INCH
    own, far = 0.5 * axle + 0.5 * roll / half, 0.5 * axle - 0.5 * roll / half
    assert 20 * np.log10(far / own) == pytest.approx(-10.0, abs=0.3)
    assert car.shock[0, 5] == 0.0  # independent in front


@pytest.mark.parametrize("kind", ["linear", "demonstration"])
def test_the_integration_is_of_second_order(kind):
    """With twice the steps the error of the measures falls by four."""
    car = seven_dof_truth()
    damper = LinearDamper(20 * DAMPING_UNIT) if kind == "linear" else demo_damper("A")
    run = Run(drive_of(car, 1.0), (damper,) * 4)
    coarse, middle, fine, truth = (simulate(car, [run], lead=0.2, steps=k)[0].tire_force for k in (2, 4, 8, 64))
    errors = [np.abs(found - truth).max() for found in (coarse, middle, fine)]
    assert 3.0 < errors[0] / errors[1] < 5.0
    assert 3.0 < errors[1] / errors[2] < 5.0


def test_many_setups_together_give_the_same_results_as_single_ones():
    car = stand_in_truth()
    drive = drive_of(car, 0.2)
    dampers = [LinearDamper(c * DAMPING_UNIT) for c in (9, 20, 30)]
    setups = [(a, b, b, a) for a in dampers for b in dampers] * 2  # more than are computed at once
    together = list(simulate_setups(car, drive, setups, lead=0.1))
    assert len(together) == len(setups)
    for motion, setup in zip(together[::5], setups[::5], strict=True):
        alone = simulate(car, [Run(drive, setup)], lead=0.1)[0]
        assert np.array_equal(motion.tire_force, alone.tire_force)


def test_a_diverging_motion_is_refused():
    car = quarter_truth()
    with pytest.raises(StepError, match=r"motion of the quarter_car diverged near"):
        moved(car, drive_of(car, 2.0), -1e6)


# ---- Flexible car ---------------------------------------------------------------------------------------------------

DAMPING = 3000.0


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
    M = np.diag(car.numbers().mass)
    shell, engine, own = car.shell, car.engine, car.suspension
    K, C = np.zeros((11, 11)), np.zeros((11, 11))
    for k, (mass, frequency, ratio) in zip((3, 4), (shell.bending, shell.torsion), strict=True):
        K[k, k], C[k, k] = mass * (2 * np.pi * frequency) ** 2, 2 * ratio * mass * 2 * np.pi * frequency
    for arm, stiffness, damping in zip(engine.arms, engine.stiffness, engine.damping, strict=True):
        row = np.concatenate((-shell.row(engine.ahead + arm, 0.0), [1.0, -arm], np.zeros(4)))
        K += stiffness * np.outer(row, row)
        C += damping * np.outer(row, row)
    wheels = np.eye(11)[7:]
    travel = wheels - np.hstack([car.rows.corners, np.zeros((4, 6))])
    r0 = own.ratio[:, 0]
    K += travel.T @ np.diag(own.rate * r0**2) @ travel
    C += travel.T @ np.diag(DAMPING * r0**2 + own.damping) @ travel
    for axle, bar in enumerate(own.bars):
        row = travel[2 * axle] - travel[2 * axle + 1]
        K += bar * np.outer(row, row)
    K += wheels.T @ np.diag(car.tires.stiffness) @ wheels
    C += wheels.T @ np.diag(car.tires.damping) @ wheels
    loads = -np.hstack([car.rows.loads, np.zeros((4, 6))]).T
    return M, C, K, wheels.T * car.tires.stiffness, wheels.T * car.tires.damping, loads


def test_without_its_nonlinear_parts_it_moves_as_the_linear_equations_say():
    car = straightened(truth_named("flexible", 3))
    M, C, K, road, road_rate, load = matrices(car)
    drive = drive_of(car, 3.0, road=4e-3, load=400.0)
    inputs = np.stack([drive[name] for name in car.inputs])
    rates = np.gradient(inputs[:4], 1.0 / RATE, axis=1, edge_order=2)
    A = np.block([[np.zeros((11, 11)), np.eye(11)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack([np.zeros((11, 12)), np.linalg.solve(M, np.hstack([road, load, road_rate]))])
    _, y, _ = lsim((A, B, np.eye(22), np.zeros((22, 12))), np.vstack([inputs, rates]).T, drive.time)
    motion = moved(car, drive, DAMPING, lead=0.0)
    expected = np.vstack([y.T[7:11], car.rows.corners @ y.T[:5]])
    found = np.vstack([car.wheel @ motion.position, car.chassis @ motion.position])
    error = np.abs(found - expected).max(axis=1) / expected.std(axis=1)
    assert error.max() < 2e-3
    travel = car.suspension.ratio[:, :1] * (expected[:4] - expected[4:])
    assert np.abs(car.shock @ motion.position - travel).max() < 2e-3 * travel.std()


def test_its_engine_and_its_chassis_have_modes_near_11_and_23_hz():
    car = straightened(base_car())
    M, _, K, *_ = matrices(car)
    held = K[5:7, 5:7]  # the engine on a shell that does not move
    engine = np.sqrt(eigh(held, M[5:7, 5:7], eigvals_only=True)) / (2 * np.pi)
    assert engine.min() == pytest.approx(11.0, abs=1.5)
    frequencies = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
    assert np.abs(frequencies - 23.0).min() < 3.0


def test_its_curved_parts_have_their_formulas():
    """Travel of the shocks, and tires that stiffen, as functions of the recorded heights; without dry friction."""
    car = base_car().without_friction()
    car = replace(car, tires=replace(car.tires, hysteresis=car.tires.hysteresis.scaled(0.0)))
    drive = drive_of(car, 1.0, road=0.02, load=400.0)
    m = moved(car, drive, DAMPING)
    w = car.wheel @ m.position - car.chassis @ m.position
    r0, r1, r2 = car.suspension.ratio.T[:, :, None]
    assert car.shock @ m.position == pytest.approx(r0 * w + r1 * w**2 / 2 + r2 * w**3 / 6)
    assert error(m.shock_force, DAMPING * (car.shock @ m.velocity)) < 1e-2
    k, q, c, load = (row[:, None] for row in (car.tires.stiffness, car.tires.stiffening, car.tires.damping,
                                              car.tires.static_load))  # fmt: skip
    d = m.drive[:4] - car.wheel @ m.position
    rate = np.gradient(m.drive[:4], m.time, axis=1, edge_order=2) - car.wheel @ m.velocity
    expected = np.maximum(k * d + q * np.maximum(d, -k / (2 * q)) ** 2 + c * rate, -load)
    assert error(m.tire_force[:, 2:-2], expected[:, 2:-2]) < 2e-3
    whole = m.tire_force + load
    assert whole.min() == 0.0  # a tire lifts


@pytest.mark.slow
def test_rms_measures_converge_with_second_order_and_are_accurate_at_the_default_steps():
    car, drive = flexible_truth(2), drive_of(flexible_truth(2), 2.0, road=4e-3, load=400.0)

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
    drive = same_inputs(car, time, 0.0 * time, level)
    travel = car.shock @ moved(car, drive, DAMPING, lead=0.0).position
    early, late = (travel[:, round(a * RATE) : round(b * RATE)].mean(axis=1) for a, b in ((2.0, 4.0), (6.0, 8.0)))
    assert np.abs(late - early).max() < 2e-3 * np.abs(late).min()
    bare = car.without_friction()
    free = bare.shock @ moved(bare, drive, DAMPING, lead=0.0).position
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
