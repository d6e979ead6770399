"""Flexible car: parameters, and the coordinates in which the rig measures its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel

if TYPE_CHECKING:
    from eightpost.rig.post.car import Geometry

#: Coordinates in which the rig measures the motion: shock travel, wheel, chassis and aeroloader mount of every corner,
#: then heave, pitch and roll at the centre of gravity and the height at the driver.
MEASURED = 4 * len(CORNERS) + 4


@dataclass(frozen=True, slots=True, eq=False)
class Shell:
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
class Sliders:
    """Springs in series with dry contacts: they stick exactly up to the breakaway force, then slide."""

    sliding: Array  #: Sliding forces (n,) [N].
    breakaway: Array  #: Breakaway forces (n,) [N], at least the sliding forces.
    stiffness: Array  #: Stiffness while sticking (n,) [N/m].

    def scaled(self, factor: float) -> Sliders:
        """Return sliders with forces multiplied by `factor` and the same distance before they slide."""
        stiffness = self.stiffness * max(factor, 1e-9)
        return Sliders(self.sliding * factor, self.breakaway * factor, stiffness)


@dataclass(frozen=True, slots=True, eq=False)
class CurvedTires:
    """Tires that stiffen with deflection d, lose energy to dry hysteresis, and push but do not pull.

    N = max(0, W + k d + q max(d, -k / 2q)^2 + c d' + hysteresis)
    """

    static_load: Array  #: Static loads W (4,) [N].
    stiffness: Array  #: Stiffness k at the static load (4,) [N/m].
    stiffening: Array  #: Coefficients q (4,) [N/m2].
    damping: Array  #: Damping c (4,) [N.s/m].
    hysteresis: Sliders  #: Two sliders per tire, eight in all.


@dataclass(frozen=True, slots=True, eq=False)
class FlexibleCar:
    """A car whose structure differs from that of the stand-in and of every model that is identified.

    It has eleven coordinates: heave, pitch, roll, bending and torsion of the shell, heave and pitch of the engine, and
    the heights of four independent wheels. The rig measures its motion in `MEASURED` coordinates, to which the rows
    `shock`, `wheel`, `chassis`, `load` and `points` refer.
    """

    name: str  #: Name of the car.
    shell: Shell  #: Chassis.
    engine: Engine  #: Engine on its mounts.
    wheels: Array  #: Masses of the wheels (4,) [kg].
    suspension: Suspension  #: Springs, motion ratios and anti-roll bars.
    #: Six sliders: one between the wheel and the chassis of each corner, one along each anti-roll bar.
    friction: Sliders
    tires: CurvedTires  #: Tires.
    geometry: Geometry  #: Positions of axles, actuators and measurements.
    tracks: tuple[float, float]  #: Distances between the front and between the rear wheels [m].
    driver: tuple[float, float] = (-0.5, 0.4)  #: Position of the driver ahead and left of the centre of gravity [m].
    corners: tuple[str, ...] = field(default=CORNERS)  #: Names of the corners.

    def named(self, quantity: str) -> tuple[str, ...]:
        """Return `<corner>.<quantity>` for every corner."""
        return tuple(channel(corner, quantity) for corner in self.corners)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads."""
        return self.named("aero")

    @property
    def load_units(self) -> tuple[str, ...]:
        """Units of the loads."""
        return ("N",) * len(self.corners)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of roads and loads, in the order of a drive."""
        return (*self.named("road"), *self.loads)

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

    def changed(self, friction: float, tire: float) -> FlexibleCar:
        """Return the car with its friction and the stiffness of its tires multiplied by factors."""
        tires = replace(self.tires, stiffness=self.tires.stiffness * tire)
        return replace(self, friction=self.friction.scaled(friction), tires=tires)

    def without_friction(self) -> FlexibleCar:
        """Return the same car without friction at its uprights and anti-roll bars."""
        return self.changed(0.0, 1.0)

    @property
    def corner_rows(self) -> Array:
        """Rows (4, 5) from the shell's coordinates to its heights above the wheels."""
        g = self.geometry
        places = ((g.front_axle, self.tracks[0]), (-g.rear_axle, self.tracks[1]))
        return np.stack([self.shell.row(x, 0.5 * side * track) for x, track in places for side in (1.0, -1.0)])

    @property
    def load_rows(self) -> Array:
        """Rows (4, 5) from the shell's coordinates to the heights of the aeroloaders' mounts."""
        g = self.geometry
        places = ((g.front_aero, g.front_aero_track), (-g.rear_aero, g.rear_aero_track))
        return np.stack([self.shell.row(x, 0.5 * side * track) for x, track in places for side in (1.0, -1.0)])

    @property
    def point_rows(self) -> Array:
        """Rows (4, 5) from the shell's coordinates to `points`."""
        heave = self.shell.row(0.0, 0.0)
        return np.stack([heave, np.eye(5)[1], np.eye(5)[2], self.shell.row(*self.driver)])
