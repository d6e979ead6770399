"""Math channels 45 to 62 of Table 6.1, made of measured ones as 6.1.2 says."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.rig.post.modes import MODES, displacement_modes, force_modes, ride_heights
from eightpost.signals.filters import velocity_from_displacement

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.rig.post.car import Geometry
    from eightpost.signals.timeseries import TimeSeries

    Array = NDArray[np.float64]

#: A low-pass before a derivative is at most this part of the sample rate [1].
HIGHEST_CUTOFF = 0.4


class Made(NamedTuple):
    """Channels that were made (N,), by name, and what was done, a sentence each.

    Channels, not the record with them: at full rate a copy of it is hundreds of megabytes.
    """

    channels: Mapping[str, Array]
    steps: tuple[str, ...] = ()


def velocities_of(series: TimeSeries, corners: Sequence[str], cutoff: float) -> Made:
    """Return each shock velocity, made of its potentiometer: low-pass, central differences (6.1.2).

    A corner without a potentiometer keeps its own velocity. Central differences read `sin(x) / x` of the truth,
    `x = 2 pi f / rate`: 0.4 % low at 30 Hz of 1250 Hz, so they are taken before a record is decimated.

    Args:
        series: A rig record at its own rate.
        corners: Its corners; one empty name for a quarter car.
        cutoff: Of the low-pass [Hz], at most 0.4 of the sample rate.
    """
    rate = series.sample_rate
    cutoff = min(cutoff, HIGHEST_CUTOFF * rate)
    pots = {_name(corner, "velocity"): _name(corner, "displacement") for corner in corners}
    pots = {velocity: pot for velocity, pot in pots.items() if pot in series}
    if not pots:
        return Made({})
    made = {name: velocity_from_displacement(series[pot], rate, cutoff) for name, pot in pots.items()}
    low = 100.0 * (1.0 - float(np.sinc(2.0 * 20.0 / rate)))
    which = ", ".join(made)
    step = f"{which} from displacement: low-pass {cutoff:g} Hz, central differences ({low:.2g} % low at 20 Hz)"
    return Made(made, (step,))


def modes_of(series: TimeSeries, geometry: Geometry) -> Made:
    """Return the aeroloaders' modes (Eq 6.1, 6.2) and the ride heights, where a record's channels allow it.

    Args:
        series: A rig record of a car with four aeroloaders.
        geometry: Where they are, and where the ride heights are measured [m].
    """
    steps: list[str] = []
    made: dict[str, Array] = {}
    heights, loads, roads = (_corners(series, quantity) for quantity in ("aero_position", "aero", "road"))
    if heights is not None:
        modes = displacement_modes(geometry) @ heights
        made |= {f"aero.{mode}": row for mode, row in zip(MODES, modes, strict=True)}
        steps.append("aeroloaders' heave, pitch, roll and warp from their positions (Eq 6.1)")
        if roads is not None:
            nose, spoiler = ride_heights(modes[0], modes[1], roads, geometry)
            made |= {"front.ride_height": nose, "rear.ride_height": spoiler}
            steps.append("ride heights from heave, pitch and the wheelloaders' plane (6.1.2)")
    if loads is not None:
        made |= dict(zip(_MODE_FORCES, -force_modes(geometry) @ loads, strict=True))
        steps.append("aeroloaders' mode forces from their load cells, up (Eq 6.2)")
    return Made(made, tuple(steps))


#: Channels 49 to 52.
_MODE_FORCES = ("aero.heave_force", "aero.pitch_moment", "aero.roll_moment", "aero.warp_moment")


def _corners(series: TimeSeries, quantity: str) -> Array | None:
    """Return a quantity at lf, rf, lr, rr (4, N), None where a corner lacks it."""
    names = [f"{corner}.{quantity}" for corner in ("lf", "rf", "lr", "rr")]
    return np.stack([series[name] for name in names]) if all(name in series for name in names) else None


def _name(corner: str, quantity: str) -> str:
    return f"{corner}.{quantity}" if corner else quantity
