"""The car of the machine is exact: with dampers, with inputs that act on a port's velocity at once, and at rest."""

import numpy as np
import pytest
from scipy.signal import lsim

from eightpost.machine import (
    SIGNALS,
    Batch,
    Drive,
    LinearCar,
    NotInBatchError,
    Port,
    Run,
    ShockData,
    UnstableCarError,
    Vehicle,
)

#: A mass on a spring: states are travel and velocity, inputs force and road velocity; outputs are the velocity of the
#: port, to which the road's is added, its travel, and the acceleration.
A = np.array([[0.0, 1.0], [-400.0, -1.0]])
B = np.array([[0.0, 1.0], [-0.02, 0.0]])
C = np.array([[0.0, 1.0], [1.0, 0.0], [-400.0, -1.0]])
D = np.array([[0.0, 1.0], [0.0, 0.0], [-0.02, 0.0]])
OFFSET = np.array([0.0, 0.0, 3.0])
PORT = Port(0, 0, 1)
RATE = 300.0
TIME = np.arange(301) / RATE
ROAD = 0.3 * np.sin(2.0 * np.pi * 2.0 * TIME) * TIME
NAMES = ("velocity", "travel", "acceleration")


def line(slope, **port):
    """Return a shock without lag whose force is `slope` times the velocity."""
    speeds = np.linspace(-2.0, 2.0, 25)
    values = {
        "motion_ratio": [1.0], "compression_scale": [1.0], "rebound_scale": [1.0], "friction_velocity": [0.005],
        "curve.transition_speed": [0.1], "curve.transition_width": [0.01], "curve.compression_speed": [2.0],
        "curve.rebound_speed": [2.0], "curve.compression_slope": [slope], "curve.rebound_slope": [slope],
        "curve.knot_velocity": speeds.tolist(), "curve.knot_force": (slope * speeds).tolist(),
        "curve.knot_slope": [slope] * 25,
    } | {name: [value] for name, value in port.items()}  # fmt: skip
    return ShockData.of("polylinear", lambda name, count: values.get(name, [0.0] * count))


def outputs(vehicle, inputs, shocks, *, damping=60.0, port=PORT, every=1):
    """Return the recorded outputs (R, 3, n) of setups with one shock each."""
    car = LinearCar.of(vehicle, [port], np.array([damping]))
    drive = Drive(TIME, every, TIME, inputs)
    run = Run(car, drive, {name: (-1, row) for row, name in enumerate(NAMES)}, series=NAMES)
    found = Batch(run).run([[shock] for shock in shocks])
    assert (found.ended == -1).all()
    assert found.kept(()).values.size == 0  # a result that is kept has no series
    return found.values.copy()


def vehicle(at_rest=False):
    return Vehicle(A, B, C, D, OFFSET, at_rest)


def inputs(load=0.0):
    return np.stack([np.full(TIME.size, load), ROAD], axis=1)


def closed(slope, load=0.0, A=A, C=C):
    """Return the outputs of the mass with a damper F = slope (v + road velocity) of its own."""
    push, direct, road = B[:, :1] * slope, D[:, :1] * slope, np.array([[0.0, 1.0]])
    own = A + push * road, B + push * road, C + direct * road, D + direct * road
    return lsim(own, inputs(load), TIME)[1] + OFFSET


@pytest.mark.parametrize("damping", [60.0, 90.0])
def test_dampers_around_which_the_car_is_solved_are_exact_and_others_nearly(damping):
    found = outputs(vehicle(), inputs(), [line(60.0), line(75.0)], damping=damping)
    for lane, slope in enumerate((60.0, 75.0)):
        right = closed(slope)
        error = np.abs(found[:, :, lane] - right).max(axis=0) / right.std(axis=0)
        assert (error < (1e-8 if slope == damping else 5e-4)).all(), (slope, error)
    assert np.abs(found[:, 0, 0] - closed(75.0)[:, 0]).max() > 3e-3


def test_a_recorded_row_is_every_nth_step():
    shocks = [line(75.0)]
    np.testing.assert_array_equal(
        outputs(vehicle(), inputs(), shocks, every=5), outputs(vehicle(), inputs(), shocks)[::5]
    )


def test_signals_of_a_shock_are_recorded_without_any_output_of_the_car():
    car = LinearCar.of(vehicle(), [PORT], np.array([60.0]))
    signals = {name: (0, number) for number, name in enumerate(SIGNALS)}
    found = []
    for channels in (signals, {"velocity": (-1, 0)} | signals):
        run = Run(car, Drive(TIME, 1, TIME, inputs()), channels, series=tuple(signals))
        found.append(Batch(run).run([[line(75.0)]]).values.copy())
    assert np.abs(found[0]).max() > 1.0
    np.testing.assert_array_equal(*found)


def test_modes_that_fill_up_a_size_decay_and_have_no_effect():
    few, more = (LinearCar.of(vehicle(), [PORT], np.array([0.0]), multiple=n) for n in (1, 8))
    assert few.pairs == 1 and more.pairs == 8 and (more.poles[1:].real < 0.0).all()
    assert not more.into[1:].any() and not more.out[:, 1:].any()
    for found, right in ((more.poles[:1], few.poles), (more.into[:1], few.into), (more.out[:, :1], few.out)):
        np.testing.assert_array_equal(found, right)


def test_a_car_at_rest_begins_under_its_loads_and_the_gas_force():
    load, gas = 200.0, line(60.0, gas_preload=50.0)
    (found,) = outputs(vehicle(at_rest=True), inputs(load), [gas])[:1, :, 0]
    rest = -0.02 * (load + 50.0) / 400.0
    np.testing.assert_allclose(found, [0.0, rest, 3.0], atol=1e-12)


def test_a_force_in_addition_to_the_shock_is_an_input_of_the_car():
    pushed = outputs(vehicle(), inputs(200.0), [line(60.0)])[:, :, 0]
    np.testing.assert_allclose(pushed, closed(60.0, 200.0), atol=1e-8)


def test_shocks_without_gas_spring_need_no_travel():
    none = outputs(vehicle(), inputs(), [line(75.0)], port=Port(0, 0, None))
    np.testing.assert_array_equal(none, outputs(vehicle(), inputs(), [line(75.0)]))


def test_a_port_without_travel_has_hardly_any_gas_spring():
    gas, none = line(60.0, gas_stiffness=900.0), line(60.0)
    found = outputs(vehicle(), inputs(), [gas, none], damping=90.0, port=Port(0, 0, None))
    assert np.abs(found[..., 0] - found[..., 1]).max() < 2e-4
    seen = outputs(vehicle(), inputs(), [gas, none], damping=90.0)
    assert np.abs(seen[..., 0] - seen[..., 1]).max() > 2e-2


def test_dampers_can_be_removed_again():
    there = vehicle().with_dampers([PORT], np.array([60.0]))
    back = there.with_dampers([PORT], np.array([-60.0]))
    assert there.D[2, 1] == pytest.approx(-0.02 * 60.0)  # the road's velocity accelerates the mass through the damper
    for name in ("A", "B", "C", "D"):
        np.testing.assert_allclose(getattr(back, name), getattr(vehicle(), name), atol=1e-12)


def test_a_gas_spring_is_a_spring_of_the_car():
    found = outputs(vehicle(), inputs(), [line(60.0, gas_stiffness=900.0)])[:, :, 0]
    stiff = A + B[:, :1] @ (900.0 * C[1:2])
    mass = closed(60.0, A=stiff, C=C + D[:, :1] @ (900.0 * C[1:2]))
    assert (np.abs(found - mass).max(axis=0) < 1e-4 * mass.std(axis=0)).all()


def test_cars_that_the_machine_cannot_run_are_refused():
    with pytest.raises(UnstableCarError, match="not stable"):
        LinearCar.of(vehicle(), [PORT], np.array([-60.0]))
    at_once = Vehicle(A, B, C, D + np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]), OFFSET, at_rest=False)
    with pytest.raises(NotInBatchError, match="without delay"):
        LinearCar.of(at_once, [PORT], np.array([60.0]))
    with pytest.raises(NotInBatchError, match="the law maxwell"):
        ShockData.of("maxwell", lambda _, count: [0.0] * count)
