"""The virtual rig's cars obey mechanics, and the linear ones agree with the models that chapters 4 and 5 print."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline
from scipy.signal import lsim

from eightpost.errors import StepError
from eightpost.rig import configuration, demo_damper, shim_build
from eightpost.rig.post import (
    LinearDamper,
    Run,
    quarter_truth,
    seven_dof_truth,
    simulate,
    simulate_setups,
    stand_in_truth,
)
from eightpost.rig.post.drivefiles import RATE
from eightpost.shock import LAWS
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle.structural import Corners, QuarterCar, SevenDof


def _beside(name):
    """Import a module from this folder, which is not a package."""
    spec = importlib.util.spec_from_file_location(f"eightpost_tests_{name}", Path(__file__).with_name(f"{name}.py"))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


reference = _beside("reference_march")

POUND, INCH = convert(1.0, "lbf", "N"), convert(1.0, "in", "m")
RATE_UNIT, DAMPING_UNIT = convert(1.0, "lbf/in", "N/m"), convert(1.0, "lbf.s/in", "N.s/m")
MASS = convert(1.0, "lbm", "kg")


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
    motion = simulate(car, [Run(drive, (LinearDamper(16.67 * DAMPING_UNIT),))], lead=0.1)[0]
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
    motion = simulate(car, [Run(drive, (LinearDamper(30 * DAMPING_UNIT),) * 4)], lead=0.1)[0]
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
    car = stand_in_truth()
    m = simulate(car, [Run(drive_of(car, 2.0), (LinearDamper(20 * DAMPING_UNIT),) * 4)], lead=0.1)[0]
    shock, wheel, load = car.shock @ m.velocity, car.wheel @ m.velocity, car.load @ m.velocity
    power = (m.tire_force * wheel).sum(axis=0) + (m.drive[4:] * load).sum(axis=0)
    lost = ((m.shock_force + m.friction_force) * shock).sum(axis=0)
    lost += np.einsum("it,ij,jt->t", m.velocity, car.damping, m.velocity)
    stored = 0.5 * (car.mass @ m.velocity**2) + spring_energy(car.springs, car.spring @ m.position).sum(axis=0)
    stored += 0.5 * np.einsum("it,ij,jt->t", m.position, car.stiffness, m.position)
    net = trapezoid(power - lost, m.time)
    turned_over = trapezoid(np.abs(power), m.time)
    assert abs(stored[-1] - stored[0] - net) < 2e-3 * turned_over


def test_friction_holds_the_car_against_a_load_below_it():
    car = stand_in_truth()
    time = np.arange(round(1.5 * RATE)) / RATE
    push = 8.0 * POUND * (0.5 - 0.5 * np.cos(np.pi * np.minimum(time, 1.0)))
    channels = {n: ("m" if n.endswith("road") else "N", 0 * time if n.endswith("road") else push) for n in car.inputs}
    run = Run(TimeSeries.from_channels(time, channels), (LinearDamper(20 * DAMPING_UNIT),) * 4)
    held, free = (simulate(c, [run], lead=0.1)[0] for c in (car, car.without_friction()))
    travel = [np.abs(car.shock @ m.position)[:, -1] for m in (held, free)]
    assert (travel[0] < 0.5 * travel[1]).all()
    assert np.abs(held.friction_force[:, -1]).max() < car.friction.coulomb.min()
    assert np.abs((car.shock @ held.velocity)[:, -50:]).max() < 1e-4


def test_friction_is_elastic_before_sliding_and_never_exceeds_its_breakaway_force():
    friction, step = stand_in_truth().friction, 2e-4
    bend, forces = np.zeros((4, 1)), []
    reach = float((friction.coulomb / friction.stiffness).min())
    for _ in range(2):  # there and back over a tenth of the presliding distance
        for sign in (1.0, -1.0):
            for _ in range(100):
                bend = reference.bend(friction, bend, np.full((4, 1), sign * 0.1 * reach / (100 * step)), step)
    assert (np.abs(friction.stiffness * bend) < 0.03 * friction.coulomb).all()
    for _ in range(2000):
        bend = reference.bend(friction, bend, np.full((4, 1), 1e-3), step)
        forces.append(friction.stiffness * bend)
    assert (np.max(forces, axis=0) <= friction.breakaway).all()
    assert (np.max(forces, axis=0) > friction.coulomb).all()


def test_a_wheel_leaves_the_ground_and_its_tire_does_not_pull():
    car = stand_in_truth()
    time = np.arange(round(1.0 * RATE)) / RATE
    wave = 0.6 * INCH * np.minimum(time, 1.0) * np.sin(2 * np.pi * 14.0 * time)
    channels = {n: ("m", wave) if n.endswith("road") else ("N", 0 * time) for n in car.inputs}
    motion = simulate(car, [Run(TimeSeries.from_channels(time, channels), (LinearDamper(3500.0),) * 4)], lead=0.1)[0]
    whole = motion.tire_force + car.tires.static_load
    assert whole.min() == 0.0
    assert (whole == 0.0).any(axis=1).all()


def test_a_stop_stiffens_the_spring_only_beyond_its_gap():
    springs = stand_in_truth().springs
    inside, beyond = springs.stop_gap - 1e-3, springs.stop_gap + 10e-3
    plain = replace(springs, stop_rate=0.0 * springs.stop_rate)
    assert reference.spring_force(springs, inside) == pytest.approx(reference.spring_force(plain, inside))
    assert (reference.spring_force(springs, beyond) - reference.spring_force(plain, beyond)) == pytest.approx(
        springs.stop_rate * 10e-3**2
    )


def test_the_far_wheel_of_the_solid_axle_moves_a_rear_shock_ten_decibels_less():
    car = stand_in_truth()
    axle, roll = car.shock[2, 6], car.shock[2, 7]
    half = 35 * INCH
    own, far = 0.5 * axle + 0.5 * roll / half, 0.5 * axle - 0.5 * roll / half
    assert 20 * np.log10(far / own) == pytest.approx(-10.0, abs=0.3)
    assert car.shock[0, 5] == 0.0  # independent in front


@pytest.mark.repeated
@pytest.mark.parametrize("kind", ["linear", "demonstration", "physical", "first laws", "last laws"])
def test_the_compiled_integration_takes_the_reference_steps(kind, shocks):
    setups = {
        "linear": [LinearDamper(c * DAMPING_UNIT) for c in (20, 9, 20, 30)],
        "demonstration": [demo_damper(name) for name in "ABCA"],
        "physical": [configuration(1), shim_build("C/B"), configuration(12), configuration(1)],
        "first laws": [shocks[name].law for name in [*LAWS][:4]],
        "last laws": [shocks[name].law for name in [*LAWS][-4:]],
    }
    car = stand_in_truth()
    run = Run(drive_of(car, 0.5, road=0.5 * INCH), tuple(setups[kind]))
    made, wanted = (march(car, [run], lead=0.2)[0] for march in (simulate, reference.reference_motions))
    for name in ("position", "velocity", "acceleration", "shock_force", "friction_force", "tire_force"):
        found, expected = getattr(made, name), getattr(wanted, name)
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max(), name


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
        simulate(car, [Run(drive_of(car, 2.0), (LinearDamper(-1e6),))], lead=0.1)
