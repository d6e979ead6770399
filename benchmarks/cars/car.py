"""A true car: its parameters, its static loads, and the arrays of its march."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.cars.march import Numbers
from benchmarks.cars.shocks import TrueShock

Array = NDArray[np.float64]
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
    fuel: tuple[float, float] = (0.0, 0.0)  #: Additional mass in the body, and its place before the centre.

    @property
    def static_loads(self) -> Array:
        """Loads of the tires at rest, without aeroloads and fuel (4,)."""
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
    def loaders(self) -> Array:
        """Heights of the aeroloaders' points per q (4, D)."""
        return np.array([self.height(0.9 * x, 0.8 * y) for x, y in self.places])

    @property
    def frames(self) -> Array:
        """Heights of the body at the front and the rear axle per q (2, D)."""
        return np.array([self.height(x, 0.0) for x in (self.axles[0], -self.axles[1])])

    @property
    def wheels(self) -> Array:
        """Heights of the wheels per q (4, D)."""
        return np.eye(SIZE)[7:]

    def with_fuel(self, mass: float) -> Car:
        """Return the car with fuel just behind its centre."""
        return replace(self, fuel=(mass, -0.3))

    def with_seals(self, friction: float) -> Car:
        """Return the car with dry friction in all of its shocks."""
        bank = tuple(replace(shock, seal=friction) for shock in self.bank)
        return replace(self, bank=bank, alternate=replace(self.alternate, seal=friction))

    def numbers(self) -> Numbers:
        """Return the arrays of the march."""
        mass = np.diag([*self.body, self.bending[0], self.torsion[0], *self.engine[:2], *self.hubs])
        mass += self.fuel[0] * np.outer(*[self.height(self.fuel[1], 0.0)] * 2)
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
            load=self.loaders,
            spring=np.column_stack(
                [self.springs, n, self.rising, self.bumps[0] * four, self.bumps[1] * four, sprung / n]
            ),
            friction=np.column_stack(
                [self.links, self.link_stiffness * four, self.bushes, self.rubber[0] * four, self.rubber[1] * four]
            ),
            mount=np.outer(four, self.mounts),
            tire=np.column_stack([self.tires, self.tire_growth * four, self.tire_damping * four, self.static_loads]),
            bar=np.column_stack([self.bars, self.bar_friction, 2e6 * np.ones(2)]),
            weight=-GRAVITY * self.fuel[0] * self.height(self.fuel[1], 0.0),
        )
