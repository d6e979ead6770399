"""Seven-DOF car: heave, roll and pitch of the chassis, and four wheels (dissertation section 5.1).

The coordinates are Z = (z, theta, phi, z_2 of lf, rf, lr, rr). Roll is positive if the left side rises, pitch if the
rear rises.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import ParameterError
from eightpost.vehicle.statespace import Channel, StateSpace
from eightpost.vehicle.structural import (
    Corners,
    Outputs,
    anywhere,
    check_ranges,
    not_negative,
    positive,
    state_matrices,
)

#: Distance from axle to nose and from axle to spoiler [m]. The dissertation does not give them; with 45 in, a car with
#: a wheelbase of 110 in is 200 in long.
DEFAULT_OVERHANG = 45 * 0.0254

INPUTS = (
    *(Channel(f"{corner}.road", "m") for corner in CORNERS),
    Channel("heave_force", "N"),
    Channel("roll_moment", "N.m"),
    Channel("pitch_moment", "N.m"),
    *(Channel(f"{corner}.force", "N") for corner in CORNERS),
)
_ROAD, _EXTERNAL, _FORCE = slice(0, 4), slice(4, 7), slice(7, 11)
_CHASSIS, _WHEELS = slice(0, 3), slice(3, 7)


@dataclass(frozen=True, slots=True)
class SevenDof:
    """Parameters of the seven-DOF car; stiffness and damping are wheel rates."""

    track_width: float = positive("m")  #: Track width t of both axles [m].
    cg_to_front_axle: float = positive("m")  #: Distance a from the centre of gravity to the front axle [m].
    cg_to_rear_axle: float = positive("m")  #: Distance b from the centre of gravity to the rear axle [m].
    sprung_mass: float = positive("kg")  #: Sprung mass M [kg].
    roll_inertia: float = positive("kg.m2")  #: Roll inertia J_theta [kg.m2].
    pitch_inertia: float = positive("kg.m2")  #: Pitch inertia J_phi [kg.m2].
    #: Unsprung mass m_t of each corner [kg].
    unsprung_mass: Corners = positive("kg")  # noqa: RUF009
    #: Spring rate k of each corner [N/m].
    spring_rate: Corners = not_negative("N/m")  # noqa: RUF009
    #: Tire stiffness k_t of each corner [N/m].
    tire_stiffness: Corners = positive("N/m")  # noqa: RUF009
    #: Rate c of the linear damper of each corner [N.s/m]; only `with_damper` uses it.
    damping: Corners = not_negative("N.s/m", default=Corners.same(0.0))  # noqa: RUF009
    #: Roll moment per relative roll angle k_R^F [N.m/rad]; not in Table 5.1.
    front_anti_roll_rate: float = not_negative("N.m/rad", default=0.0)
    #: Roll moment per relative roll angle k_R^R [N.m/rad]; not in Table 5.1.
    rear_anti_roll_rate: float = not_negative("N.m/rad", default=0.0)
    #: Distance l_1 from the front axle to the nose, where the front ride height is defined [m].
    front_overhang: float = anywhere("m", default=DEFAULT_OVERHANG)
    #: Distance l_2 from the rear axle to the spoiler, where the rear ride height is defined [m].
    rear_overhang: float = anywhere("m", default=DEFAULT_OVERHANG)
    #: Distance of the driver's accelerometer ahead of the centre of gravity [m], or None.
    driver_ahead_of_cg: float | None = anywhere("m", default=None)
    #: Distance of the driver's accelerometer left of the centreline [m], or None.
    driver_left_of_centreline: float | None = anywhere("m", default=None)

    def __post_init__(self) -> None:
        """Check the ranges, and that the driver's position is complete."""
        check_ranges(self)
        if (self.driver_ahead_of_cg is None) != (self.driver_left_of_centreline is None):
            raise ParameterError(
                "the driver's position has only one coordinate; give both driver_ahead_of_cg and "
                "driver_left_of_centreline, or neither"
            )

    @property
    def wheelbase(self) -> float:
        """Return the wheelbase l = a + b [m]."""
        return self.cg_to_front_axle + self.cg_to_rear_axle


def coupled(parameters: SevenDof) -> StateSpace:
    """Return the car for coupling to shocks, without its own dampers (Eq 5.19 with C_s = 0)."""
    return _state_space(parameters, Corners.same(0.0), "seven_dof")


def with_damper(parameters: SevenDof) -> StateSpace:
    """Return the car with its linear dampers (Eq 5.19), for frequency responses and modes."""
    return _state_space(parameters, parameters.damping, "seven_dof_with_damper")


def corner_heights(parameters: SevenDof) -> Array:
    """Return T (4, 3) of Eq 5.1: chassis heights at the corners from heave, roll and pitch."""
    half = parameters.track_width / 2.0
    a, b = parameters.cg_to_front_axle, parameters.cg_to_rear_axle
    return np.array([[1.0, half, -a], [1.0, -half, -a], [1.0, half, b], [1.0, -half, b]])


def _state_space(parameters: SevenDof, damping: Corners, name: str) -> StateSpace:
    mass = np.array(
        [parameters.sprung_mass, parameters.roll_inertia, parameters.pitch_inertia, *parameters.unsprung_mass]
    )
    strut = _strut(parameters)
    A, B = state_matrices(mass, _branch(strut, damping), _stiffness(parameters, strut), _load(parameters, strut))
    return _outputs(parameters, Outputs(A, B)).model(INPUTS, name)


def _strut(parameters: SevenDof) -> Array:
    """Return S (4, 7), which gives the compression of the suspension, `z_2 - T Phi = S Z`."""
    return np.hstack([-corner_heights(parameters), np.eye(4)])


def _branch(strut: Array, rate: Corners) -> Array:
    """Return `S^T diag(rate) S`, the terms of Eq 5.18 for springs or dampers between chassis and wheels."""
    return np.asarray(strut.T @ (np.array(rate)[:, None] * strut))


def _stiffness(parameters: SevenDof, strut: Array) -> Array:
    """Return K of Eq 5.18: springs, tires and anti-roll bars."""
    K = _branch(strut, parameters.spring_rate)
    K[_WHEELS, _WHEELS] += np.diag(parameters.tire_stiffness)
    K1 = _anti_roll_forces(parameters)
    return np.asarray(K + np.vstack([-corner_heights(parameters).T @ K1, K1]))


def _anti_roll_forces(parameters: SevenDof) -> Array:
    """Return K_1 (4, 7) of Eq 5.13: suspension forces of the anti-roll bars from Z."""
    t = parameters.track_width
    K1 = np.zeros((4, 7))
    for left, rate in ((0, parameters.front_anti_roll_rate), (2, parameters.rear_anti_roll_rate)):
        right = np.zeros(7)
        right[[1, 3 + left, 4 + left]] = rate / t, -rate / t**2, rate / t**2
        K1[left], K1[left + 1] = -right, right
    return K1


def _load(parameters: SevenDof, strut: Array) -> Array:
    """Return L (7, 11) of Eq 5.17, with the inputs in the order of `INPUTS`."""
    L = np.zeros((7, len(INPUTS)))
    L[_WHEELS, _ROAD] = np.diag(parameters.tire_stiffness)
    L[_CHASSIS, _EXTERNAL] = np.eye(3)
    L[:, _FORCE] = -strut.T
    return L


def _outputs(parameters: SevenDof, outputs: Outputs) -> Outputs:
    """Add the outputs; Eq 5.20 is missing in print, so they are derived from the coordinates."""
    strut, chassis = _strut(parameters), np.hstack([corner_heights(parameters), np.zeros((4, 4))])
    wheels, tire = np.eye(7)[_WHEELS], np.diag(parameters.tire_stiffness)
    road = np.eye(len(INPUTS))[_ROAD]
    outputs.add_velocity(_at_corners("velocity"), "m/s", strut)
    outputs.add_position(_at_corners("displacement"), "m", strut)
    outputs.add_position(_at_corners("tire_force"), "N", -tire @ wheels, tire @ road)
    outputs.add_position(_at_corners("spring_force"), "N", np.diag(parameters.spring_rate) @ strut)
    outputs.add_acceleration(_at_corners("hub_acceleration"), "m/s2", wheels)
    outputs.add_acceleration(_at_corners("chassis_acceleration"), "m/s2", chassis)
    _add_ride_heights(parameters, outputs)
    outputs.add_position(["heave"], "m", np.eye(7)[0:1])
    outputs.add_position(["roll", "pitch"], "rad", np.eye(7)[1:3])
    outputs.add_position(_at_corners("wheel_position"), "m", wheels)
    outputs.add_position(_at_corners("chassis_position"), "m", chassis)
    if parameters.driver_ahead_of_cg is not None and parameters.driver_left_of_centreline is not None:
        seat = _chassis_point(parameters.driver_ahead_of_cg, parameters.driver_left_of_centreline)
        outputs.add_acceleration(["driver.acceleration"], "m/s2", seat)
    return outputs


def _at_corners(quantity: str) -> list[str]:
    return [f"{corner}.{quantity}" for corner in CORNERS]


def _chassis_point(ahead: float, left: float) -> Array:
    """Return the row (1, 7) that gives the height of a point of the chassis: `z + left theta - ahead phi`."""
    return np.array([[1.0, left, -ahead, 0.0, 0.0, 0.0, 0.0]])


def _add_ride_heights(parameters: SevenDof, outputs: Outputs) -> None:
    """Add the heights of nose and spoiler above the plane through the wheelloaders."""
    front, rear = parameters.front_overhang, parameters.rear_overhang
    ends = {
        "front.ride_height": (parameters.cg_to_front_axle + front, -front),
        "rear.ride_height": (-parameters.cg_to_rear_axle - rear, parameters.wheelbase + rear),
    }
    for name, (ahead_of_cg, behind_front_axle) in ends.items():
        share = behind_front_axle / parameters.wheelbase  # weight of the rear road height at this point
        road = np.zeros((1, len(INPUTS)))
        road[0, _ROAD] = Corners.axles((1.0 - share) / 2.0, share / 2.0)
        outputs.add_position([name], "m", _chassis_point(ahead_of_cg, 0.0), -road)
