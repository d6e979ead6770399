"""Reference solution of a run: each vehicle with its shocks as one set of differential equations.

Vehicles of one system are not connected with each other, so each is solved separately.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numba import njit
from scipy.integrate import RK45

from benchmarks.honesty.cases import LAWS, Case, DrawnBristle, DrawnCar, DrawnShock, vehicle
from eightpost.array_types import Array
from eightpost.vehicle import StateSpace

POLYLINEAR, LPF1, LPNL2 = range(3)

#: Columns of a shock's parameters.
(LAW, RATIO, UP, DOWN, GAS_RATE, GAS, SEAL, SEAL_SPEED, OWN, FULL, NONE, SPEED, WIDTH, FAST_UP, FAST_DOWN, SLOPE_UP,
 SLOPE_DOWN, DRAG, DRAG_SPEED, BRISTLE, REACH, STATIC, STRIBECK, SPRING, INNER) = range(25)  # fmt: skip
_INNER_COUNT, _OUTER_COUNT = 15, 4
OUTER_UP = INNER + _INNER_COUNT
OUTER_DOWN = OUTER_UP + _OUTER_COUNT
COLUMNS = OUTER_DOWN + _OUTER_COUNT

#: Stages of the pair of Dormand and Prince: nodes, weights, and the difference of its two solutions.
_C = np.append(RK45.C, 1.0)
_A = np.vstack([np.pad(RK45.A, ((0, 0), (0, 1))), RK45.B])
_E = RK45.E


@njit(cache=True)
def fitted(p, v):
    """Return the force of the blended polynomials at a damper velocity."""
    share = min(max((abs(v) - p[SPEED]) / p[WIDTH] + 0.5, 0.0), 1.0)
    inner = outer = 0.0
    if share < 1.0:
        s = v / p[SPEED]
        for k in range(_INNER_COUNT - 1, -1, -1):
            inner = inner * s + p[INNER + k]
        inner *= s
    if share > 0.0:
        first = OUTER_UP if v > 0.0 else OUTER_DOWN
        s = (abs(v) - p[SPEED]) / p[SPEED]
        for k in range(_OUTER_COUNT - 1, -1, -1):
            outer = outer * s + p[first + k]
    return (1.0 - share) * inner + share * outer


@njit(cache=True)
def static(p, v):
    """Return F_s [N] at a damper velocity, scales included."""
    if v > p[FAST_UP]:
        force = fitted(p, p[FAST_UP]) + p[SLOPE_UP] * (v - p[FAST_UP])
    elif v < -p[FAST_DOWN]:
        force = fitted(p, -p[FAST_DOWN]) + p[SLOPE_DOWN] * (v + p[FAST_DOWN])
    else:
        force = fitted(p, v)
    return (p[UP] if v > 0.0 else p[DOWN]) * force


@njit(cache=True)
def shock(p, v, x, z):
    """Return the shock's force at the port, and z'."""
    vd = p[RATIO] * v
    fs = static(p, vd)
    law, follows, valves = int(p[LAW]), 0.0, fs
    if law == LPF1:
        valves, follows = z, (fs - z) / p[OWN]
    elif law == LPNL2:
        share = min(max((p[NONE] - abs(fs)) / (p[NONE] - p[FULL]), 0.0), 1.0)
        valves, follows = share * z + (1.0 - share) * fs, (fs - z) / p[OWN]
    drag = p[SEAL] * np.tanh(vd / p[SEAL_SPEED]) if p[SEAL] else 0.0
    force = p[RATIO] * (valves + drag + p[GAS] + p[GAS_RATE] * p[RATIO] * x)
    return force, follows


@njit(cache=True)
def friction(p, v, x, y):
    """Return the force of friction and spring at the port, and y' of a bristle with the deflection y."""
    force, follows = p[SPRING] * x * x, 0.0
    if p[DRAG]:
        force += p[DRAG] * np.tanh(v / p[DRAG_SPEED])
    if p[BRISTLE]:
        share = y / p[REACH]
        force += p[BRISTLE] * share
        follows = v - abs(v) * share / (1.0 + (p[STATIC] - 1.0) * np.exp(-((v / p[STRIBECK]) ** 2)))
    return force, follows


@njit(cache=True)
def port_motion(port, y):
    """Return displacement and velocity at a port."""
    x = v = 0.0
    for j in range(port.size):
        x += port[j] * y[j]
        v += port[j] * y[port.size + j]
    return x, v


@njit(cache=True)
def slopes(y, push, stiffness, ports, mobility, shocks, into):
    """Write y' for y = (q, q', z, deflections) under accelerations `push` (Q,)."""
    count, rows = push.size, shocks.shape[0]
    for i in range(count):
        into[i] = y[count + i]
        total = push[i]
        for j in range(count):
            total += stiffness[i, j] * y[j]
        into[count + i] = total
    for s in range(rows):
        x, v = port_motion(ports[s], y)
        force, follows = shock(shocks[s], v, x, y[2 * count + s])
        drag, bends = friction(shocks[s], v, x, y[2 * count + rows + s])
        force += drag
        into[2 * count + s], into[2 * count + rows + s] = follows, bends
        for i in range(count):
            into[count + i] += mobility[i, s] * force


@njit(cache=True)
def integrate(knots, pushes, stiffness, ports, mobility, shocks, start, sizes, tolerance, most):
    """Return the states (N, n) at the knots (N,) and the number of steps; no step crosses a knot.

    Args:
        knots: Times [s].
        pushes: Accelerations by the drive at these times (N, Q), linear between them.
        stiffness: q'' per q (Q, Q).
        ports: Rows S of the shocks' compression (P, Q).
        mobility: q'' per port force (Q, P).
        shocks: Parameters of the shocks (P, COLUMNS).
        start: State at the first knot (n,).
        sizes: Typical size of each state (n,): a step may have an error of `tolerance` times this.
        tolerance: Relative tolerance [1].
        most: Maximum number of steps; -1 is returned as their number if more are needed.
    """
    n, count = start.size, pushes.shape[1]
    states, y, trial = np.empty((knots.size, n)), start.copy(), np.empty(n)
    k, push = np.empty((7, n)), np.empty(count)
    states[0], step, made = y, 1e-5, 0
    slopes(y, pushes[0], stiffness, ports, mobility, shocks, k[0])
    for m in range(knots.size - 1):
        length, done = knots[m + 1] - knots[m], 0.0
        while done < length:
            last = step >= (length - done) * (1.0 - 1e-9)
            h = length - done if last else step
            for stage in range(1, 7):
                for i in range(n):
                    total = 0.0
                    for j in range(stage):
                        total += _A[stage, j] * k[j, i]
                    trial[i] = y[i] + h * total
                share = min((done + _C[stage] * h) / length, 1.0)
                for i in range(count):
                    push[i] = pushes[m, i] + share * (pushes[m + 1, i] - pushes[m, i])
                slopes(trial, push, stiffness, ports, mobility, shocks, k[stage])
            worst = 0.0
            for i in range(n):
                off = 0.0
                for j in range(7):
                    off += _E[j] * k[j, i]
                worst = max(worst, abs(h * off) / (tolerance * (sizes[i] + abs(y[i]))))
            made += 1
            factor = 5.0 if worst < 1e-4 else 0.9 * worst**-0.2
            if worst <= 1.0:
                y[:], k[0] = trial, k[6]
                done = length if last else done + h
                grown = h * min(5.0, max(0.3, factor))
                step = max(step, grown) if last else grown
            else:
                step = h * min(0.9, max(0.1, factor))
            if made > most or not step > 1e-15:
                return states, -1
        states[m + 1] = y
    return states, made


@njit(cache=True)
def port_forces(states, ports, shocks):
    """Return the forces of the shocks (P, N), and those of friction and springs beside them (P, N)."""
    count, rows = ports.shape[1], shocks.shape[0]
    forces, frictions = np.empty((rows, states.shape[0])), np.zeros((rows, states.shape[0]))
    for s in range(rows):
        for m in range(states.shape[0]):
            x, v = port_motion(ports[s], states[m])
            forces[s, m], _ = shock(shocks[s], v, x, states[m, 2 * count + s])
            frictions[s, m], _ = friction(shocks[s], v, x, states[m, 2 * count + rows + s])
    return forces, frictions


#: Typical sizes of a displacement [m], a velocity [m/s], a lagged force [N] and a bristle's deflection [m].
_SIZES = (1e-3, 1e-1, 1e2, 1e-4)
#: Most steps of the search for the state at rest, and the last relative change.
_MOST_NEWTON_STEPS, _AT_REST = 50, 1e-13
#: Maximum number of integration steps for each vehicle.
_MOST_STEPS = 10_000_000


@dataclass(frozen=True)
class Answer:
    """Solution of a system at `time` (N,) [s]."""

    time: Array  #: Time since the start of the run [s].
    values: Array  #: Channels by time (C, N), SI.
    names: tuple[str, ...]  #: Names of the channels (C,), as in the product.
    units: tuple[str, ...]  #: SI units of the channels (C,).


def solve(case: Case, times: Array, tolerance: float) -> Answer:
    """Return the solution of a case at times (N,) [s] of the run.

    Args:
        case: System and scenario.
        times: Times in order, from 0.
        tolerance: Allowed error of a step, relative to the typical size of each state [1].

    Raises:
        RuntimeError: The integration does not reach the end.
    """
    cars = [_Equations(case, car) for car in case.cars]
    values = np.vstack([car.solve(times, tolerance) for car in cars])
    names, units = (tuple(chain.from_iterable(row)) for row in ((c.names for c in cars), (c.units for c in cars)))
    return Answer(times, values, names, units)


def shock_numbers(shock: DrawnShock, friction: tuple[float, float], bristle: DrawnBristle) -> Array:
    """Return the kernel's parameters of a shock, and of the friction and the spring at its port (COLUMNS,)."""
    port, curve, own = shock.port, shock.curve, shock.own
    return np.array(
        [
            LAWS.index(shock.law),
            *(port.motion_ratio, port.compression_scale, port.rebound_scale),
            *(port.gas_stiffness, port.gas_preload, port.seal_friction, port.friction_velocity),
            *(own.get("time_constant", 0.0), own.get("lag_full_force", 0.0), own.get("lag_zero_force", 1.0)),
            *(curve.transition_speed, curve.transition_width, curve.compression_speed, curve.rebound_speed),
            *(curve.compression_slope, curve.rebound_slope),
            *friction,
            *(bristle.force, bristle.reach, bristle.static_ratio, bristle.stribeck_velocity, bristle.spring),
            *(*curve.inner, *curve.compression, *curve.rebound),
        ]
    )


class _Equations:
    """One vehicle with its shocks, q'' = A_q q + G F + b(t)."""

    def __init__(self, case: Case, car: DrawnCar) -> None:
        self._case, self._car = case, car
        self._model = model = vehicle(car.model).coupled()
        self._ports = tuple(car.shocks)
        count = len(model.A) // 2
        assert not model.A[:count, :count].any() and not model.A[count:, count:].any()
        self._stiffness = np.ascontiguousarray(model.A[count:, :count])
        self._forces = [model.input_names.index(f"{port}.force".lstrip(".")) for port in self._ports]
        self._driven = [k for k in range(len(model.inputs)) if k not in self._forces]
        self._mobility = np.ascontiguousarray(model.B[count:, self._forces])
        rows = [model.output_names.index(f"{port}.displacement".lstrip(".")) for port in self._ports]
        self._strut = np.ascontiguousarray(model.C[rows, :count])
        beside = [(car.friction.get(p, (0.0, 1.0)), car.bristles.get(p, DrawnBristle())) for p in self._ports]
        self._shocks = np.array([shock_numbers(s, *one) for s, one in zip(car.shocks.values(), beside, strict=True)])
        #: Names of the vehicle's outputs, followed by the shocks' forces, and their units.
        self.names = [f"{car.name}.{name}" for name in model.output_names]
        self.names += [f"{car.shock_name(port)}.force" for port in self._ports]
        self.units = [channel.unit for channel in model.outputs] + ["N"] * len(self._ports)

    def solve(self, times: Array, tolerance: float) -> Array:
        """Return the channels at the times (C, N)."""
        scenario = self._case.scenario
        own = scenario.drive.series.time - scenario.drive_start if scenario.drive else np.zeros(0)
        knots = np.union1d(times, own[(own > 0.0) & (own < times[-1])])
        drive = self._inputs(knots)
        count = len(self._stiffness)
        pushes = np.ascontiguousarray((self._model.B[count:, self._driven] @ drive).T)
        start = self._equilibrium(pushes[0])
        sizes = np.repeat(_SIZES, [count, count, len(self._ports), len(self._ports)])
        matrices = (self._stiffness, self._strut, self._mobility, self._shocks)
        states, made = integrate(knots, pushes, *matrices, start, sizes, tolerance, _MOST_STEPS)
        if made < 0 or not np.isfinite(states[-1]).all():
            raise RuntimeError(f"seed {self._case.seed}: {self._car.name} has no solution at tolerance {tolerance:g}")
        at = np.searchsorted(knots, times)
        return self._channels(states[at], drive[:, at])

    def _inputs(self, knots: Array) -> Array:
        """Return the inputs other than shock forces, at the knots (D, N)."""
        scenario, rows = self._case.scenario, []
        for k in self._driven:
            name = f"{self._car.name}.{self._model.input_names[k]}"
            if scenario.drive is None or name not in scenario.drive.names:
                rows.append(np.zeros_like(knots))
                continue
            series = scenario.drive.series
            rows.append(np.interp(knots + scenario.drive_start, series.time, series[name]))
        return np.array(rows)

    def _equilibrium(self, push: Array) -> Array:
        """Return the state at rest under the first inputs, with lagged forces and deflections of bristles 0.

        A_q q + G (r (F_0 + K r S q) + k2 (S q)^2) + b = 0
        """
        columns = (RATIO, GAS_RATE, GAS, SPRING)
        ratio, rate, gas, spring = (self._shocks[:, column] for column in columns)
        matrix = self._stiffness + self._mobility @ ((ratio**2 * rate)[:, None] * self._strut)
        q = np.linalg.solve(matrix, -push - self._mobility @ (ratio * gas))
        for _ in range(_MOST_NEWTON_STEPS if spring.any() else 0):
            x = self._strut @ q
            off = matrix @ q + self._mobility @ (ratio * gas + spring * x**2) + push
            slope = matrix + self._mobility @ ((2.0 * spring * x)[:, None] * self._strut)
            change = np.linalg.solve(slope, -off)
            q = q + change
            if np.abs(change).max() <= _AT_REST * (np.abs(q).max() + 1e-3):
                break
        else:
            if spring.any():
                raise RuntimeError(f"seed {self._case.seed}: {self._car.name} has no state at rest")
        return np.concatenate([q, np.zeros(q.size + 2 * len(self._ports))])

    def _channels(self, states: Array, drive: Array) -> Array:
        """Return the outputs of the vehicle and the forces of the shocks (C, N)."""
        forces, frictions = port_forces(states, self._strut, self._shocks)
        model: StateSpace = self._model
        inputs = np.empty((len(model.inputs), len(states)))
        inputs[self._driven], inputs[self._forces] = drive, forces + frictions
        return np.vstack([model.C @ states[:, : len(model.A)].T + model.D @ inputs, forces])
