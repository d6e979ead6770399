"""Math channels 45 to 62 of Table 6.1, computed from measured channels (6.1.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.rig.post.car import Geometry
from eightpost.rig.post.modes import MODES, displacement_modes, force_modes, ride_heights
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries

#: Highest cut-off of a low-pass before a derivative, as a fraction of the sample rate [1].
HIGHEST_CUTOFF = 0.4


class MathChannels(NamedTuple):
    """Computed channels (N,) by name, and descriptions of the steps, a sentence each.

    It does not contain the whole record, because at full rate a copy takes hundreds of megabytes.
    """

    channels: Mapping[str, Array]
    steps: tuple[str, ...] = ()


def math_channels(
    series: TimeSeries, corners: Sequence[str], *, pot_cutoff: float | None, geometry: Geometry | None
) -> MathChannels:
    """Compute the math channels of a rig record.

    Args:
        series: Rig record at its own rate.
        corners: Names of its corners; one empty name for a quarter car.
        pot_cutoff: Cut-off frequency of the potentiometers' low-pass for the shock velocities [Hz]; None computes none.
        geometry: Geometry of the rig for the aeroloaders' modes and the ride heights; None computes none.
    """
    channels: Mapping[str, Array] = {}
    steps: tuple[str, ...] = ()
    if pot_cutoff is not None:
        channels, steps = _velocities_of(series, corners, pot_cutoff)
    if geometry is not None:
        modes, more = _modes_of(series, geometry)
        channels, steps = {**channels, **modes}, (*steps, *more)
    return MathChannels(channels, steps)


def _velocities_of(series: TimeSeries, corners: Sequence[str], cutoff: float) -> MathChannels:
    """Compute the shock velocities from the potentiometers: low-pass, central differences (6.1.2).

    A corner without a potentiometer keeps its own velocity. Central differences return `sin(x) / x` of the true
    velocity with `x = 2 pi f / rate`: 0.4 % low at 30 Hz for a rate of 1250 Hz. They are therefore computed before a
    record is decimated.

    Args:
        series: Rig record at its own rate.
        corners: Names of its corners; one empty name for a quarter car.
        cutoff: Cut-off frequency of the low-pass [Hz], at most 0.4 of the sample rate.
    """
    rate = series.sample_rate
    cutoff = min(cutoff, HIGHEST_CUTOFF * rate)
    pots = {channel(corner, "velocity"): channel(corner, "displacement") for corner in corners}
    pots = {velocity: pot for velocity, pot in pots.items() if pot in series}
    if not pots:
        return MathChannels({})
    velocities = {name: velocity_from_displacement(series[pot], rate, cutoff) for name, pot in pots.items()}
    low = 100.0 * (1.0 - float(np.sinc(2.0 * 20.0 / rate)))
    names = ", ".join(velocities)
    step = f"{names} from displacement: low-pass {cutoff:g} Hz, central differences ({low:.2g} % low at 20 Hz)"
    return MathChannels(velocities, (step,))


def _modes_of(series: TimeSeries, geometry: Geometry) -> MathChannels:
    """Compute the aeroloaders' modes (Eq 6.1, 6.2) and the ride heights, if the record has the channels for them.

    Args:
        series: Rig record of a car with four aeroloaders.
        geometry: Positions of the aeroloaders and of the points where ride heights are defined [m].
    """
    steps: list[str] = []
    channels: dict[str, Array] = {}
    heights, loads, roads = (_corners(series, quantity) for quantity in ("aero_position", "aero", "road"))
    if heights is not None:
        modes = displacement_modes(geometry) @ heights
        channels |= {f"aero.{mode}": row for mode, row in zip(MODES, modes, strict=True)}
        steps.append("aeroloaders' heave, pitch, roll and warp from their positions (Eq 6.1)")
        if roads is not None:
            nose, spoiler = ride_heights(modes[0], modes[1], roads, geometry)
            channels |= {"front.ride_height": nose, "rear.ride_height": spoiler}
            steps.append("ride heights from heave, pitch and the wheelloaders' plane (6.1.2)")
    if loads is not None:
        channels |= dict(zip(_MODE_FORCES, -force_modes(geometry) @ loads, strict=True))
        steps.append("aeroloaders' modal forces from their load cells, positive upward (Eq 6.2)")
    return MathChannels(channels, tuple(steps))


#: Channels 49 to 52.
_MODE_FORCES = ("aero.heave_force", "aero.pitch_moment", "aero.roll_moment", "aero.warp_moment")


def _corners(series: TimeSeries, quantity: str) -> Array | None:
    """Return a quantity at lf, rf, lr, rr (4, N); None if a corner lacks it."""
    names = [f"{corner}.{quantity}" for corner in CORNERS]
    return np.stack([series[name] for name in names]) if all(name in series for name in names) else None
