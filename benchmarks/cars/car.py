"""A true car: its parameters, its static loads, and the arrays of its march."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from eightpost.array_types import Array
from eightpost.shock import Lpnl2
from eightpost.shock.curve import KNOTS, StaticCurve

#: Half range [m/s] of the tables of static shock forces, and their spacing [m/s].
FASTEST, SPACING = 4.0, 0.001


class Numbers(NamedTuple):
    """Arrays of a car with D coordinates and four corners."""

    inverse: Array  #: Inverse mass matrix (D, D).
    stiffness: Array  #: Stiffness of the linear elements (D, D).
    damping: Array  #: Damping of the linear elements (D, D).
    travel: Array  #: Bump travel of the wheels per q (4, D).
    wheel: Array  #: Heights of the wheels per q (4, D).
    load: Array  #: Heights of the aeroloaders' points per q (4, D).
    #: Spring rate, motion ratio and its slope, bump gap and rate, preload (4, 6).
    spring: Array
    #: Link friction and its stiffness; friction in series with rubber, its stiffness and damping (4, 5).
    friction: Array
    mount: Array  #: Stiffness and damping of the top mounts (4, 2); stiffness 0 is a rigid mount.
    tire: Array  #: Stiffness at static load, its growth with load [1/m], damping, static load (4, 4).
    bar: Array  #: Rate, friction, and its stiffness of the front and rear anti-roll bars (2, 3).


class Shocks(NamedTuple):
    """Arrays of the shocks at the four corners."""

    table: Array  #: Static force at velocities from -FASTEST to FASTEST (4, K).
    #: Shares of the static force before and of its rise that the lagged force follows in a step; forces from which the
    #: lag fades and without lag (4, 4).
    law: Array


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def static_force(table: Any, v: float) -> float:
    """Return the force of a table at a velocity; it continues with the slopes at its ends."""
    place = (v + FASTEST) / SPACING
    k = min(max(int(place), 0), table.size - 2)
    return float(table[k] + (place - k) * (table[k + 1] - table[k]))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def contact(force: float, limit: float, change: float) -> float:
    """Return the force of a spring in series with a dry contact after a change of the spring's force."""
    return float(min(max(force + change, -limit), limit))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def rubber(bend: float, limit: float, k: float, c: float, moved: float, rate: float, h: float) -> Any:
    """Return the bend of rubber in series with a dry contact after a step, and its force."""
    force = k * (bend + moved) + c * rate
    if abs(force) <= limit:
        return bend + moved, force
    force = math.copysign(limit, force)
    return (force + c * bend / h) / (k + c / h), force


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def shock_force(table: Any, law: Any, state: Any, v: float, h: float) -> Any:
    """Return the force of a shock at the velocity v at the end of a step, and its state there.

    The state is: velocity, travel, lagged force, static force.
    """
    static = static_force(table, v)
    lagged = state[2] + (state[3] - state[2]) * law[0] + (static - state[3]) * law[1]
    share = min(max((law[3] - abs(static)) / (law[3] - law[2]), 0.0), 1.0)
    moved = 0.5 * h * (state[0] + v)
    return share * lagged + (1.0 - share) * static, (v, state[1] + moved, lagged, static)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def behind_mount(table: Any, law: Any, state: Any, mount: Any, s: float, sv: float, h: float) -> Any:
    """Return force and state of a shock in series with its mount; s and sv are the travel of both and its rate."""
    if mount[0] == 0.0:
        return shock_force(table, law, state, sv, h)
    v = state[0]
    for _ in range(30):
        force, after = shock_force(table, law, state, v, h)
        error = force - mount[0] * (s - after[1]) - mount[1] * (sv - v)
        beside, _ = shock_force(table, law, state, v + 1e-5, h)
        change = error / ((beside - force) / 1e-5 + 0.5 * h * mount[0] + mount[1])
        v -= change
        if abs(change) < 1e-9:
            break
    return shock_force(table, law, state, v, h)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def march(car: Any, shocks: Any, drive: Any, h: float, every: int) -> Any:  # noqa: PLR0912, PLR0915 (one loop)
    """Return the channels at every `every`th step (44, N), from rest at the static position.

    Args:
        car: `Numbers`.
        shocks: `Shocks`.
        drive: Roads (4) and aeroloads down (4) at every step (8, steps).
        h: Step [s].
        every: Steps per sample.

    Channels, four of each: change of the tire force from rest, shock force, travel and velocity of the shock, travel
    and velocity of shock and mount together, and hub acceleration; then the accelerations of all D coordinates, and the
    coordinates.
    """
    inverse, stiffness, damping, travel, wheel, load, spring, friction, mount, tire, bar = car
    D, steps = inverse.shape[0], drive.shape[1]
    q, p, a, push = np.zeros(D), np.zeros(D), np.zeros(D), np.zeros(D)
    states, dry = np.zeros((4, 4)), np.zeros((4, 2))
    twist, w, wv = np.zeros(2), np.zeros(4), np.zeros(4)
    before, moved, now = np.zeros(4), np.zeros(4), np.zeros(28)
    out = np.zeros((28 + 2 * D, (steps + every - 1) // every))
    for i in range(steps):
        if i:
            for k in range(D):
                q[k] += h * p[k] + 0.5 * h * h * a[k]
                p[k] += h * a[k]  # predicted
        for k in range(D):
            push[k] = 0.0
            for j in range(D):
                push[k] -= stiffness[k, j] * q[j] + damping[k, j] * p[j]
        for c in range(4):
            w[c], wv[c], height, rate = 0.0, 0.0, 0.0, 0.0
            for k in range(D):
                w[c] += travel[c, k] * q[k]
                wv[c] += travel[c, k] * p[k]
                height += wheel[c, k] * q[k]
                rate += wheel[c, k] * p[k]
            moved[c] = w[c] - before[c]
            before[c] = w[c]
            k0, growth, ct, rest = tire[c]
            road = drive[c, i]
            last, following = drive[c, max(i - 1, 0)], drive[c, min(i + 1, steps - 1)]
            squeeze = road - height
            force = rest + k0 * (math.expm1(growth * squeeze) / growth if growth else squeeze)
            if force > 0.0:
                force = max(force + ct * ((following - last) / (2.0 * h) - rate), 0.0)
            now[c] = max(force, 0.0) - rest
            for k in range(D):
                push[k] += wheel[c, k] * now[c] - load[c, k] * drive[4 + c, i]
        for c in range(4):
            rate, n0, slope, gap, bump, preload = spring[c]
            n = n0 + slope * w[c]
            s = n0 * w[c] + 0.5 * slope * w[c] * w[c]
            table, law = shocks[0][c], shocks[1][c]
            damper, after = behind_mount(table, law, states[c], mount[c], s, n * wv[c], h)
            for k in range(4):
                states[c, k] = after[k]
            stop = bump * (s - gap) ** 2 if s > gap else 0.0
            force = n * (damper + preload + rate * s + stop) - n0 * preload
            dry[c, 0] = contact(dry[c, 0], friction[c, 0], friction[c, 1] * moved[c])
            dry[c, 1], behind = rubber(dry[c, 1], friction[c, 2], friction[c, 3], friction[c, 4], moved[c], wv[c], h)
            force += dry[c, 0] + behind
            axle = c // 2
            other = c + 1 - 2 * (c % 2)
            force += bar[axle, 0] * (w[c] - w[other])
            if c % 2 == 0:
                twist[axle] = contact(twist[axle], bar[axle, 1], bar[axle, 2] * (moved[c] - moved[other]))
            force += twist[axle] * (1 - 2 * (c % 2))
            now[4 + c] = damper
            now[8 + c], now[12 + c] = after[1], after[0]
            now[16 + c], now[20 + c] = s, n * wv[c]
            for k in range(D):
                push[k] -= travel[c, k] * force
        for k in range(D):
            last = a[k]
            a[k] = 0.0
            for j in range(D):
                a[k] += inverse[k, j] * push[j]
            if i:
                p[k] += 0.5 * h * (a[k] - last)
        if i % every == 0:
            for c in range(4):
                now[24 + c] = 0.0
                for k in range(D):
                    now[24 + c] += wheel[c, k] * a[k]
            for k in range(28):
                out[k, i // every] = now[k]
            for k in range(D):
                out[28 + k, i // every] = a[k]
                out[28 + D + k, i // every] = q[k]
    return out


#: Damping at rest and at speed [N.s/m], speed of the knee [m/s], of one stroke.
Side = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class TrueShock:
    """Digressive shock with a lag that fades."""

    name: str
    compression: Side
    rebound: Side
    lag: float = 1e-3  #: Time constant [s].
    fades: tuple[float, float] = (1500.0, 3500.0)  #: Static forces from which the lag fades, and without lag [N].

    def static(self, v: Array) -> tuple[Array, Array]:
        """Return the static force and its slope at velocities."""
        low, high, knee = (np.where(v > 0.0, c, r) for c, r in zip(self.compression, self.rebound, strict=True))
        return high * v + (low - high) * knee * np.tanh(v / knee), high + (low - high) / np.cosh(v / knee) ** 2

    @property
    def law(self) -> Lpnl2:
        """The same law."""
        side = np.concatenate([np.geomspace(0.01, 1.0, KNOTS // 2 - 1), [FASTEST]])
        v = np.concatenate([-side[::-1], [0.0], side])
        force, slope = self.static(v)
        slope[KNOTS // 2] = 0.5 * (self.compression[0] + self.rebound[0])
        curve = StaticCurve.through_knots(tuple(v.tolist()), tuple(force.tolist()), tuple(slope.tolist()))
        return Lpnl2(curve, self.lag, *self.fades)

    def numbers(self, h: float) -> tuple[Array, Array]:
        """Return the table of the static force of `law`, and the other numbers, for a march with steps of h [s]."""
        ratio = h / self.lag
        rise = -math.expm1(-ratio)
        curve = self.law.curve
        return _table(curve), np.array([rise, 1.0 - rise / ratio, *self.fades])

    def scaled(self, factor: float, name: str) -> TrueShock:
        """Return the shock with all damping times a factor."""
        sides = times(self.compression, factor), times(self.rebound, factor)
        return replace(self, name=name, compression=sides[0], rebound=sides[1])


def times(side: Side, factor: float) -> Side:
    """Return the numbers of a stroke with its damping times a factor."""
    return factor * side[0], factor * side[1], side[2]


@cache
def _table(curve: StaticCurve) -> Array:
    return np.array([curve.force(float(v)) for v in np.arange(-FASTEST, FASTEST + 0.5 * SPACING, SPACING)])


def marched(shocks: tuple[TrueShock, ...], h: float) -> Shocks:
    """Return the arrays of the shocks at the four corners."""
    numbers = {shock: shock.numbers(h) for shock in set(shocks)}
    return Shocks(np.array([numbers[s][0] for s in shocks]), np.array([numbers[s][1] for s in shocks]))


Four = tuple[float, float, float, float]

CORNERS = ("lf", "rf", "lr", "rr")
#: Coordinates: heave, pitch (nose down), roll (left up) of the body, its bending and torsion, heave and pitch of the
#: engine, heights of the wheels.
SIZE = 11
GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class Sensors:
    """Errors of the sensors."""

    noise: float = 0.01  #: White noise relative to the RMS [1].
    delays: dict[str, float] = field(default_factory=dict)  #: Delay by quantity [s].
    gain: float = 0.0  #: Largest error of a gain [1].
    seed: int = 0  #: Seed of the gains.
    units: str = "metric"  #: "metric" (kN, mm, g, .mat) or "us" (lbf, in, g, .csv).
    pot: str = "shock"  #: What potentiometers span: "shock", or "whole" with its mount.


@dataclass(frozen=True, slots=True)
class Car:
    """Parameters in SI; corners are lf, rf, lr, rr, axles front and rear."""

    name: str
    kind: str
    body: tuple[float, float, float]  #: Mass, pitch and roll inertia without engine and wheels.
    #: Mass, pitch inertia, place before the body's centre, half distance of the mounts, their stiffness and damping.
    engine: tuple[float, float, float, float, float, float]
    axles: tuple[float, float]  #: Distances of the axles before and behind the body's centre.
    track: tuple[float, float]  #: Half track at the axles.
    hubs: Four  #: Masses of the wheels.
    bending: tuple[float, float, float]  #: Modal mass, frequency [Hz] and damping ratio, for 1 at the axles.
    torsion: tuple[float, float, float]  #: Modal inertia, frequency [Hz] and damping ratio, for 1 rad at the axles.
    springs: Four  #: Rates at the springs.
    ratio: Four  #: Motion ratio, spring and shock per wheel, at rest.
    rising: Four  #: Its slope [1/m].
    bumps: tuple[float, float]  #: Gap [m] and progressive rate [N/m2] of the bump rubbers.
    links: Four  #: Friction in the links, at the wheels [N].
    link_stiffness: float  #: Stiffness before it slides [N/m].
    bushes: Four  #: Friction in series with rubber, at the wheels [N].
    rubber: tuple[float, float]  #: Stiffness and damping of that rubber.
    mounts: tuple[float, float]  #: Stiffness and damping of the shocks' top mounts; stiffness 0: rigid.
    tires: Four  #: Stiffness at the static load.
    tire_growth: float  #: Relative growth of the stiffness with deflection [1/m].
    tire_damping: float
    bars: tuple[float, float]  #: Rates of the anti-roll bars at the wheels.
    bar_friction: tuple[float, float]
    downforce: tuple[float, float]  #: Mean aeroload on each front and rear aeroloader.
    bank: tuple[TrueShock, ...]  #: Shocks that setups choose from.
    baseline: int  #: Index of the shock of the baseline test.
    alternate: TrueShock  #: Shock of one corner in the other tests.
    sensors: Sensors = field(default_factory=Sensors)

    @property
    def static_loads(self) -> Array:
        """Loads of the tires at rest, without aeroloads (4,)."""
        front, rear = self.axles
        masses = np.array([self.body[0], self.engine[0]])
        share = (rear + np.array([0.0, self.engine[2]])) / (front + rear)
        on = np.array([masses @ share, masses @ (1.0 - share)])
        return np.asarray(GRAVITY * (0.5 * np.repeat(on, 2) + np.array(self.hubs)))

    @property
    def places(self) -> Array:
        """Places of the wheels before the body's centre and to its left (4, 2)."""
        front, rear = self.axles
        return np.array([[x, s * t] for x, t in zip((front, -rear), self.track, strict=True) for s in (1.0, -1.0)])

    def height(self, x: float, y: float) -> Array:
        """Return the height of a point of the body per q (D,)."""
        span = 0.5 * (sum(self.axles))
        along = (x - 0.5 * (self.axles[0] - self.axles[1])) / span
        return np.array([1.0, -x, y, 1.6 * along**2 - 0.6, y * along, *[0.0] * 6])

    def points(self, inside: float) -> Array:
        """Return the heights of the body above the wheels, at a share of the half track, per q (4, D)."""
        return np.array([self.height(x, inside * y) for x, y in self.places])

    @property
    def wheels(self) -> Array:
        """Heights of the wheels per q (4, D)."""
        return np.eye(SIZE)[7:]

    def numbers(self) -> Numbers:
        """Return the arrays of the march."""
        mass = np.diag([*self.body, self.bending[0], self.torsion[0], *self.engine[:2], *self.hubs])
        stiffness, damping = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
        for k, (inertia, frequency, ratio) in ((3, self.bending), (4, self.torsion)):
            w = 2.0 * np.pi * frequency
            stiffness[k, k], damping[k, k] = inertia * w**2, 2.0 * ratio * inertia * w
        _, _, before, half, k_mount, c_mount = self.engine
        for arm in (half, -half):
            row = -self.height(before + arm, 0.0)
            row[5:7] = 1.0, -arm
            stiffness += k_mount * np.outer(row, row)
            damping += c_mount * np.outer(row, row)
        n, sprung = np.array(self.ratio), self.static_loads - GRAVITY * np.array(self.hubs)
        four = np.ones(4)
        return Numbers(
            inverse=np.linalg.inv(mass),
            stiffness=stiffness,
            damping=damping,
            travel=self.wheels - self.points(1.0),
            wheel=self.wheels,
            load=np.array([self.height(0.9 * x, 0.8 * y) for x, y in self.places]),
            spring=np.column_stack(
                [self.springs, n, self.rising, self.bumps[0] * four, self.bumps[1] * four, sprung / n]
            ),
            friction=np.column_stack(
                [self.links, self.link_stiffness * four, self.bushes, self.rubber[0] * four, self.rubber[1] * four]
            ),
            mount=np.outer(four, self.mounts),
            tire=np.column_stack([self.tires, self.tire_growth * four, self.tire_damping * four, self.static_loads]),
            bar=np.column_stack([self.bars, self.bar_friction, 2e6 * np.ones(2)]),
        )
