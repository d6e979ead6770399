"""The modes of aeroloaders are those of a rigid car, and their forces do the work of their modes."""

import numpy as np
import pytest

from eightpost.rig.geometry import Geometry, aeroloader_forces, displacement_modes, force_modes

CAR = Geometry(
    front_axle=1.4, rear_axle=1.3, front_aero=1.7, rear_aero=1.1, front_aero_track=0.9, rear_aero_track=1.2,
    front_overhang=0.8, rear_overhang=1.0,
)  # fmt: skip


def heights(heave: float, pitch: float, roll: float, warp: float) -> np.ndarray:
    """Heights of the mounts lf, rf, lr, rr: nose down, left side up, front and rear twisted against each other."""
    front, rear = 0.45 * (roll + 0.5 * warp), 0.6 * (roll - 0.5 * warp)
    nose, tail = heave - 1.7 * pitch, heave + 1.1 * pitch
    return np.array([nose + front, nose - front, tail + rear, tail - rear])


def test_heave_pitch_roll_and_warp_are_found_from_the_heights_of_the_mounts():
    modes = displacement_modes(CAR) @ heights(0.01, 0.02, 0.03, 0.0)
    assert modes == pytest.approx([0.01, 0.02, 0.03, 0.0])
    roll = 0.5 * 0.04 * (1.1 - 1.7) / 2.8  # the roll is that at the centre of gravity, between the twisted ends
    assert displacement_modes(CAR) @ heights(0.0, 0.0, 0.0, 0.04) == pytest.approx([0.0, 0.0, roll, 0.04])


def test_aeroloaders_do_the_work_of_the_forces_of_the_modes_on_a_rigid_car():
    modes = np.array([-3000.0, 200.0, 150.0, 0.0])
    down = aeroloader_forces(modes, CAR)
    assert force_modes(CAR) @ -down == pytest.approx(modes)
    assert -down @ heights(0.01, 0.02, 0.03, 0.0) == pytest.approx(modes[:3] @ [0.01, 0.02, 0.03])
