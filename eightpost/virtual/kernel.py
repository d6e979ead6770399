"""Compiled integration of the virtual rig for one run of one car.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)

The functions work on arrays and numbers only; `simulate.py` fills them from cars and shocks. This is the only module of
the rig that imports numba; `compiled` compiles the functions of other cars.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.shock.compiled import LAW_FILES, law_step
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Counts = NDArray[np.int64]

Function = TypeVar("Function", bound=Callable[..., Any])

#: Types of shocks. The functions below document the contents of their rows of numbers.
LINEAR, LAW, FLUID, PHYSICAL = range(4)

#: Length of a row of numbers, and number of states of a shock.
NUMBERS, STATES = 36, 5

#: The L-stable second-order method ROS2.
_GAMMA = 1.0 + math.sqrt(0.5)

#: Number that changes with the files of the laws and with this file, whose functions other cars compile too.
_FILES = LAW_FILES + BRISTLE_FILE + zlib.crc32(Path(__file__).read_bytes())

#: Number of samples between checks that the motion is finite.
_CHECK_INTERVAL = 500


class CarNumbers(NamedTuple):
    """Arrays of a car with D coordinates, C corners and U inputs."""

    ports: Array  #: Displacements per q (3 C, D), in rows of shocks, wheels, springs.
    push: Array  #: Accelerations per force (D, 3 C + loads).
    stiffness: Array  #: Accelerations per q (D, D).
    damping: Array  #: Accelerations per q' (D, D).
    springs: Array  #: Rate, progression, stop gap and stop rate of the springs (C, 4).
    tires: Array  #: Stiffness, damping and static load of the tires (C, 3).
    friction: Array  #: Sliding friction, breakaway force, stiffness and Stribeck velocity (C, 4).


class ShockNumbers(NamedTuple):
    """Arrays of S different shocks."""

    kinds: Counts  #: Types of the shocks (S,).
    numbers: Array  #: Parameters (S, NUMBERS).
    starts: Array  #: Initial states (S, STATES).
    laws: NDArray[np.void]  #: Laws (S,) as records of `LAW_NUMBERS`; zeros for the other shocks.


class Inputs(NamedTuple):
    """Drive of one run."""

    values: Array  #: Roads and loads (N, U).
    slopes: Array  #: Changes of the values per sample (N, U).
    lead: int  #: Number of samples of the lead-in.
    growth: Array  #: Factor of the drive during the lead-in and its change per sample (lead + N + 1, 2).
    #: Weights (2, S, 4) of value, slope, next value and next slope at each step, for the input and its slope.
    weights: Array
    rate: float  #: Sample rate [Hz].


def compiled(function: Function) -> Function:
    """Compile a function and cache its machine code on disk; sums may be computed in another order."""
    options = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc"}}
    return cast("Function", kept(njit(**options)(function), _FILES))


@compiled
def march(car: CarNumbers, which: Counts, shocks: ShockNumbers, inputs: Inputs, records: Array) -> int:
    """Fill the records (N, 3 D + 3 C) of one run with q, q', q'', shock, friction and tire forces.

    Args:
        car: Arrays of the car.
        which: Indices (C,) of the shocks at the corners.
        shocks: Arrays of the shocks.
        inputs: Drive of the run.
        records: Output array with one row per sample.

    Returns:
        Sample at which the motion is no longer finite, or -lead - 1 if it is always finite.
    """
    corners, dofs = which.size, car.push.shape[0]
    steps, count = inputs.weights.shape[1], inputs.values.shape[1]
    h = 1.0 / (inputs.rate * steps)
    q, v, a, guess = np.zeros(dofs), np.zeros(dofs), np.zeros(dofs), np.zeros(dofs)
    places, speeds = np.zeros(3 * corners), np.zeros(3 * corners)
    before, bend, outputs = np.zeros(corners), np.zeros(corners), np.zeros((3, corners))
    forces = np.zeros(car.push.shape[1])
    states, work = np.empty((corners, STATES)), np.empty((10, 3))
    for c in range(corners):
        states[c] = shocks.starts[which[c]]
    knots, drive, slope = np.empty((4, count)), np.empty(count), np.empty(count)
    for sample in range(-inputs.lead, records.shape[0]):
        if sample >= 0:
            _record(records[sample], q, v, a, outputs)
        if sample % _CHECK_INTERVAL == 0 and not np.isfinite(q).all():
            return sample
        fill_knots(inputs, sample, knots)
        for k in range(steps):
            drive_at(inputs, k, knots, drive, slope)
            for i in range(dofs):
                q[i] += h * (v[i] + 0.5 * h * a[i])
                guess[i] = v[i] + h * a[i]
            _multiply(car.ports, q, places)
            _multiply(car.ports, guess, speeds)
            for c in range(corners):
                s = which[c]
                force = shock_force(
                    shocks.kinds[s], shocks.numbers[s], shocks.laws[s], states[c], before[c], speeds[c], places[c], h,
                    work,
                )  # fmt: skip
                bend[c] = _bend(car.friction[c], bend[c], 0.5 * (before[c] + speeds[c]), h)
                w, p = corners + c, 2 * corners + c
                tire, sticking = car.tires[c], car.friction[c, 2] * bend[c]
                load = max(tire[0] * (drive[c] - places[w]) + tire[1] * (slope[c] - speeds[w]), -tire[2])
                outputs[0, c], outputs[1, c], outputs[2, c] = force, sticking, load
                forces[c], forces[w], forces[p] = force + sticking, load, _spring(car.springs[c], places[p])
            for j in range(corners, count):
                forces[2 * corners + j] = drive[j]
            _accelerate(car, forces, q, guess, v, a, h)
            for c in range(corners):
                before[c] = _dot(car.ports[c], v)
    return -inputs.lead - 1


@compiled
def _record(row: Array, q: Array, v: Array, a: Array, outputs: Array) -> None:
    d, c = q.size, outputs.shape[1]
    row[:d], row[d : 2 * d], row[2 * d : 3 * d] = q, v, a
    for k in range(3):
        row[3 * d + k * c : 3 * d + (k + 1) * c] = outputs[k]


@compiled
def fill_knots(inputs: Inputs, sample: int, knots: Array) -> None:
    """Fill the values and slopes (4, U) at a sample and at the next; outside the drive, its end values are held."""
    last = inputs.values.shape[0] - 1
    for side in range(2):
        target = sample + side
        place = min(max(target, 0), last)
        inside = 1.0 if place == target else 0.0
        factor, rise = inputs.growth[sample + side + inputs.lead]
        for j in range(knots.shape[1]):
            value = inputs.values[place, j]
            knots[2 * side, j] = value * factor
            knots[2 * side + 1, j] = inside * inputs.slopes[place, j] * factor + value * rise


@compiled
def drive_at(inputs: Inputs, step: int, knots: Array, drive: Array, slope: Array) -> None:
    """Fill the drive (U,) and its slope per second (U,) at the end of a step."""
    w, g = inputs.weights[0, step], inputs.weights[1, step]
    for j in range(drive.size):
        drive[j] = w[0] * knots[0, j] + w[1] * knots[1, j] + w[2] * knots[2, j] + w[3] * knots[3, j]
        change = g[0] * knots[0, j] + g[1] * knots[1, j] + g[2] * knots[2, j] + g[3] * knots[3, j]
        slope[j] = change * inputs.rate


@compiled
def _dot(row: Array, x: Array) -> float:
    total = 0.0
    for i in range(x.size):
        total += row[i] * x[i]
    return total


@compiled
def _multiply(matrix: Array, x: Array, out: Array) -> None:
    for k in range(out.size):
        out[k] = _dot(matrix[k], x)


@compiled
def _accelerate(car: CarNumbers, forces: Array, q: Array, guess: Array, v: Array, a: Array, h: float) -> None:
    """Update the accelerations and velocities to the end of the step."""
    for i in range(a.size):
        new = _dot(car.push[i], forces) + _dot(car.stiffness[i], q) + _dot(car.damping[i], guess)
        v[i] += 0.5 * h * (a[i] + new)
        a[i] = new


@compiled
def _spring(spring: Array, s: float) -> float:
    into = max(s - spring[2], 0.0)
    return float(spring[0] * s * (1.0 + spring[1] * s) + spring[3] * into * into)


@compiled
def _bend(friction: Array, before: float, velocity: float, h: float) -> float:
    """Return the bristle deflection of `Friction` [m] after a step at a constant velocity, exactly."""
    if friction[0] <= 0.0:
        return before
    reach, ratio = friction[0] / friction[2], friction[1] / friction[0]
    return float(deflection_after(before, velocity, h, reach, ratio, friction[3]))


@compiled
def shock_force(
    kind: int, n: Array, law: Any, state: Array, before: float, after: float, place: float, h: float, work: Array
) -> float:
    """Return a shock's force [N] after a step h [s], and update its states.

    The port has the velocities `before` and `after` [m/s] at the start and at the end of the step, linear in between,
    and the displacement `place` [m] at its end.
    """
    if kind == LINEAR:
        return float(n[0] * after)
    if kind == FLUID:
        return _fluid(n, state, before, after, place, h)
    if kind == PHYSICAL:
        return _physical(n, state, 0.5 * (before + after), place, h, work)
    states, force = law_step(law, (state[0], state[1]), before, after, place, h)
    state[0], state[1] = states
    return float(force)


@compiled
def _softplus(x: float) -> float:
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


@compiled
def _fluid(n: Array, state: Array, before: float, after: float, place: float, h: float) -> float:
    """Return the force of a demonstration damper.

    n is k0, F1, gas stiffness K, F0, seal friction, its velocity, and five numbers for each of the two sides.
    """
    force = state[0]
    side = n[6:11] if force >= 0.0 else n[11:16]
    size = abs(force)
    root = math.sqrt(side[0] ** 2 + 4.0 * side[1] * size)
    level, closed = (size - side[2]) / side[3], -side[2] / side[3]
    flow = 2.0 * size / (root + side[0]) + side[3] / side[4] * (_softplus(level) - _softplus(closed))
    slope = 1.0 / root + 0.5 * (1.0 + math.tanh(0.5 * level)) / side[4]
    stiffness = n[0] * (1.0 + size / n[1])
    rate = stiffness * (0.5 * (before + after) - (flow if force >= 0.0 else -flow))
    decay = h * stiffness * slope
    state[0] = force - h * rate * math.expm1(-decay) / decay
    return float(state[0] + n[2] * place + n[3] + n[4] * math.tanh(after / n[5]))


@compiled
def _passage(drop: float, p: Array) -> tuple[float, float]:
    """Return flow and slope of a `Passage` (its fields in order) at a pressure drop >= 0 [Pa]."""
    size = drop * drop + p[1] * p[1]
    root = math.sqrt(math.sqrt(size))
    flow, slope = p[0] * drop / root, p[0] * (1.0 - 0.5 * drop * drop / size) / root
    if p[2] == 0.0 or drop == 0.0:
        return flow, slope
    whole = drop >= 2.0 * p[4]
    lift = drop - p[4] if whole else 0.25 * drop * drop / p[4]
    growth = 1.0 if whole else 0.5 * drop / p[4]
    ratio = p[2] * lift / p[3]
    series, rise = 1.0 + ratio * ratio, math.sqrt(drop)
    gap = p[2] / math.sqrt(series)
    return flow + gap * lift * rise, slope + gap * (growth * rise / series + 0.5 * lift / rise)


@compiled
def _valve(drop: float, forward: Array, backward: Array) -> tuple[float, float]:
    flow, slope = _passage(abs(drop), forward if drop >= 0.0 else backward)
    return (flow if drop >= 0.0 else -flow), slope


@compiled
def _filling(n: Array, level: float) -> tuple[float, float, float, float]:
    """Return a chamber's pressure above the vapour pressure, content, softness and d ln(softness) / d level."""
    excess = n[1] * math.exp(level)
    liquid = (1.0 - n[3]) * math.exp((n[1] - excess) * n[4])
    gas = n[3] * math.exp(-level / n[2])
    phi, share = liquid + gas, gas / (liquid + gas)
    softness = excess * (n[5] + liquid * n[4] / phi) + gas / (n[2] * phi)
    lost = excess * n[4]
    fall = share * (1.0 - share) * (lost - 1.0 / n[2])
    change = excess * n[5] + (1.0 - share) * lost + fall * (1.0 / n[2] - lost)
    return excess, math.exp((excess - n[1]) * n[5]) / phi, softness, change / softness


@compiled
def _plant(n: Array, x: float, v: float, y: Array, rates: Array, matrix: Array) -> None:
    """Fill the state derivatives (3,) and the Jacobian (3, 3) of `Plant` at states y (3,)."""
    excess_c, content_c, softness_c, bend_c = _filling(n, y[0])
    excess_r, content_r, softness_r, bend_r = _filling(n, y[1])
    gas = n[10] * y[2] ** -n[11]
    through, ease = _valve(excess_c - excess_r, n[13:18], n[18:23])
    out, ease_out = _valve(n[0] + excess_c - gas, n[23:28], n[28:33])
    room_c, room_r = n[6] * (n[8] - x) * softness_c, n[7] * (n[9] + x) * softness_r
    rates[0] = (n[6] * v - (through + out) / content_c) / room_c
    rates[1] = (through / content_r - n[7] * v) / room_r
    rates[2] = -out * n[12]
    stiff_c, stiff_r, slope = content_c * room_c, content_r * room_r, -n[11] * gas / y[2]
    own_c = (through + out) * softness_c - (ease + ease_out) * excess_c
    own_r = -through * softness_r - ease * excess_r
    matrix[0, 0] = own_c / stiff_c - rates[0] * bend_c
    matrix[0, 1], matrix[0, 2] = ease * excess_r / stiff_c, ease_out * slope / stiff_c
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = ease * excess_c / stiff_r, own_r / stiff_r - rates[1] * bend_r, 0.0
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = -ease_out * excess_c * n[12], 0.0, ease_out * slope * n[12]


@compiled
def _solve(m: Array, b: Array, x: Array) -> None:
    """Solve m x = b (3, 3) with cofactors; m is close to the identity plus a non-negative diagonal."""
    c0 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c1 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c2 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    whole = m[0, 0] * c0 + m[0, 1] * c1 + m[0, 2] * c2
    e0, e1 = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2], m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    f0, f1 = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0], m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    g0, g1 = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1], m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    x[0] = (c0 * b[0] + e0 * b[1] + e1 * b[2]) / whole
    x[1] = (c1 * b[0] + f0 * b[1] + f1 * b[2]) / whole
    x[2] = (c2 * b[0] + g0 * b[1] + g1 * b[2]) / whole


@compiled
def _physical(n: Array, state: Array, velocity: float, place: float, h: float, work: Array) -> float:
    """Return the force of a physical damper.

    The states are two levels, gas volume, seal friction and the displacement of the seals.
    """
    y, rates, first, second, there, matrix = state[:3], work[0], work[1], work[2], work[3], work[4:7]
    _plant(n, place, velocity, y, rates, matrix)
    for i in range(3):
        for j in range(3):
            matrix[i, j] = (1.0 if i == j else 0.0) - h * _GAMMA * matrix[i, j]
    _solve(matrix, rates, first)
    for i in range(3):
        there[i] = y[i] + h * first[i]
    _plant(n, place, velocity, there, rates, work[7:])
    for i in range(3):
        rates[i] -= 2.0 * first[i]
    _solve(matrix, rates, second)
    for i in range(3):
        y[i] += h * (1.5 * first[i] + 0.5 * second[i])
    moved = place - state[4]
    end = math.copysign(n[34], moved)
    state[3] = end + (state[3] - end) * math.exp(-abs(moved) / n[35])
    state[4] = place
    compression, rebound = n[0] + n[1] * math.exp(y[0]), n[0] + n[1] * math.exp(y[1])
    return float(compression * n[6] - rebound * n[7] + n[33] + state[3])
