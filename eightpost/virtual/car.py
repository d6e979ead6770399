"""Cars of the virtual rig: masses and the elements between them, and the flexible car with engine and friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.rig.geometry import Geometry
from eightpost.units import convert
from eightpost.virtual.kernel import CarNumbers


class _OnCorners:
    """What all cars share: names of their channels, and changes of friction and tires."""

    __slots__ = ()

    corners: Any
    loads: Any
    tires: Any
    friction: Any

    def named(self, quantity: str) -> tuple[str, ...]:
        """Return `<corner>.<quantity>` for every corner; for a quarter car only the quantity."""
        return tuple(channel(corner, quantity) for corner in self.corners)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of roads and loads, in the order of a drive."""
        return (*self.named("road"), *self.loads)

    def changed(self, friction: float, tire: float) -> Self:
        """Return the car with its friction and the stiffness of its tires multiplied by factors."""
        tires = replace(self.tires, stiffness=self.tires.stiffness * tire)
        return replace(self, friction=self.friction.scaled(friction), tires=tires)  # type: ignore[type-var]

    def without_friction(self) -> Self:
        """Return the same car without friction along its shocks and anti-roll bars."""
        return self.changed(0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Car(_OnCorners):
    """A simulated car with D coordinates q relative to the static position, C corners and A loads."""

    name: str  #: Name of the car.
    corners: tuple[str, ...]  #: C corner names; one empty name for a quarter car.
    mass: Array  #: Masses (D,) [kg] or inertias [kg.m2] of the coordinates.
    shock: Array  #: Matrix (C, D) from q to the compression of the shocks.
    spring: Array  #: Matrix (C, D) from q to the compression of the springs.
    wheel: Array  #: Matrix (C, D) from q to the heights of the wheels at the tires.
    chassis: Array  #: Matrix (C, D) from q to the heights of the chassis above the wheels.
    loads: tuple[str, ...]  #: A load names, as in a drive file.
    load_units: tuple[str, ...]  #: A load units, N or N.m.
    load: Array  #: Matrix (A, D); the generalised force is load^T f.
    stiffness: Array  #: Stiffness K (D, D) of elements other than springs: anti-roll bars, the twist of the chassis.
    damping: Array  #: Damping C (D, D) of elements other than shocks and tires.
    springs: Springs  #: Suspension springs.
    tires: Tires  #: Tires.
    friction: Friction  #: Friction along the shocks.
    points: Mapping[str, Array]  #: Rows (D,) from q to the heights or angles of other measured points, by name.
    geometry: Geometry | None = None  #: Positions of actuators and measurements, None for a quarter car.

    @property
    def static_load(self) -> Array:
        """Static loads of the tires (C, 1) [N]; 0 if their forces are changes from static."""
        return np.where(np.isfinite(self.tires.static_load), self.tires.static_load, 0.0)

    def numbers(self) -> CarNumbers:
        """Return the car as arrays for the compiled integration."""
        springs, tires, friction, corners = self.springs, self.tires, self.friction, len(self.corners)
        none, stribeck = np.zeros((corners, 1)), np.full_like(friction.coulomb, friction.stribeck_velocity)
        return CarNumbers(
            mass=self.mass,
            stiffness=self.stiffness,
            damping=self.damping,
            struts=np.vstack([self.shock, self.spring]).astype(np.float64),
            ratios=np.tile([1.0, 0.0, 0.0], (2 * corners, 1)),
            springs=np.hstack([none, springs.rate, springs.progression, springs.stop_gap, springs.stop_rate]),
            wheels=self.wheel.astype(np.float64),
            tires=np.hstack([tires.stiffness, none, none - np.inf, tires.damping, tires.static_load]),
            hysteresis=np.zeros((0, 3)),
            rubs=self.shock.astype(np.float64),
            friction=np.hstack([friction.coulomb, friction.breakaway, friction.stiffness, stribeck]),
            loads=self.load.astype(np.float64),
        )

    def motion(self, records: Array) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and accelerations (D, N) of records of the compiled integration."""
        q, v, a = np.split(records.T[: 3 * self.mass.size], 3)
        return q, v, a


# ---- Nonlinear elements of the cars ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Springs:
    """Progressive coil springs and bump stops; s is the compression from the static height, positive in bump.

    F = k s (1 + p s) + k_stop max(s - gap, 0)^2
    """

    rate: Array  #: Spring rates k (C, 1) [N/m].
    progression: Array  #: Progression p (C, 1) [1/m]; the rate at s is k (1 + 2 p s).
    stop_gap: Array  #: Gap to the bump stop (C, 1) [m]; infinite without a stop.
    stop_rate: Array  #: Coefficient k_stop of the bump stop (C, 1) [N/m2].

    @classmethod
    def linear(cls, rate: Array) -> Springs:
        """Return linear springs with a rate (C, 1) [N/m] and without stops."""
        zero = np.zeros_like(rate)
        return cls(rate, zero, zero + np.inf, zero)


@dataclass(frozen=True, slots=True, eq=False)
class Tires:
    """Tires that can push but not pull: the total force is max(0, W + k d + c d'), d = road - wheel."""

    stiffness: Array  #: Stiffness k (C, 1) [N/m].
    damping: Array  #: Damping c (C, 1) [N.s/m].
    static_load: Array  #: Static load W (C, 1) [N]; infinite for tires that never lift off.


@dataclass(frozen=True, slots=True, eq=False)
class Friction:
    """Suspension friction with elastic presliding and stick-slip (LuGre bristle model without micro-damping).

        dz/dt = v - |v| z / z_b(v),  F = sigma z,  z_b = (F_c + (F_s - F_c) exp(-(v / v_s)^2)) / sigma

    Below the breakaway force it sticks and acts as a spring of stiffness sigma; above, it slides with the force F_c.
    """

    coulomb: Array  #: Sliding friction F_c (C, 1) [N].
    breakaway: Array  #: Breakaway force F_s (C, 1) [N], at least F_c.
    stiffness: Array  #: Presliding stiffness sigma (C, 1) [N/m].
    stribeck_velocity: float = 0.01  #: Stribeck velocity v_s [m/s].

    def scaled(self, factor: float) -> Friction:
        """Return a friction with forces multiplied by `factor` and the same presliding distance."""
        return replace(
            self,
            coulomb=self.coulomb * factor,
            breakaway=self.breakaway * factor,
            stiffness=self.stiffness * max(factor, 1e-9),
        )

    @classmethod
    def none(cls, corners: int) -> Friction:
        """Return zero friction for `corners` corners."""
        zero = np.zeros((corners, 1))
        return cls(zero, zero, zero + 1e-9)


# ==== Flexible car: engine on mounts, elastic chassis, friction that sticks, tires that stiffen =======================

#: Coordinates in which the rig measures the motion: shock travel, wheel, chassis and aeroloader mount of every corner,
#: then heave, pitch and roll at the centre of gravity and the height at the driver.
MEASURED = 4 * len(CORNERS) + 4

#: Numbers of coordinates: the shell's five, with the engine's two, with the wheels' four.
SHELL, ENGINE, COORDINATES = 5, 7, 11

_GRAVITY = convert(1.0, "g_0", "m/s2")


@dataclass(frozen=True, slots=True, eq=False)
class _Shell:
    """Chassis without engine: three rigid motions and two elastic modes.

    Height at x ahead and y left of the centre of gravity, positive up:

        h = z - x theta + y phi + (1.1 (x / l)^2 - 0.6) b + y (x / l) t

    The modes b (bending) and t (torsion) have no mass coupling with the rigid motions.
    """

    mass: float  #: Mass [kg].
    pitch_inertia: float  #: Moment of inertia of pitch theta, nose down [kg.m2].
    roll_inertia: float  #: Moment of inertia of roll phi, left side up [kg.m2].
    bending: tuple[float, float, float]  #: Modal mass [kg], natural frequency [Hz] and damping ratio [1] of bending.
    #: Modal inertia [kg.m2], natural frequency [Hz] and damping ratio [1] of torsion.
    torsion: tuple[float, float, float]
    length: float  #: Length l of the mode shapes [m].

    def row(self, ahead: float, left: float) -> Array:
        """Return the row (5,) from (z, theta, phi, b, t) to the height at a point."""
        place = ahead / self.length
        return np.array([1.0, -ahead, left, 1.1 * place**2 - 0.6, left * place])


@dataclass(frozen=True, slots=True)
class Engine:
    """Engine and gearbox on a front and a rear mount on the centre line."""

    mass: float  #: Mass [kg].
    pitch_inertia: float  #: Moment of inertia of pitch about its centre of gravity [kg.m2].
    ahead: float  #: Position ahead of the centre of gravity of the shell [m].
    arms: tuple[float, float]  #: Positions of the mounts ahead of the engine's centre of gravity [m].
    stiffness: tuple[float, float]  #: Stiffness of the mounts [N/m].
    damping: tuple[float, float]  #: Damping of the mounts [N.s/m].


@dataclass(frozen=True, slots=True, eq=False)
class Suspension:
    """Coil springs and shocks of the corners; w is the travel of the wheel in bump relative to the chassis.

    s = r0 w + r1 w^2 / 2 + r2 w^3 / 6,  F = (P + k s + k_stop max(s - gap, 0)^2 + F_shock) ds/dw - P r0 + c dw/dt
    """

    ratio: Array  #: Coefficients (4, 3) of the motion ratio: r0 [1], r1 [1/m], r2 [1/m2].
    rate: Array  #: Rates k of the coil springs (4,) [N/m].
    stop_gap: Array  #: Gaps to the bump stops (4,) [m].
    stop_rate: Array  #: Coefficients k_stop of the bump stops (4,) [N/m2].
    damping: Array  #: Damping c of bushings at the wheels (4,) [N.s/m].
    bars: Array  #: Rates of the front and the rear anti-roll bar (2,) [N per m of difference of wheel travel].


@dataclass(frozen=True, slots=True, eq=False)
class _Sliders:
    """Springs in series with dry contacts: they stick exactly up to the breakaway force, then slide."""

    sliding: Array  #: Sliding forces (n,) [N].
    breakaway: Array  #: Breakaway forces (n,) [N], at least the sliding forces.
    stiffness: Array  #: Stiffness while sticking (n,) [N/m].

    def scaled(self, factor: float) -> _Sliders:
        """Return sliders with forces multiplied by `factor` and the same distance before they slide."""
        stiffness = self.stiffness * max(factor, 1e-9)
        return _Sliders(self.sliding * factor, self.breakaway * factor, stiffness)

    def numbers(self) -> Array:
        """Return sliding force, breakaway force and stiffness (n, 3)."""
        return np.column_stack([self.sliding, self.breakaway, self.stiffness])


@dataclass(frozen=True, slots=True, eq=False)
class _CurvedTires:
    """Tires that stiffen with deflection d, lose energy to dry hysteresis, and push but do not pull.

    N = max(0, W + k d + q max(d, -k / 2q)^2 + c d' + hysteresis)
    """

    static_load: Array  #: Static loads W (4,) [N].
    stiffness: Array  #: Stiffness k at the static load (4,) [N/m].
    stiffening: Array  #: Coefficients q (4,) [N/m2].
    damping: Array  #: Damping c (4,) [N.s/m].
    hysteresis: _Sliders  #: Two sliders per tire, eight in all.


@dataclass(frozen=True, slots=True, eq=False)
class _FlexibleCar(_OnCorners):
    """A car whose structure differs from that of the stand-in and of every model that is identified.

    It has eleven coordinates: heave, pitch, roll, bending and torsion of the shell, heave and pitch of the engine, and
    the heights of four independent wheels. The rig measures its motion in `MEASURED` coordinates, to which the rows
    `shock`, `wheel`, `chassis`, `load` and `points` refer.
    """

    name: str  #: Name of the car.
    shell: _Shell  #: Chassis.
    engine: Engine  #: Engine on its mounts.
    wheels: Array  #: Masses of the wheels (4,) [kg].
    suspension: Suspension  #: Springs, motion ratios and anti-roll bars.
    #: Six sliders: one between the wheel and the chassis of each corner, one along each anti-roll bar.
    friction: _Sliders
    tires: _CurvedTires  #: Tires.
    geometry: Geometry  #: Positions of axles, actuators and measurements.
    tracks: tuple[float, float]  #: Distances between the front and between the rear wheels [m].
    driver: tuple[float, float] = (-0.5, 0.4)  #: Position of the driver ahead and left of the centre of gravity [m].
    corners: tuple[str, ...] = field(default=CORNERS)  #: Names of the corners.

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads."""
        return self.named("aero")

    @property
    def load_units(self) -> tuple[str, ...]:
        """Units of the loads."""
        return ("N",) * len(self.corners)

    @property
    def shock(self) -> Array:
        """Rows (4, D) of the travel of the shocks."""
        return np.eye(MEASURED)[0:4]

    @property
    def wheel(self) -> Array:
        """Rows (4, D) of the heights of the wheels."""
        return np.eye(MEASURED)[4:8]

    @property
    def chassis(self) -> Array:
        """Rows (4, D) of the heights of the chassis above the wheels."""
        return np.eye(MEASURED)[8:12]

    @property
    def load(self) -> Array:
        """Rows (4, D) of the travel of the aeroloaders, positive down."""
        return -np.eye(MEASURED)[12:16]

    @property
    def points(self) -> Mapping[str, Array]:
        """Rows (D,) of heave, pitch and roll at the centre of gravity, and of the height at the driver."""
        return dict(zip(("heave", "pitch", "roll", "driver"), np.eye(MEASURED)[16:], strict=True))

    @property
    def static_load(self) -> Array:
        """Static loads of the tires (4, 1) [N]."""
        return self.tires.static_load[:, None]

    @property
    def rows(self) -> _Rows:
        """Rows from the shell's coordinates to its points."""
        g, tracks = self.geometry, self.tracks

        def pairs(front: float, front_track: float, rear: float, rear_track: float) -> Array:
            places = ((front, front_track), (-rear, rear_track))
            return np.stack([self.shell.row(x, 0.5 * side * track) for x, track in places for side in (1.0, -1.0)])

        heave = self.shell.row(0.0, 0.0)
        return _Rows(
            pairs(g.front_axle, tracks[0], g.rear_axle, tracks[1]),
            pairs(g.front_aero, g.front_aero_track, g.rear_aero, g.rear_aero_track),
            np.stack([heave, np.eye(5)[1], np.eye(5)[2], self.shell.row(*self.driver)]),
        )

    def numbers(self) -> CarNumbers:
        """Return the car as arrays for the compiled integration, in (shell, engine, wheels) coordinates."""
        shell, engine, own, tires = self.shell, self.engine, self.suspension, self.tires
        masses = [shell.mass, shell.pitch_inertia, shell.roll_inertia, shell.bending[0], shell.torsion[0]]
        preload = (tires.static_load - _GRAVITY * self.wheels) / own.ratio[:, 0]
        wheels, travel = np.eye(COORDINATES)[ENGINE:], np.eye(COORDINATES)[ENGINE:]
        travel[:, :SHELL] -= self.rows.corners
        twist = travel[[0, 2]] - travel[[1, 3]]
        loads = np.zeros((4, COORDINATES))
        loads[:, :SHELL] = -self.rows.loads
        stiffness, damping = np.zeros((2, COORDINATES, COORDINATES))
        for k, (mass, frequency, ratio) in enumerate((shell.bending, shell.torsion), start=3):
            rate = 2.0 * np.pi * frequency
            stiffness[k, k], damping[k, k] = mass * rate**2, 2.0 * ratio * mass * rate
        for arm, spring, loss in zip(engine.arms, engine.stiffness, engine.damping, strict=True):
            mount = np.array([*-shell.row(engine.ahead + arm, 0.0), 1.0, -arm, 0.0, 0.0, 0.0, 0.0])
            stiffness += spring * np.outer(mount, mount)
            damping += loss * np.outer(mount, mount)
        stiffness += twist.T @ np.diag(own.bars) @ twist
        damping += travel.T @ np.diag(own.damping) @ travel
        return CarNumbers(
            mass=np.array([*masses, engine.mass, engine.pitch_inertia, *self.wheels]),
            stiffness=stiffness,
            damping=damping,
            struts=np.vstack([travel, travel]),
            ratios=np.vstack([own.ratio, own.ratio]),
            springs=np.column_stack([preload, own.rate, np.zeros(4), own.stop_gap, own.stop_rate]),
            wheels=wheels,
            tires=np.column_stack([tires.stiffness, tires.stiffening, -0.5 * tires.stiffness / tires.stiffening,
                                   tires.damping, tires.static_load]),
            hysteresis=tires.hysteresis.numbers(),
            rubs=np.vstack([travel, twist]),
            friction=np.column_stack([self.friction.numbers(), np.zeros(6)]),
            loads=loads,
        )  # fmt: skip

    def motion(self, records: Array) -> tuple[Array, Array, Array]:
        """Return the motion in measured coordinates, its velocity and its acceleration (MEASURED, N)."""
        rows = np.zeros((16, COORDINATES))
        rows[:4, ENGINE:] = np.eye(4)
        rows[4:, :SHELL] = np.vstack(self.rows)
        place, speed, rate = (rows @ part for part in np.split(records.T[: 3 * COORDINATES], 3))
        w, dw, ddw = (x[:4] - x[4:8] for x in (place, speed, rate))
        r0, r1, r2 = self.suspension.ratio.T[:, :, None]
        ratio, bend = r0 + w * (r1 + 0.5 * w * r2), r1 + w * r2
        travel = w * (r0 + w * (r1 / 2.0 + w * r2 / 6.0))
        return (
            np.concatenate([travel, place]),
            np.concatenate([ratio * dw, speed]),
            np.concatenate([ratio * ddw + bend * dw**2, rate]),
        )


class _Rows(NamedTuple):
    """Rows (4, 5) from the shell's coordinates to its heights above the wheels, at the aeroloaders, and to `points`."""

    corners: Array
    loads: Array
    points: Array


#: A car that the virtual rig can test.
AnyCar = Car | _FlexibleCar


# ==== The car, and cars drawn at random around it ====================================================================


class _Spread(NamedTuple):
    """Generator of factors around 1 with a log-normal distribution that is cut at two standard deviations."""

    generator: np.random.Generator | None

    def one(self, deviation: float) -> float:
        """Return a factor."""
        return float(self.many(1, deviation)[0])

    def many(self, count: int, deviation: float) -> Array:
        """Return independent factors (count,)."""
        if self.generator is None:
            return np.ones(count)
        return np.asarray(np.exp(deviation * np.clip(self.generator.standard_normal(count), -2.0, 2.0)))

    def corners(self, deviation: float, between_sides: float = 0.02) -> Array:
        """Return factors (4,): one per axle, times a small difference between the sides."""
        return np.repeat(self.many(2, deviation), 2) * self.many(4, between_sides)


def base_car() -> _FlexibleCar:
    """Return the flexible car with its base parameters; all of them are our own choice."""
    return _car(_Spread(None), "flexible")


def flexible_truth(seed: int) -> _FlexibleCar:
    """Return a car drawn around `base_car`: another seed is another car.

    Masses have standard deviations of 6 to 10 %, springs, bars and tires 8 to 20 %, natural frequencies 6 to 8 %,
    friction 30 %, curvatures of motion ratios and tires 40 %; left and right differ by 2 %, friction by 10 %.

    Args:
        seed: Seed of the random parameters. Seeds 0 to 99 are for tuning, seeds from 1000 are for reports.
    """
    return _car(_Spread(np.random.default_rng([8, seed])), f"flexible:{seed}")


def _car(spread: _Spread, name: str) -> _FlexibleCar:
    axle, geometry, tracks = 0.02, _geometry(spread), (1.62 * spread.one(0.02), 1.58 * spread.one(0.02))
    shell = _shell(spread)
    engine = _engine(spread)
    wheels = np.array([43.0, 43.0, 48.0, 48.0]) * spread.corners(0.08, axle)
    sprung = _corner_loads(shell, engine, geometry) * spread.corners(0.0)
    return _FlexibleCar(
        name=name,
        shell=shell,
        engine=engine,
        wheels=wheels,
        suspension=_suspension(spread),
        friction=_friction(spread),
        tires=_tires(spread, sprung + wheels * _GRAVITY),
        geometry=geometry,
        tracks=tracks,
    )


def _geometry(spread: _Spread) -> Geometry:
    front, rear = 1.38 * spread.one(0.03), 1.36 * spread.one(0.03)
    return Geometry(front, rear, front + 0.30, rear + 0.22, 1.05, 1.05, 0.95, 0.95)


def _shell(spread: _Spread) -> _Shell:
    bending = (480.0 * spread.one(0.1), 23.0 * spread.one(0.06), 0.03 * spread.one(0.2))
    torsion = (260.0 * spread.one(0.1), 17.0 * spread.one(0.08), 0.03 * spread.one(0.2))
    mass = 930.0 * spread.one(0.06)
    return _Shell(mass, 1.45 * mass * spread.one(0.06), 0.44 * mass * spread.one(0.06), bending, torsion, 1.37)


def _engine(spread: _Spread) -> Engine:
    mass = 225.0 * spread.one(0.08)
    natural = 2.0 * np.pi * 11.0 * spread.one(0.06)
    whole, share = mass * natural**2, 0.70 * spread.one(0.04)
    stiffness = (whole * share, whole * (1.0 - share))
    loss = 2.0 * 0.06 * spread.one(0.25) / natural
    damping = (stiffness[0] * loss, stiffness[1] * loss)
    return Engine(mass, 0.12 * mass * spread.one(0.08), 0.95, (0.20, -0.70), stiffness, damping)


def _corner_loads(shell: _Shell, engine: Engine, geometry: Geometry) -> Array:
    """Return the static loads (4,) of the sprung mass [N]."""
    base = geometry.front_axle + geometry.rear_axle
    moment = engine.mass * engine.ahead
    whole = shell.mass + engine.mass
    front = (whole * geometry.rear_axle + moment) / base
    return np.repeat([0.5 * _GRAVITY * front, 0.5 * _GRAVITY * (whole - front)], 2)


def _suspension(spread: _Spread) -> Suspension:
    level = np.array([0.80, 0.80, 0.90, 0.90]) * spread.corners(0.05, 0.01)
    slope = np.array([1.2, 1.2, -0.9, -0.9]) * spread.corners(0.4)
    curve = np.array([8.0, 8.0, 6.0, 6.0]) * spread.corners(0.4)
    wheel_rate = np.array([195e3, 195e3, 125e3, 125e3]) * spread.corners(0.12)
    return Suspension(
        ratio=np.stack([level, slope, curve], axis=1),
        rate=wheel_rate / level**2,
        stop_gap=np.array([0.045, 0.045, 0.055, 0.055]),
        stop_rate=np.full(4, 4e7),
        damping=np.array([60.0, 60.0, 60.0, 60.0]) * spread.corners(0.3),
        bars=np.array([16e3, 6e3]) * spread.many(2, 0.2),
    )


def _friction(spread: _Spread) -> _Sliders:
    sliding = np.concatenate(
        (np.array([48.0, 48.0, 60.0, 60.0]) * spread.corners(0.3, 0.1), np.array([32.0, 20.0]) * spread.many(2, 0.3))
    )
    reach = np.array([3e-5, 3e-5, 4e-5, 4e-5, 6e-5, 6e-5]) * spread.many(6, 0.3)
    return _Sliders(sliding, 1.12 * sliding, sliding / reach)


def _tires(spread: _Spread, static_load: Array) -> _CurvedTires:
    stiffness = np.array([310e3, 310e3, 330e3, 330e3]) * spread.corners(0.08, 0.015)
    share = np.tile([0.03, 0.03], 4) * np.repeat(spread.corners(0.3), 2)
    sliding = np.tile([12.0, 45.0], 4) * np.repeat(spread.corners(0.3), 2)
    return _CurvedTires(
        static_load=static_load,
        stiffness=stiffness,
        stiffening=np.array([3.0, 3.0, 3.0, 3.0]) * stiffness * spread.corners(0.4),
        damping=np.array([250.0, 250.0, 250.0, 250.0]) * spread.corners(0.25),
        hysteresis=_Sliders(sliding, sliding, np.repeat(stiffness, 2) * share),
    )
