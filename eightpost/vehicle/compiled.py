"""The bristle of eightpost.vehicle.friction as machine code: inside other compiled loops, and for whole records.

A compiled function may call `deflection_after` and `sliding_deflection`; it is stored on disk under `BRISTLE_FILE`.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import cast

import numpy as np

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.extras import needs
from eightpost.vehicle import friction
from eightpost.vehicle.friction import Bristle

with needs("fit", "friction of a car"):
    from numba import njit
    from numba.extending import register_jitable

#: Number that changes with the file of the law; see `eightpost.cache.kept`.
BRISTLE_FILE = zlib.crc32(Path(friction.__file__).read_bytes())

deflection_after = register_jitable(friction.deflection_after)
sliding_deflection = register_jitable(friction.sliding_deflection)


def _follow(velocity: Array, step: float, reach: float, static_ratio: float, stribeck_velocity: float) -> Array:
    z = np.zeros(velocity.size)
    for k in range(1, velocity.size):
        mean = 0.5 * (velocity[k - 1] + velocity[k])
        z[k] = deflection_after(z[k - 1], mean, step, reach, static_ratio, stribeck_velocity)
    return z


_compiled_follow = kept(njit(nogil=True, error_model="numpy")(_follow), BRISTLE_FILE)


def deflections(velocity: Array, step: float, law: Bristle) -> Array:
    """Return the deflections z (N,) [m] of a bristle that is relaxed at the first sample.

    The port velocity (N,) [m/s] is linear between its samples, which are `step` [s] apart.
    """
    values = np.ascontiguousarray(velocity, dtype=np.float64)
    return cast("Array", _compiled_follow(values, step, law.reach, law.static_ratio, law.stribeck_velocity))
