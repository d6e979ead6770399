"""Limits of the actuators: stroke and velocity of wheelloaders, force of aeroloaders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.drivefile.target import Lines
from eightpost.errors import ParameterError
from eightpost.units import convert

#: Number of alternating projections onto the limits and the band.
_ROUNDS = 12

#: Excess over a limit that counts as rounding [1].
_CLOSE = 1e-9


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the commands; the defaults are those of the rig in section 6.1.1."""

    #: Maximum distance of a wheelloader from the middle of its stroke [m]; half of 12.4 in.
    stroke: float = 0.5 * convert(12.4, "in", "m")
    velocity: float = convert(180.0, "in/s", "m/s")  #: Maximum velocity of a wheelloader [m/s]; 180 in/s.
    #: Maximum force of an aeroloader [N]; 4300 lbf. Moments are not limited.
    force: float = convert(4300.0, "lbf", "N")

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not value > 0.0:
                raise ParameterError(f"the limit of {name} must be above 0, not {value:g}")


@dataclass(frozen=True, slots=True)
class LimitHit:
    """A command that a limit has changed."""

    name: str  #: Name of the input.
    kind: str  #: Kind of the limit: stroke, velocity or force.
    wanted: float  #: Largest value without the limit, SI.
    limit: float  #: Limit, SI.
    unit: str  #: SI unit of both.
    time: float  #: Time of the largest excess, from the start of the drive file [s].
    share: float  #: Share of the time at which the limit was exceeded [1].

    def __str__(self) -> str:
        return (
            f"{self.name} needs a {self.kind} of {self.wanted:.4g} {self.unit} at {self.time:.2f} s, the limit is "
            f"{self.limit:.4g} {self.unit} (exceeded for {100.0 * self.share:.2g} % of the time)"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the attributes for a JSON file."""
        return asdict(self)


def within_limits(
    rows: Array, names: tuple[str, ...], units: tuple[str, ...], lines: Lines, limits: Limits, window: Array
) -> tuple[Array, tuple[LimitHit, ...]]:
    """Return the commands (m, N) within the limits, and the limits that changed them.

    A command beyond a limit is projected alternately onto the limit and onto the band of the drive file, so that it
    gets no harmonics; finally, it is scaled by the small excess that remains.

    Args:
        rows: Commands (m, N), SI.
        names: Names of the m inputs.
        units: SI units of the m inputs.
        lines: Lines of the drive file.
        limits: Limits.
        window: Weight (N,) of the drive, 0 at its ends.
    """
    limited, hits = rows.copy(), []
    stroke, force = _Kind("stroke", "m", limits.stroke, _same), _Kind("force", "N", limits.force, _same)
    velocity = _Kind("velocity", "m/s", limits.velocity, _slope_at(lines.rate))
    of_unit = {"m": [stroke, velocity], "N": [force]}
    for row, (name, unit) in enumerate(zip(names, units, strict=True)):
        kinds = of_unit.get(unit, [])
        found = [hit for kind in kinds if (hit := _hit(rows[row], name, kind, lines.rate))]
        if found:
            limited[row] = _projected(rows[row], kinds, lines, window)
            hits += found
    return limited, tuple(hits)


@dataclass(frozen=True, slots=True)
class _Kind:
    """A limit of one command, and the function from the command to the limited quantity."""

    name: str
    unit: str
    limit: float
    of: Callable[[Array], Array]


def _same(row: Array) -> Array:
    return row


def _slope_at(rate: float) -> Callable[[Array], Array]:
    """Return the function from a command (N,) to its change per second between samples (N,)."""

    def slope(row: Array) -> Array:
        return np.asarray(np.diff(row, append=row[-1:]) * rate, dtype=np.float64)

    return slope


def _hit(row: Array, name: str, kind: _Kind, rate: float) -> LimitHit | None:
    size = np.abs(kind.of(row))
    worst = int(np.argmax(size))
    if size[worst] <= (1.0 + _CLOSE) * kind.limit:
        return None
    share = float(np.mean(size > kind.limit))
    return LimitHit(name, kind.name, float(size[worst]), kind.limit, kind.unit, worst / rate, share)


def _projected(row: Array, kinds: list[_Kind], lines: Lines, window: Array) -> Array:
    steady = float(np.clip(row[0], -kinds[0].limit, kinds[0].limit))
    moving = row - row[0]
    for _ in range(_ROUNDS):
        for kind in kinds:
            values = kind.of(steady + moving)
            excess = values - np.clip(values, -kind.limit, kind.limit)
            moving = moving - (excess if kind.of is _same else _integral(excess, lines))
        moving = window * lines.rows(lines.spectrum(moving[None]))[0]
    return np.asarray(steady + moving * _remaining_scale(steady, moving, kinds), dtype=np.float64)


def _integral(slope: Array, lines: Lines) -> Array:
    """Return the integral (N,) of an excess velocity within the band."""
    spectrum = lines.spectrum(slope[None]) / (2j * np.pi * lines.frequency[:, None])
    return np.asarray(lines.rows(spectrum)[0])


def _remaining_scale(steady: float, moving: Array, kinds: list[_Kind]) -> float:
    """Return the largest factor of the motion, at most 1, with which all limits hold."""
    scale = 1.0
    for kind in kinds:
        values = kind.of(moving)
        offset = steady if kind.of is _same else 0.0
        for extreme, room in ((values.max(), kind.limit - offset), (-values.min(), kind.limit + offset)):
            if extreme > room:
                scale = min(scale, max(room, 0.0) / float(extreme))
    return scale
