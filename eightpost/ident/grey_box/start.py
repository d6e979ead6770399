"""Start values of the grey-box fit: balances of forces, solved by linear least squares in the frequency domain.

Each hub's tire force is the sum of its inertia, spring and shock; each axle's suspension forces are the sum of the
chassis' inertia and the loads. These regressions are biased by noise and friction, but close enough for the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.signals import TimeSeries

#: Band of the regressions [Hz], and that of the tires, which hardly deflect at low frequencies.
_LOW, _HIGH, _TIRES = 0.7, 20.0, 4.0

#: Limits of the start values of positive parameters.
_LIMITS = {
    "mass": (20.0, 1e4), "hub_mass": (5.0, 500.0), "spring_rate": (3e3, 3e6), "tire_stiffness": (3e4, 3e6),
    "tire_damping": (30.0, 1e4), "motion_ratio": (0.2, 2.0), "twist_stiffness": (1e4, 1e8),
}  # fmt: skip


class _Lines(NamedTuple):
    """Spectral lines of all tests: angular frequencies w (B,) and channels by name (B,)."""

    w: Array
    of: dict[str, Complex]


def start_values(tests: Sequence[TimeSeries], experiment: Experiment) -> dict[str, float]:
    """Return start values by parameter; empty if a channel that the balances need is missing."""
    needed = [
        channel(c, q) for c in CORNERS for q in ("displacement", "tire_force", "hub_acceleration", "force", "road")
    ]
    if any(name not in test for test in tests for name in needed):
        return {}
    lines = _lines(tests, [*needed, *experiment.rig])
    found: dict[str, float] = {}
    loads: dict[str, Complex] = {}
    travels: dict[str, Complex] = {}
    for axle, pair in (("front", CORNERS[:2]), ("rear", CORNERS[2:])):
        found |= _axle(lines, axle, pair, loads, travels)
    for corner in CORNERS:
        found |= _tire(lines, corner)
    return found | _chassis(lines, experiment, loads, travels)


def _lines(tests: Sequence[TimeSeries], names: Sequence[str]) -> _Lines:
    parts: dict[str, list[Complex]] = {name: [] for name in names}
    frequencies = []
    for test in tests:
        every = np.fft.rfftfreq(len(test), 1.0 / test.sample_rate)
        kept = (every >= _LOW) & (every <= _HIGH)
        frequencies.append(2.0 * np.pi * every[kept])
        window = np.hanning(len(test))
        for name, part in parts.items():
            values = test[name]
            part.append(np.fft.rfft(window * (values - values.mean()))[kept] / np.sqrt(len(test)))
    return _Lines(np.concatenate(frequencies), {name: np.concatenate(part) for name, part in parts.items()})


def _solve(target: Complex, columns: Sequence[Complex]) -> Array:
    """Return the real least-squares coefficients of complex columns."""
    matrix = np.stack(columns, axis=1)
    rows, y = np.vstack([matrix.real, matrix.imag]), np.concatenate([target.real, target.imag])
    size = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(rows / size, y, rcond=1e-10)[0] / size)


def _axle(
    lines: _Lines, axle: str, pair: Sequence[str], loads: dict[str, Complex], travels: dict[str, Complex]
) -> dict[str, float]:
    """Return an axle's parameters; add the suspension forces and the wheel travels of its corners."""
    of = lines.of
    motion = [of[channel(c, q)] for q in ("hub_acceleration", "force", "displacement") for c in pair]
    motion += [1j * lines.w * of[channel(c, "displacement")] for c in pair]  # friction acts like some damping
    rows = np.stack([_solve(of[channel(c, "tire_force")], motion) for c in pair])
    masses, shocks, springs = rows[:, 0:2], rows[:, 2:4], rows[:, 4:6]
    ratio = shocks.sum(axis=1)
    share = float(np.clip(0.5 * (shocks[0, 1] / ratio[0] + shocks[1, 0] / ratio[1]), -0.4, 0.4))
    ratio = np.clip(ratio, *_LIMITS["motion_ratio"])
    port = ratio[:, None] * np.array([[1.0 - share, share], [share, 1.0 - share]])
    rates = springs @ port  # by travel of the wheels
    cross = 0.5 * (rates[0, 1] + rates[1, 0])
    found = {f"{axle}.shock_share": share, f"{axle}.mass coupling": 0.5 * float(masses[0, 1] + masses[1, 0])}
    rate = np.diag(rates) + cross
    if axle == "front":
        found["front.bar"] = -4.0 * cross
    else:
        found["rear.spring_share"] = 0.5 * (1.0 - float(np.sqrt(max(1.0 - 2.0 * cross / rate.mean(), 0.0))))
    for i, corner in enumerate(pair):
        found[f"{corner}.hub_mass"] = _limited("hub_mass", masses[i, i])
        found[f"{corner}.motion_ratio"] = float(ratio[i])
        found[f"{corner}.spring_rate"] = _limited("spring_rate", rate[i])
        inertia = sum(masses[i, j] * of[channel(c, "hub_acceleration")] for j, c in enumerate(pair))
        loads[corner] = of[channel(corner, "tire_force")] - inertia
        inverse = np.linalg.inv(port)
        travels[corner] = sum(inverse[i, j] * of[channel(c, "displacement")] for j, c in enumerate(pair))
    return found


def _tire(lines: _Lines, corner: str) -> dict[str, float]:
    fast = lines.w > 2.0 * np.pi * _TIRES
    w = lines.w[fast]
    height = lines.of[channel(corner, "hub_acceleration")][fast] / -(w**2)
    deflection = lines.of[channel(corner, "road")][fast] - height
    stiffness, damping = _solve(lines.of[channel(corner, "tire_force")][fast], [deflection, 1j * w * deflection])
    return {
        f"{corner}.tire_stiffness": _limited("tire_stiffness", stiffness),
        f"{corner}.tire_damping": _limited("tire_damping", damping),
    }


def _chassis(
    lines: _Lines, experiment: Experiment, loads: dict[str, Complex], travels: dict[str, Complex]
) -> dict[str, float]:
    """Return masses, twist and load parameters from the balances of heave and roll of both ends of the chassis."""
    rise = {c: lines.of[channel(c, "hub_acceleration")] + lines.w**2 * travels[c] for c in CORNERS}
    heave = [0.5 * (rise["lf"] + rise["rf"]), 0.5 * (rise["lr"] + rise["rr"])]
    roll = [0.5 * (rise["lf"] - rise["rf"]), 0.5 * (rise["lr"] - rise["rr"])]
    up = [loads["lf"] + loads["rf"], loads["lr"] + loads["rr"]]
    over = [loads["lf"] - loads["rf"], loads["lr"] - loads["rr"]]
    names = [name for name in experiment.rig if name.rpartition(".")[2] != "road"]
    aero = f"{CORNERS[0]}.aero" in names
    if aero:
        sides = [[lines.of[f"{c}.aero"] for c in pair] for pair in (CORNERS[:2], CORNERS[2:])]
        even, odd = [a + b for a, b in sides], [a - b for a, b in sides]
    else:
        even = [-lines.of[name] for name in names if name in ("heave_force", "pitch_moment")]
        odd = [-lines.of[name] for name in names if name == "roll_moment"]
    twist = (roll[0] - roll[1]) / -(lines.w**2)
    front = _solve(up[0], [*heave, *even])
    rear = _solve(up[1], [*heave, *even])
    over_front = _solve(over[0], [roll[0], twist, *odd])
    over_rear = _solve(over[1], [roll[1], -twist, *odd])
    found = {
        "front.mass heave": _limited("mass", front[0]),
        "rear.mass heave": _limited("mass", rear[1]),
        "mass coupling heave": 0.5 * float(front[1] + rear[0]),
        "front.mass roll": _limited("mass", over_front[0]),
        "rear.mass roll": _limited("mass", over_rear[0]),
        "twist_stiffness": _limited("twist_stiffness", 0.5 * (over_front[1] + over_rear[1])),
    }
    if not aero:
        return found | _modal_loads(names, front[2:], rear[2:], over_front[2:], over_rear[2:])
    for k, axle in enumerate(("front", "rear")):
        found[f"{axle}.aero_place"] = float(front[2 + k])
        found[f"{axle}.aero_spread"] = abs(float(over_front[2 + k] + over_rear[2 + k]))
    return found


def _modal_loads(
    names: Sequence[str], front: Array, rear: Array, over_front: Array, over_rear: Array
) -> dict[str, float]:
    found = {}
    even = [name for name in names if name in ("heave_force", "pitch_moment")]
    if "heave_force" in even:
        found["heave_share"] = float(front[even.index("heave_force")])
    if "pitch_moment" in even:
        k = even.index("pitch_moment")
        found["pitch_arm"] = 0.5 * float(rear[k] - front[k])
    if "roll_moment" in names:
        found |= {"front.roll_arm": float(over_front[0]), "rear.roll_arm": float(over_rear[0])}
    return found


def _limited(kind: str, value: float) -> float:
    low, high = _LIMITS[kind]
    return float(np.clip(value, low, high))
