"""Simulated cars (truths) of the virtual rig: quarter car, seven-DOF car, 8-post stand-in, and flexible car."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import ParameterError
from eightpost.rig.geometry import Geometry
from eightpost.units import convert
from eightpost.virtual.car import Car, Friction, Springs, Tires
from eightpost.virtual.flexible import AnyCar, base_car, flexible_truth

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


# ---- Quarter car and seven-DOF car ----------------------------------------------------------------------------------

_INCH = convert(1.0, "in", "m")
_POUND = convert(1.0, "lbf", "N")
_RATE = convert(1.0, "lbf/in", "N/m")
_DAMPING = convert(1.0, "lbf.s/in", "N.s/m")
_MASS = convert(1.0, "lbm", "kg")


def _column(values: Sequence[float], unit: float = 1.0) -> Array:
    return unit * np.array(values, dtype=np.float64)[:, None]


def quarter_truth() -> Car:
    """Return the quarter car of Table 4.1, linear; q = (chassis, wheel)."""
    one = np.ones((1, 1))
    chassis, wheel = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    return Car(
        name="quarter_car",
        corners=("",),
        mass=np.array([675.0, 75.0]) * _MASS,
        shock=wheel - chassis,
        spring=wheel - chassis,
        wheel=wheel,
        chassis=chassis,
        loads=("aero_force",),
        load_units=("N",),
        load=-chassis,
        stiffness=np.zeros((2, 2)),
        damping=np.zeros((2, 2)),
        springs=Springs.linear(1280.0 * _RATE * one),
        tires=Tires(1300.0 * _RATE * one, 0.0 * one, np.inf * one),
        friction=Friction.none(1),
        points={},
    )


_TRACK, _FRONT, _REAR = 70.0 * _INCH, 60.0 * _INCH, 50.0 * _INCH


def _geometry(front_aero: float, rear_aero: float, front_track: float, rear_track: float) -> Geometry:
    """Return the geometry of the car in Table 5.1 for aeroloader positions [m]; the overhangs are our own choice."""
    overhang = 45.0 * _INCH
    return Geometry(_FRONT, _REAR, front_aero, rear_aero, front_track, rear_track, overhang, overhang)


def seven_dof_truth() -> Car:
    """Return the car of Table 5.1, linear, without anti-roll bars; q = (z, roll, pitch, four wheels)."""
    half = 0.5 * _TRACK
    places = ((half, _FRONT), (-half, _FRONT), (half, -_REAR), (-half, -_REAR))
    chassis = np.array([[1.0, left, -ahead, 0, 0, 0, 0] for left, ahead in places])
    wheel = np.eye(7)[3:]
    return Car(
        name="seven_dof",
        corners=CORNERS,
        mass=np.array([2550.0, 1.5e6 * _INCH**2, 5.5e6 * _INCH**2, 101.0, 101.0, 124.0, 124.0]) * _MASS,
        shock=wheel - chassis,
        spring=wheel - chassis,
        wheel=wheel,
        chassis=chassis,
        loads=("heave_force", "roll_moment", "pitch_moment"),
        load_units=("N", "N.m", "N.m"),
        load=np.eye(7)[:3],
        stiffness=np.zeros((7, 7)),
        damping=np.zeros((7, 7)),
        springs=Springs.linear(_column((1280, 1280, 588, 588), _RATE)),
        tires=Tires(_column((2000,) * 4, _RATE), _column((0,) * 4), _column((np.inf,) * 4)),
        friction=Friction.none(4),
        points=_points(np.eye(7)[0], np.eye(7)[2], lambda _: np.eye(7)[1]),
        geometry=_geometry(_FRONT, _REAR, _TRACK, _TRACK),
    )


#: Coordinates of the stand-in: heave, front roll, rear roll, pitch, left and right front wheel, axle heave, axle roll.
_Z, _ROLL_F, _ROLL_R, _PITCH, _LF, _RF, _AXLE, _AXLE_ROLL = range(8)

#: Half distances on the rear axle [m]: shocks and springs are inboard of the wheels. With r the ratio of the distances,
#: the opposite wheel moves a shock by (1 - r) / (1 + r) as much as its own wheel: 10 dB less at r = 0.52 (6.2).
_REAR_SHOCK, _REAR_SPRING = 0.26 * _TRACK, 0.31 * _TRACK

#: Shock travel per wheel travel at the front (our choice).
_FRONT_RATIO = 0.85

#: Torsional stiffness of the chassis between the axles (our choice; similar to a stock car) [N.m/rad].
_CHASSIS_TWIST = convert(8000.0, "lbf.ft/deg", "N.m/rad")
_TWIST_DAMPING = 0.03

#: Front anti-roll bar, moment per relative roll angle (our choice) [N.m/rad].
_BAR = 4.0e4

#: Sliding friction and breakaway force of rod ends, bushings and spring seats along each shock [N]. The dissertation
#: gives no values, but shows their effects: hysteresis in the spring rating (6.4.4) and third harmonics in tire force
#: and hub acceleration for sines below 6 to 8 Hz (6.4.3). The sliding friction is that of our prototypes and 4 to 6
#: times the friction of a shock's own seals (3.4.3). With 4000 lbf/in, three times the front spring, it starts to slide
#: after 0.004 to 0.005 in. Left and right differ slightly, as on real cars.
_SLIDING = _column((15, 14, 19, 20), _POUND), _column((17, 16, 22, 23), _POUND)


def stand_in_truth() -> Car:
    """Return the 8-post stand-in: the seven-DOF car with additional features of a real car.

    These are a solid rear axle with inboard springs and shocks, two chassis halves that twist against each other, an
    anti-roll bar, progressive springs, bump stops, tire damping, tires that lift off, and stick-slip friction along
    every shock. The loads are the four aeroloaders, positive down.
    """
    hubs, sides = np.stack([_unit(_LF), _unit(_RF)]), (1.0, -1.0)
    chassis = np.stack([_chassis_at(ahead, side * 0.5 * _TRACK) for ahead in (_FRONT, -_REAR) for side in sides])

    def axle(half: float) -> Array:
        return np.stack([_unit(_AXLE) + side * half * _unit(_AXLE_ROLL) for side in sides])

    def inboard(half: float) -> Array:
        return axle(half) - np.stack([_chassis_at(-_REAR, side * half) for side in sides])

    aero = _geometry(70.0 * _INCH, 62.0 * _INCH, 40.0 * _INCH, 40.0 * _INCH)
    stations = ((aero.front_aero, aero.front_aero_track), (-aero.rear_aero, aero.rear_aero_track))
    twist = _unit(_ROLL_F) - _unit(_ROLL_R)
    bar = _unit(_ROLL_F) - (_unit(_LF) - _unit(_RF)) / _TRACK
    mass = [2550.0, 0.5 * 1.5e6 * _INCH**2, 0.5 * 1.5e6 * _INCH**2, 5.5e6 * _INCH**2]
    mass += [101.0, 101.0, 248.0, 248.0 * (0.33 * 70.0 * _INCH) ** 2]
    loss = _TWIST_DAMPING * 2.0 * np.sqrt(_CHASSIS_TWIST * 0.25 * mass[_ROLL_F] * _MASS)
    return Car(
        name="eight_post",
        corners=CORNERS,
        mass=np.array(mass) * _MASS,
        shock=np.vstack([_FRONT_RATIO * (hubs - chassis[:2]), inboard(_REAR_SHOCK)]),
        spring=np.vstack([hubs - chassis[:2], inboard(_REAR_SPRING)]),
        wheel=np.vstack([hubs, axle(0.5 * _TRACK)]),
        chassis=chassis,
        loads=tuple(f"{corner}.aero" for corner in CORNERS),
        load_units=("N",) * 4,
        load=-np.stack([_chassis_at(ahead, side * 0.5 * track) for ahead, track in stations for side in sides]),
        stiffness=np.outer(twist, twist) * _CHASSIS_TWIST + np.outer(bar, bar) * _BAR,
        damping=np.outer(twist, twist) * loss,
        springs=Springs(
            _column((1280, 1280, 700, 700), _RATE),
            _column((0.6, 0.6, 0.8, 0.8)),
            _column((2.2, 2.2, 2.8, 2.8), _INCH),
            _column((6000,) * 4, _RATE / _INCH),
        ),
        tires=Tires(
            _column((2000,) * 4, _RATE), _column((2.5,) * 4, _DAMPING), _column((715.0, 715.0, 785.0, 785.0), _POUND)
        ),
        friction=Friction(*_SLIDING, _column((4000,) * 4, _RATE)),
        points=_points(_unit(_Z), _unit(_PITCH), _roll_at),
        geometry=aero,
    )


def _unit(index: int) -> Array:
    return np.asarray(np.eye(8)[index])


def _roll_at(ahead: float) -> Array:
    """Return the row of the chassis' roll at a distance `ahead` of the centre of gravity [m], linear along the car."""
    share = (ahead + _REAR) / (_FRONT + _REAR)
    return share * _unit(_ROLL_F) + (1.0 - share) * _unit(_ROLL_R)


def _chassis_at(ahead: float, left: float) -> Array:
    return _unit(_Z) - ahead * _unit(_PITCH) + left * _roll_at(ahead)


def _points(heave: Array, pitch: Array, roll_at: Callable[[float], Array]) -> dict[str, Array]:
    """Return the rows for heave, pitch and roll at the centre of gravity, and for the driver 20 in back, 15 in left."""
    back, left = 20.0 * _INCH, 15.0 * _INCH
    return {
        "heave": heave,
        "pitch": pitch,
        "roll": roll_at(0.0),
        "driver": heave + back * pitch + left * roll_at(-back),
    }


#: Functions that create the simulated cars, by their names on the command line and in files.
TRUTHS: dict[str, Callable[[], AnyCar]] = {
    "quarter_car": quarter_truth,
    "seven_dof": seven_dof_truth,
    "eight_post": stand_in_truth,
    "flexible": base_car,
}


def truth_named(name: str, seed: int | None = None) -> AnyCar:
    """Return a simulated car.

    Args:
        name: Name of the car, one of `TRUTHS`.
        seed: Seed of its random parameters; None gives its base parameters. Only the flexible car has them.

    Raises:
        ParameterError: The car has no random parameters.
    """
    if seed is None:
        return TRUTHS[name]()
    if name != "flexible":
        raise ParameterError(f"the {name} has no random parameters; leave out the seed of the car, or use flexible")
    return flexible_truth(seed)
