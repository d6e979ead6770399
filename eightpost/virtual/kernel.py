"""Compiled integration of the virtual rig for one run of one car.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)

The functions work on arrays and numbers only, which cars and shocks fill (`numbers`). This is the only module of the
package that imports numba.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from scipy.interpolate import CubicSpline

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.errors import ParameterError, StepError
from eightpost.extras import needs
from eightpost.shock.compiled import LAW_FILES, law_step
from eightpost.shock.records import LAW_NUMBERS
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after

with needs("fit", "a virtual rig"):
    from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

    Counts = NDArray[np.int64]

Function = TypeVar("Function", bound=Callable[..., Any])

#: Types of shocks.
LINEAR, LAW, FLUID, PHYSICAL = range(4)

#: Length of a row of numbers, and number of states of a shock.
NUMBERS, STATES = 36, 5

#: The L-stable second-order method ROS2.
_GAMMA = 1.0 + math.sqrt(0.5)

#: Number that changes with the files of the laws and of the bristle.
_FILES = LAW_FILES + BRISTLE_FILE

#: Number of samples between checks that the motion is finite.
_CHECK_INTERVAL = 500

#: Longest step along a motion of the dynamometer [s], and number of samples whose steps are in memory together.
LONGEST_STEP, _BLOCK = 1.25e-5, 5000


class CarNumbers(NamedTuple):
    """A car with D coordinates and C corners as rows (D,), and the elements along them.

    An element with the force f resists the motion of its row r: the generalised force is -f r. A strut has the travel
    s(w) = r0 w + r1 w^2 / 2 + r2 w^3 / 6 over the travel w of its row.
    """

    mass: Array  #: Masses of the coordinates (D,) [kg] or [kg.m2].
    stiffness: Array  #: Stiffness K (D, D).
    damping: Array  #: Damping C (D, D).
    struts: Array  #: Rows (2 C, D) of the shocks and of the springs.
    ratios: Array  #: r0, r1 and r2 of the struts (2 C, 3).
    springs: Array  #: Preload at s = 0, rate, progression, stop gap and stop rate of the springs (C, 5).
    wheels: Array  #: Rows (C, D) of the heights of the wheels.
    tires: Array  #: Stiffness, stiffening, its end, damping and static load of the tires (C, 5).
    hysteresis: Array  #: Sliding force, breakaway force and stiffness of sliders, H / C in each tire (H, 3).
    rubs: Array  #: Rows (F, D) along which there is friction, those of the corners first.
    #: Sliding force, breakaway force, stiffness and Stribeck velocity of the friction (F, 4); velocity 0: a slider.
    friction: Array
    loads: Array  #: Rows (A, D) of the travel of the loads in their own direction.


class ShockRow(NamedTuple):
    """A shock as numbers; the functions below document the order of those of each type."""

    kind: int  #: Type of the shock.
    numbers: Sequence[float] = ()  #: At most NUMBERS parameters.
    start: Sequence[float] = ()  #: At most STATES initial states; the others are 0.


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
    corners, n, rubs = which.size, car.mass.size, car.friction.shape[0]
    steps, count = inputs.weights.shape[1], inputs.values.shape[1]
    h = 1.0 / (inputs.rate * steps)
    q, v, a, guess, force = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    before, ratio, rubbing = np.zeros(corners), np.zeros(corners), np.zeros(rubs)
    stuck, lost, outputs = np.zeros((rubs, 3)), np.zeros((car.hysteresis.shape[0], 3)), np.zeros((3, corners))
    states, work = np.empty((corners, STATES)), np.empty((10, 3))
    for c in range(corners):
        states[c] = shocks.starts[which[c]]
    knots, drive, slope = np.empty((4, count)), np.empty(count), np.empty(count)
    for sample in range(-inputs.lead, records.shape[0]):
        if sample >= 0:
            _record(records[sample], q, v, a, outputs)
        if sample % _CHECK_INTERVAL == 0 and not np.isfinite(q).all():
            return sample
        _fill_knots(inputs, sample, knots)
        for step in range(steps):
            _drive_at(inputs, step, knots, drive, slope)
            for i in range(n):
                q[i] += h * (v[i] + 0.5 * h * a[i])
                guess[i] = v[i] + h * a[i]
            for i in range(n):
                force[i] = -_dot(car.stiffness[i], q) - _dot(car.damping[i], guess)
            for c in range(corners):
                row, s = car.struts[c], which[c]
                place, ratio[c] = _travel(car.ratios[c], _dot(row, q))
                outputs[0, c] = shock_force(
                    shocks.kinds[s], shocks.numbers[s], shocks.laws[s], states[c], before[c],
                    ratio[c] * _dot(row, guess), place, h, work,
                )  # fmt: skip
                _push(row, -ratio[c] * outputs[0, c], force)
            _springs_and_tires(car, q, guess, drive, slope, lost, outputs[2], force)
            _rub(car, q, guess, rubbing, h, stuck, force)
            outputs[1] = stuck[:corners, 0]
            for j in range(corners, count):
                _push(car.loads[j - corners], drive[j], force)
            for i in range(n):
                new = force[i] / car.mass[i]
                v[i] += 0.5 * h * (a[i] + new)
                a[i] = new
            for c in range(corners):
                before[c] = ratio[c] * _dot(car.struts[c], v)
            for j in range(rubs):
                rubbing[j] = _dot(car.rubs[j], v)
    return -inputs.lead - 1


@compiled
def _springs_and_tires(
    car: CarNumbers, q: Array, v: Array, drive: Array, slope: Array, lost: Array, loads: Array, force: Array
) -> None:
    """Add the forces of springs and tires, and fill the changes of the tire forces from static (C,) [N]."""
    corners = loads.size
    for c in range(corners):
        row = car.struts[corners + c]
        _push(row, -_spring(car.springs[c], car.ratios[corners + c], _dot(row, q)), force)
        row = car.wheels[c]
        loads[c] = _tire(car, c, drive[c] - _dot(row, q), slope[c] - _dot(row, v), lost)
        _push(row, loads[c], force)


@compiled
def _rub(car: CarNumbers, q: Array, v: Array, before: Array, h: float, stuck: Array, force: Array) -> None:
    """Add the friction, and update its forces [N] and states (F, 3)."""
    for j in range(stuck.shape[0]):
        row, own = car.rubs[j], car.friction[j]
        if own[3] > 0.0:
            stuck[j, 1] = _bend(own, stuck[j, 1], 0.5 * (before[j] + _dot(row, v)), h)
            stuck[j, 0] = own[2] * stuck[j, 1]
        else:
            slide(own, stuck[j], _dot(row, q))
        _push(row, -stuck[j, 0], force)


@compiled
def _record(row: Array, q: Array, v: Array, a: Array, outputs: Array) -> None:
    d, c = q.size, outputs.shape[1]
    row[:d], row[d : 2 * d], row[2 * d : 3 * d] = q, v, a
    for k in range(3):
        row[3 * d + k * c : 3 * d + (k + 1) * c] = outputs[k]


@compiled
def _march_shock(
    kind: int, numbers: Array, law: Any, places: Array, speeds: Array, h: float, steps: int, states: Array
) -> None:
    """Fill the states (N, STATES) of a shock at every `steps` samples of a motion; the first row is the start."""
    state, work = states[0].copy(), np.empty((10, 3))
    for k in range(1, places.size):
        shock_force(kind, numbers, law, state, speeds[k - 1], speeds[k], places[k], h, work)
        if k % steps == 0:
            states[k // steps] = state


def along(
    row: ShockRow,
    motion: TimeSeries,
    rate: float,
    start: Callable[[float, float], Sequence[float]],
    *,
    longest: float = LONGEST_STEP,
) -> tuple[Array, Array, Array, Array]:
    """Integrate a shock along a displacement command, which is interpolated by a cubic spline.

    Args:
        row: Shock as numbers.
        motion: Evenly sampled series with the channel `displacement` [m].
        rate: Sample rate of the result [Hz].
        start: Initial states at a displacement [m] and a velocity [m/s].
        longest: Longest step of the integration [s].

    Returns:
        Times (N,) [s], displacement [m], velocity [m/s] and states (N, STATES).

    Raises:
        ParameterError: The command is not evenly sampled.
        StepError: A state is no longer finite.
    """
    intervals = np.diff(motion.time)
    if intervals.size < 3 or np.ptp(intervals) > 1e-6 * intervals[0]:
        raise ParameterError("the displacement must have at least 4 evenly spaced samples; resample it first")
    spline, steps = CubicSpline(motion.time, motion["displacement"]), math.ceil(1.0 / (rate * longest))
    time = motion.time[0] + np.arange(int(motion.duration * rate * (1.0 + 1e-12)) + 1) / rate
    places, speeds = spline(time), spline(time, 1)
    numbers, states = np.zeros(NUMBERS), np.zeros((time.size, STATES))
    numbers[: len(row.numbers)] = row.numbers
    first = start(float(places[0]), float(speeds[0]))
    states[0, : len(first)] = first
    for block in range(0, time.size - 1, _BLOCK):
        part = states[block : block + _BLOCK + 1]
        fine = time[block] + np.arange(steps * (len(part) - 1) + 1) / (rate * steps)
        h = 1.0 / (rate * steps)
        _march_shock(row.kind, numbers, np.zeros(1, LAW_NUMBERS)[0], spline(fine), spline(fine, 1), h, steps, part)
    if not np.isfinite(states).all():
        raise StepError("the integration of the damper failed: a state is not finite; check its parts and its motion")
    return time, places, speeds, states


@compiled
def _fill_knots(inputs: Inputs, sample: int, knots: Array) -> None:
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
def _drive_at(inputs: Inputs, step: int, knots: Array, drive: Array, slope: Array) -> None:
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
def _push(row: Array, force: float, generalised: Array) -> None:
    for i in range(row.size):
        generalised[i] += row[i] * force


@compiled
def _travel(r: Array, w: float) -> tuple[float, float]:
    """Return the travel of a strut and its ratio to the travel of its row."""
    return w * (r[0] + w * (r[1] / 2.0 + w * r[2] / 6.0)), r[0] + w * (r[1] + 0.5 * w * r[2])


@compiled
def _spring(spring: Array, r: Array, w: float) -> float:
    """Return the change of a spring's force from static along its row [N]."""
    s, ratio = _travel(r, w)
    into = max(s - spring[3], 0.0)
    pushed = spring[0] + spring[1] * s * (1.0 + spring[2] * s) + spring[4] * into * into
    return float(pushed * ratio - spring[0] * r[0])


@compiled
def _tire(car: CarNumbers, c: int, deflection: float, rate: float, lost: Array) -> float:
    """Return the change of a tire's force from static [N]."""
    own, sliders = car.tires[c], lost.shape[0] // car.tires.shape[0]
    bent = max(deflection, own[2])
    change = own[0] * bent + own[1] * bent * bent + own[3] * rate
    for k in range(sliders * c, sliders * (c + 1)):
        change += slide(car.hysteresis[k], lost[k], deflection)
    return float(max(change, -own[4]))


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
