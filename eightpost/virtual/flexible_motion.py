"""Motion of the flexible car: the compiled integration of one run, and its arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.units import convert
from eightpost.virtual.kernel import STATES, Inputs, ShockNumbers, compiled, drive_at, fill_knots, shock_force

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.virtual.flexible import FlexibleCar, Sliders

    Counts = NDArray[np.int64]


# ==== Compiled integration ===========================================================================================
#     q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)
#
# Shocks and lead-in are those of `eightpost.virtual.kernel`; the equations of motion are written out here.

#: Numbers of coordinates: the shell's five, the engine's two, the wheels' four.
SHELL, ENGINE, COORDINATES = 5, 7, 11

#: Numbers of forces in a record after the coordinates, velocities and accelerations: shocks, friction, tires.
FORCES = 12

#: Number of samples between checks that the motion is finite.
_CHECK_INTERVAL = 500


class FlexibleNumbers(NamedTuple):
    """Arrays of a flexible car."""

    masses: Array  #: Masses of the coordinates (11,) [kg] or [kg.m2].
    modes: Array  #: Stiffness and damping of bending and torsion (2, 2).
    corners: Array  #: Rows (4, 5) of the shell's heights above the wheels.
    loads: Array  #: Rows (4, 5) of the heights of the aeroloaders' mounts.
    mounts: Array  #: Rows (2, 5) of the shell's heights at the engine mounts.
    engine: Array  #: Arm, stiffness and damping of the engine mounts (2, 3).
    suspension: Array  #: r0, r1, r2, preload, rate, stop gap, stop rate and damping of the corners (4, 8).
    bars: Array  #: Rates of the anti-roll bars (2,).
    friction: Array  #: Sliding force, breakaway force and stiffness of six sliders (6, 3).
    tires: Array  #: Static load, stiffness, stiffening and damping (4, 4).
    hysteresis: Array  #: Sliding force, breakaway force and stiffness of eight sliders (8, 3).


@compiled
def march(car: FlexibleNumbers, which: Counts, shocks: ShockNumbers, inputs: Inputs, records: Array) -> int:
    """Fill the records (N, 45) of one run with q, q', q'', shock, friction and tire forces.

    Args:
        car: Arrays of the car.
        which: Indices (4,) of the shocks at the corners.
        shocks: Arrays of the shocks.
        inputs: Drive of the run.
        records: Output array with one row per sample.

    Returns:
        Sample at which the motion is no longer finite, or -lead - 1 if it is always finite.
    """
    steps, n = inputs.weights.shape[1], COORDINATES
    h = 1.0 / (inputs.rate * steps)
    q, v, a, guess, force = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    outputs, travel, ratios, before = np.zeros((3, 4)), np.zeros(4), np.zeros(4), np.zeros(4)
    rubbing, lost = np.zeros((6, 3)), np.zeros((8, 3))
    states, work = np.empty((4, STATES)), np.empty((10, 3))
    for c in range(4):
        states[c] = shocks.starts[which[c]]
    knots, drive, slope = np.empty((4, 8)), np.empty(8), np.empty(8)
    for sample in range(-inputs.lead, records.shape[0]):
        if sample >= 0:
            row = records[sample]
            row[:n], row[n : 2 * n], row[2 * n : 3 * n] = q, v, a
            for k in range(3):
                row[3 * n + 4 * k : 3 * n + 4 * (k + 1)] = outputs[k]
        if sample % _CHECK_INTERVAL == 0 and not np.isfinite(q).all():
            return sample
        fill_knots(inputs, sample, knots)
        for step in range(steps):
            drive_at(inputs, step, knots, drive, slope)
            for i in range(n):
                q[i] += h * (v[i] + 0.5 * h * a[i])
                guess[i] = v[i] + h * a[i]
                force[i] = 0.0
            _shell_and_engine(car, q, guess, drive, force)
            for c in range(4):
                travel[c] = q[ENGINE + c] - _height(car.corners[c], q)
                speed = guess[ENGINE + c] - _height(car.corners[c], guess)
                own, s = car.suspension[c], travel[c]
                ratio = own[0] + s * (own[1] + 0.5 * s * own[2])
                place = s * (own[0] + s * (own[1] / 2.0 + s * own[2] / 6.0))
                pick = which[c]
                damper = shock_force(
                    shocks.kinds[pick], shocks.numbers[pick], shocks.laws[pick], states[c], before[c],
                    ratio * speed, place, h, work,
                )  # fmt: skip
                ratios[c] = ratio
                into = max(place - own[5], 0.0)
                spring = own[3] + own[4] * place + own[6] * into * into
                stuck = slide(car.friction[c], rubbing[c], s)
                down = (spring + damper) * ratio - own[3] * own[0] + own[7] * speed + stuck
                load = _tire(car, c, drive[c] - q[ENGINE + c], slope[c] - guess[ENGINE + c], lost)
                force[ENGINE + c] += load - down
                _push(car.corners[c], down, force)
                outputs[0, c], outputs[1, c], outputs[2, c] = damper, stuck, load
            for axle in range(2):
                left, right = 2 * axle, 2 * axle + 1
                twist = travel[left] - travel[right]
                pull = car.bars[axle] * twist + slide(car.friction[4 + axle], rubbing[4 + axle], twist)
                force[ENGINE + left] -= pull
                force[ENGINE + right] += pull
                _push(car.corners[left], pull, force)
                _push(car.corners[right], -pull, force)
            for i in range(n):
                new = force[i] / car.masses[i]
                v[i] += 0.5 * h * (a[i] + new)
                a[i] = new
            for c in range(4):
                before[c] = ratios[c] * (v[ENGINE + c] - _height(car.corners[c], v))
    return -inputs.lead - 1


@compiled
def _height(row: Array, q: Array) -> float:
    return float(row[0] * q[0] + row[1] * q[1] + row[2] * q[2] + row[3] * q[3] + row[4] * q[4])


@compiled
def _push(row: Array, force: float, generalised: Array) -> None:
    """Add an upward force at a point of the shell to the generalised forces."""
    for i in range(SHELL):
        generalised[i] += row[i] * force


@compiled
def _shell_and_engine(car: FlexibleNumbers, q: Array, v: Array, drive: Array, force: Array) -> None:
    """Add the forces of the elastic modes, the aeroloaders and the engine mounts."""
    for k in range(2):
        force[3 + k] -= car.modes[k, 0] * q[3 + k] + car.modes[k, 1] * v[3 + k]
    for c in range(4):
        _push(car.loads[c], -drive[4 + c], force)
    for k in range(2):
        arm = car.engine[k, 0]
        stretch = q[5] - arm * q[6] - _height(car.mounts[k], q)
        rate = v[5] - arm * v[6] - _height(car.mounts[k], v)
        pull = car.engine[k, 1] * stretch + car.engine[k, 2] * rate
        force[5] -= pull
        force[6] += arm * pull
        _push(car.mounts[k], pull, force)


@compiled
def slide(slider: Array, state: Array, place: float) -> float:
    """Return the force of a slider at a displacement [N], and update its state: force, displacement, direction.

    It sticks as a spring until its force exceeds the breakaway force, and then slides with the sliding force until the
    direction reverses.
    """
    trial = state[0] + slider[2] * (place - state[1])
    state[1] = place
    direction = 1.0 if trial >= 0.0 else -1.0
    limit = slider[0] if state[2] == direction else slider[1]
    if abs(trial) > limit:
        state[0], state[2] = direction * slider[0], direction
    elif abs(trial) < slider[0]:
        state[0], state[2] = trial, 0.0
    else:
        state[0] = trial
    return float(state[0])


@compiled
def _tire(car: FlexibleNumbers, c: int, deflection: float, rate: float, lost: Array) -> float:
    """Return the change of a tire's force from static [N]."""
    own = car.tires[c]
    bent = max(deflection, -0.5 * own[1] / own[2])
    change = own[1] * bent + own[2] * bent * bent + own[3] * rate
    change += slide(car.hysteresis[2 * c], lost[2 * c], deflection)
    change += slide(car.hysteresis[2 * c + 1], lost[2 * c + 1], deflection)
    return float(max(change, -own[0]))


# ==== Conversion of a car to arrays, and of its records to measured coordinates ======================================

_GRAVITY = convert(1.0, "g_0", "m/s2")


def numbers_of(car: FlexibleCar) -> FlexibleNumbers:
    """Return a car as arrays."""
    shell, engine, own, tires = car.shell, car.engine, car.suspension, car.tires
    masses = [shell.mass, shell.pitch_inertia, shell.roll_inertia, shell.bending[0], shell.torsion[0]]
    preload = (tires.static_load - _GRAVITY * car.wheels) / own.ratio[:, 0]
    modes = [(m * (2.0 * np.pi * f) ** 2, 2.0 * z * m * 2.0 * np.pi * f) for m, f, z in (shell.bending, shell.torsion)]
    return FlexibleNumbers(
        np.array([*masses, engine.mass, engine.pitch_inertia, *car.wheels]),
        np.array(modes),
        car.corner_rows,
        car.load_rows,
        np.stack([shell.row(engine.ahead + arm, 0.0) for arm in engine.arms]),
        np.stack([engine.arms, engine.stiffness, engine.damping], axis=1),
        np.column_stack([own.ratio, preload, own.rate, own.stop_gap, own.stop_rate, own.damping]),
        own.bars,
        _sliders(car.friction),
        np.column_stack([tires.static_load, tires.stiffness, tires.stiffening, tires.damping]),
        _sliders(tires.hysteresis),
    )


def _sliders(sliders: Sliders) -> Array:
    return np.column_stack([sliders.sliding, sliders.breakaway, sliders.stiffness])


def measured(car: FlexibleCar, records: Array) -> tuple[Array, Array, Array]:
    """Return the motion in measured coordinates, its velocity and its acceleration (MEASURED, N).

    Args:
        car: Car that moved.
        records: Records of the compiled integration (N, 45).
    """
    q, v, a = (records[:, k * COORDINATES : (k + 1) * COORDINATES].T for k in range(3))
    rows = np.zeros((16, COORDINATES))
    rows[:4, ENGINE:] = np.eye(4)
    rows[4:8, :SHELL], rows[8:12, :SHELL], rows[12:, :SHELL] = car.corner_rows, car.load_rows, car.point_rows
    place, speed, rate = rows @ q, rows @ v, rows @ a
    w, dw, ddw = (x[:4] - x[4:8] for x in (place, speed, rate))
    r0, r1, r2 = car.suspension.ratio.T[:, :, None]
    ratio, bend = r0 + w * (r1 + 0.5 * w * r2), r1 + w * r2
    travel = w * (r0 + w * (r1 / 2.0 + w * r2 / 6.0))
    return (
        np.concatenate([travel, place]),
        np.concatenate([ratio * dw, speed]),
        np.concatenate([ratio * ddw + bend * dw**2, rate]),
    )
