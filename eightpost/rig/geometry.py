"""Geometry of an 8-post rig: modes of its four aeroloaders (Eq 6.1 and 6.2) and ride heights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array


@dataclass(frozen=True, slots=True)
class Geometry:
    """Positions of actuators and measurements on a four-wheeled car, relative to its centre of gravity."""

    front_axle: float  #: Distance a forward to the front axle [m].
    rear_axle: float  #: Distance b back to the rear axle [m].
    front_aero: float  #: Distance a' forward to the front aeroloaders [m].
    rear_aero: float  #: Distance b' back to the rear aeroloaders [m].
    front_aero_track: float  #: Distance t_f' between the front aeroloaders [m].
    rear_aero_track: float  #: Distance t_r' between the rear aeroloaders [m].
    front_overhang: float  #: Distance from the front axle to the nose, where the front ride height is measured [m].
    rear_overhang: float  #: Distance from the rear axle to the spoiler, where the rear ride height is measured [m].


# The modes of force have the signs of the modes of displacement: heave up, pitch nose down, roll left side up.
# Aeroloader forces are positive down (docs/reference/ports.md), so downforce is a negative heave force.

MODES = ("heave", "pitch", "roll", "warp")


def displacement_modes(geometry: Geometry) -> Array:
    """Return T_x (4, 4) of Eq 6.1: heave [m], pitch, roll, warp [rad] from the heights of the mounts [m].

    In the dissertation, t_f' and t_r' have no primes in the warp row, but the tracks of the aeroloaders are meant.
    """
    a, b = geometry.front_aero, geometry.rear_aero
    front, rear, length = geometry.front_aero_track, geometry.rear_aero_track, a + b
    return np.array(
        [
            [b / (2 * length), b / (2 * length), a / (2 * length), a / (2 * length)],
            [-1 / (2 * length), -1 / (2 * length), 1 / (2 * length), 1 / (2 * length)],
            [b / (length * front), -b / (length * front), a / (length * rear), -a / (length * rear)],
            [1 / front, -1 / front, -1 / rear, 1 / rear],
        ]
    )


def force_modes(geometry: Geometry) -> Array:
    """Return T_f (4, 4) of Eq 6.2: heave [N], pitch, roll and warp moment [N.m] from upward forces [N]."""
    a, b = geometry.front_aero, geometry.rear_aero
    front, rear = 0.5 * geometry.front_aero_track, 0.5 * geometry.rear_aero_track
    return np.array([[1, 1, 1, 1], [-a, -a, b, b], [front, -front, rear, -rear], [front, -front, -rear, rear]])


def aeroloader_forces(modes: Array, geometry: Geometry) -> Array:
    """Return the aeroloader forces (4, ...) [N, down] for modal forces (4, ...) [N and N.m, up]."""
    return np.asarray(-np.linalg.solve(force_modes(geometry), modes), dtype=np.float64)


def ride_heights(heave: Array, pitch: Array, roads: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return the changes (N,) of the heights of nose and spoiler above the plane through the wheelloaders [m].

    Args:
        heave: Heave of the centre of gravity (N,) [m].
        pitch: Pitch (N,) [rad].
        roads: Roads of lf, rf, lr, rr (4, N) [m].
        geometry: Positions of axles, nose and spoiler.
    """
    front, rear = 0.5 * (roads[0] + roads[1]), 0.5 * (roads[2] + roads[3])
    base = geometry.front_axle + geometry.rear_axle
    fore, aft = geometry.front_overhang / base, geometry.rear_overhang / base
    nose = heave - (geometry.front_axle + geometry.front_overhang) * pitch - (front * (1 + fore) - rear * fore)
    spoiler = heave + (geometry.rear_axle + geometry.rear_overhang) * pitch - (rear * (1 + aft) - front * aft)
    return nose, spoiler
