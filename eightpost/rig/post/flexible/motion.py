"""Conversion of a flexible car to arrays for the compiled integration, and of its records to measured coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.post.flexible.kernel import COORDINATES, ENGINE, SHELL, FlexibleNumbers
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.rig.post.flexible.car import FlexibleCar, Sliders

_GRAVITY = convert(1.0, "g_0", "m/s2")


def numbers_of(car: FlexibleCar) -> FlexibleNumbers:
    """Return a car as arrays."""
    shell, engine, own, tires = car.shell, car.engine, car.suspension, car.tires
    masses = [shell.mass, shell.pitch_inertia, shell.roll_inertia, shell.bending[0], shell.torsion[0]]
    preload = (tires.static_load - _GRAVITY * car.wheels) / own.ratio[:, 0]
    modes = [(m * (2.0 * np.pi * f) ** 2, 2.0 * z * m * 2.0 * np.pi * f) for m, f, z in (shell.bending, shell.torsion)]
    return FlexibleNumbers(
        np.array([*masses, engine.mass, engine.pitch_inertia, *car.wheels]),
        np.array(modes),
        car.corner_rows,
        car.load_rows,
        np.stack([shell.row(engine.ahead + arm, 0.0) for arm in engine.arms]),
        np.stack([engine.arms, engine.stiffness, engine.damping], axis=1),
        np.column_stack([own.ratio, preload, own.rate, own.stop_gap, own.stop_rate, own.damping]),
        own.bars,
        _sliders(car.friction),
        np.column_stack([tires.static_load, tires.stiffness, tires.stiffening, tires.damping]),
        _sliders(tires.hysteresis),
    )


def _sliders(sliders: Sliders) -> Array:
    return np.column_stack([sliders.sliding, sliders.breakaway, sliders.stiffness])


def measured(car: FlexibleCar, records: Array) -> tuple[Array, Array, Array]:
    """Return the motion in measured coordinates, its velocity and its acceleration (MEASURED, N).

    Args:
        car: Car that moved.
        records: Records of the compiled integration (N, 45).
    """
    q, v, a = (records[:, k * COORDINATES : (k + 1) * COORDINATES].T for k in range(3))
    rows = np.zeros((16, COORDINATES))
    rows[:4, ENGINE:] = np.eye(4)
    rows[4:8, :SHELL], rows[8:12, :SHELL], rows[12:, :SHELL] = car.corner_rows, car.load_rows, car.point_rows
    place, speed, rate = rows @ q, rows @ v, rows @ a
    w, dw, ddw = (x[:4] - x[4:8] for x in (place, speed, rate))
    r0, r1, r2 = car.suspension.ratio.T[:, :, None]
    ratio, bend = r0 + w * (r1 + 0.5 * w * r2), r1 + w * r2
    travel = w * (r0 + w * (r1 / 2.0 + w * r2 / 6.0))
    return (
        np.concatenate([travel, place]),
        np.concatenate([ratio * dw, speed]),
        np.concatenate([ratio * ddw + bend * dw**2, rate]),
    )
