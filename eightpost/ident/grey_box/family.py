"""The grey-box family of cars: heave, pitch, two roll angles, four hubs; solid or independent axles.

The coordinates are heights: of the chassis above the front and the rear axle, half the differences of its left and
right heights there, and the four hubs. Masses are those of heights [kg], so no length of the car needs to be known. An
axle's hubs may be coupled by inertia (a solid axle), and the shocks and springs may be inboard: each then moves with
both hubs of its axle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError
from eightpost.ident.grey_box.output_error import Parameter, ParameterTable
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.vehicle import Bristle, Friction, StateSpace
from eightpost.vehicle.statespace import Channel

#: Friction of the family, of which force and reach are fitted: Stribeck velocity [m/s], static over sliding force.
BRISTLE = Bristle(static_ratio=1.15, stribeck_velocity=0.01)

#: Parameters that the base fit leaves at their start values.
OPTIONAL = (
    *(f"{c}.spring_progression" for c in CORNERS),
    *(f"{c}.tire_stiffening" for c in CORNERS),
)

#: A load that decides between a load on every corner and loads of heave, roll and pitch.
_AERO = f"{CORNERS[0]}.aero"

#: Rates L_1, L_2 [rad/s] of the filter that makes the velocity of the road, which tire dampers need, a proper input:
#:
#:     s (1 + s/L_1 + s/L_2) / ((1 + s/L_1) (1 + s/L_2)) = s (1 - s^2 / (L_1 L_2) + ...)
#:
#: A single lag of 500 Hz has a term in s^2 that acts like 0.6 % of a tire's stiffness at 20 Hz.
_RATES = (2.0 * np.pi * 400.0, 2.0 * np.pi * 600.0)

#: Units of outputs and loads by quantity.
_UNITS = {
    "velocity": "m/s", "displacement": "m", "tire_force": "N", "ride_height": "m",
    "roll_moment": "N.m", "pitch_moment": "N.m", "road": "m",
}  # fmt: skip


def declared(starts: Mapping[str, float], rig: Sequence[str]) -> ParameterTable:
    """Return the parameters of the family.

    Args:
        starts: Start values by parameter; those missing have typical values.
        rig: Inputs of the rig; they decide the parameters of the loads.
    """
    rows = [
        *(_positive(f"front.mass {kind}", "kg", 600.0) for kind in ("heave", "roll")),
        *(_positive(f"rear.mass {kind}", "kg", 600.0) for kind in ("heave", "roll")),
        Parameter("mass coupling heave", "kg", 0.0, -3000.0, 3000.0, 100.0),
        _positive("twist_stiffness", "N/m", 1e6, 1e3),
        _positive("twist_damping", "N.s/m", 1e3, 1.0),
        Parameter("front.bar", "N/m", 0.0, -1e6, 1e6, 2e4),
        *(Parameter(f"{axle}.mass coupling", "kg", 0.0, -200.0, 200.0, 10.0) for axle in ("front", "rear")),
        *(Parameter(f"{axle}.shock_share", "1", 0.0, -0.6, 0.6, 0.1) for axle in ("front", "rear")),
        Parameter("rear.spring_share", "1", 0.0, -0.6, 0.6, 0.1),
        _positive("friction_reach", "m", BRISTLE.reach, 1e-6, 3e-3),
    ]
    for c in CORNERS:
        rows += [
            _positive(f"{c}.hub_mass", "kg", 50.0),
            _positive(f"{c}.spring_rate", "N/m", 1e5),
            _positive(f"{c}.tire_stiffness", "N/m", 3e5),
            _positive(f"{c}.tire_damping", "N.s/m", 300.0, 0.1),
            _positive(f"{c}.motion_ratio", "1", 0.9, 0.05, 3.0),
            _positive(f"{c}.friction", "N", 30.0, 0.01, 2e3),
            Parameter(f"{c}.spring_progression", "1/m", 0.0, -20.0, 20.0, 1.0),
            Parameter(f"{c}.tire_stiffening", "1/m", 0.0, -50.0, 50.0, 5.0),
        ]
    places = {"front": 1.0, "rear": 0.0}
    if _AERO in rig:
        for axle, place in places.items():
            rows.append(Parameter(f"{axle}.aero_place", "1", place, -2.0, 3.0, 0.2))
            rows.append(Parameter(f"{axle}.aero_spread", "1", 0.7, 0.0, 3.0, 0.2))
    else:
        rows.append(Parameter("heave_share", "1", 0.5, -1.0, 2.0, 0.1))
        rows.append(Parameter("pitch_arm", "1/m", 0.35, 0.0, 3.0, 0.1))
        rows += [Parameter(f"{axle}.roll_arm", "1/m", 0.6, -1.0, 5.0, 0.1) for axle in places]
    rows += [Parameter(f"{axle}.overhang", "1", 0.4, -1.0, 2.0, 0.1) for axle in places]
    rows += [
        Parameter("driver_place", "1", 0.3, -1.0, 2.0, 0.1),
        Parameter("driver_spread", "1", 0.2, -2.0, 2.0, 0.1),
    ]
    first = {row.name: float(np.clip(starts.get(row.name, row.start), row.low, row.high)) for row in rows}
    return ParameterTable(tuple(replace(row, start=first[row.name]) for row in rows))


def _positive(name: str, unit: str, start: float, low: float | None = None, high: float | None = None) -> Parameter:
    low, high = start / 100.0 if low is None else low, start * 100.0 if high is None else high
    return Parameter(name, unit, start, low, high, None)


@dataclass(frozen=True, slots=True, eq=False)
class Matrices:
    """Arrays of one car."""

    mass: Array  #: Mass matrix (8, 8) [kg].
    stiffness: Array  #: Stiffness (8, 8) [N/m] of bar and twist.
    damping: Array  #: Damping (8, 8) [N.s/m] of the twist.
    shock: Array  #: Ports per q (4, 8).
    spring: Array  #: Springs per q (4, 8).
    load: Array  #: Load points per q (A, 8); the generalised force is load^T f.


#: Chassis heights at the corners per q (4, 8), and hubs.
CHASSIS = np.array(
    [[1, 0, s, 0, 0, 0, 0, 0] for s in (1, -1)] + [[0, 1, 0, s, 0, 0, 0, 0] for s in (1, -1)], dtype=float
)
WHEEL = np.eye(8)[4:]
_TRAVEL = WHEEL - CHASSIS


def matrices(p: Mapping[str, float], rig: Sequence[str]) -> Matrices:
    """Return the arrays of a car for parameters by name."""
    mass = np.diag([p["front.mass heave"], p["rear.mass heave"], p["front.mass roll"], p["rear.mass roll"],
                    *(p[f"{c}.hub_mass"] for c in CORNERS)])  # fmt: skip
    for i, j, name in ((0, 1, "mass coupling heave"), (4, 5, "front.mass coupling"), (6, 7, "rear.mass coupling")):
        mass[i, j] = mass[j, i] = p[name]
    twist, bar = np.zeros(8), 0.5 * (_TRAVEL[0] - _TRAVEL[1])
    twist[2], twist[3] = 1.0, -1.0
    stiffness = p["twist_stiffness"] * np.outer(twist, twist) + p["front.bar"] * np.outer(bar, bar)
    shares = [p["front.shock_share"]] * 2 + [p["rear.shock_share"]] * 2
    own = np.array([p[f"{c}.motion_ratio"] for c in CORNERS])[:, None]
    return Matrices(
        mass,
        stiffness,
        p["twist_damping"] * np.outer(twist, twist),
        own * _inboard(shares),
        _inboard([0.0, 0.0, p["rear.spring_share"], p["rear.spring_share"]]),
        _loads(p, rig),
    )


def _inboard(shares: Sequence[float]) -> Array:
    """Return travels (4, 8) to which the opposite wheel contributes a share."""
    other = _TRAVEL[[1, 0, 3, 2]]
    share = np.array(shares)[:, None]
    return np.asarray((1.0 - share) * _TRAVEL + share * other)


def _loads(p: Mapping[str, float], rig: Sequence[str]) -> Array:
    if _AERO in rig:
        rows = []
        for axle in ("front", "rear"):
            f, w = p[f"{axle}.aero_place"], p[f"{axle}.aero_spread"]
            rows += [[f, 1.0 - f, s * w * f, s * w * (1.0 - f), 0, 0, 0, 0] for s in (1.0, -1.0)]
        return -np.array(rows)
    share, arm = p["heave_share"], p["pitch_arm"]
    modes = {
        "heave_force": [share, 1.0 - share, 0, 0, 0, 0, 0, 0],
        "roll_moment": [0, 0, p["front.roll_arm"], p["rear.roll_arm"], 0, 0, 0, 0],
        "pitch_moment": [-arm, arm, 0, 0, 0, 0, 0, 0],
    }
    return np.array([modes[name] for name in rig if quantity(name) != "road"]).reshape(-1, 8)


def bristle_of(p: Mapping[str, float], corner: str) -> Bristle:
    """Return the friction of a corner for parameters by name."""
    return replace(BRISTLE, force=p[f"{corner}.friction"], reach=p["friction_reach"])


def output_rows(p: Mapping[str, float], m: Matrices, outputs: Sequence[str]) -> tuple[Array, Array, Array, Array]:
    """Return the outputs per q, q', q'' (Y, 8) and road (Y, 4); tire forces are zero here.

    Raises:
        InputError: An output is not known.
    """
    position, velocity, acceleration = (np.zeros((len(outputs), 8)) for _ in range(3))
    road = np.zeros((len(outputs), 4))
    for k, name in enumerate(outputs):
        what, corner = quantity(name), name.rpartition(".")[0]
        c = CORNERS.index(corner) if corner in CORNERS else -1
        if what == "displacement":
            position[k] = m.shock[c]
        elif what == "velocity":
            velocity[k] = m.shock[c]
        elif what == "hub_acceleration":
            acceleration[k] = WHEEL[c]
        elif what == "chassis_acceleration":
            acceleration[k] = CHASSIS[c]
        elif what == "ride_height":
            over = p[f"{corner}.overhang"]
            near, far = (0, 1) if corner == "front" else (1, 0)
            position[k, near], position[k, far] = 1.0 + over, -over
            road[k] = -0.5 * np.array([position[k, 0]] * 2 + [position[k, 1]] * 2)
        elif name == "driver.acceleration":
            f, w = p["driver_place"], p["driver_spread"]
            acceleration[k, :4] = f, 1.0 - f, w * f, w * (1.0 - f)
        elif what != "tire_force":
            raise InputError(f"the recipe grey-box does not know the output {name}; leave it out (--output-channels)")
    return position, velocity, acceleration, road


# ---- The vehicle file: a linear model about the mean of the tests, and laws of its ports ----------------------------


def linear_model(p: Mapping[str, float], experiment: Experiment) -> StateSpace:
    """Return the linear model with the baseline damping for parameters by name; its inputs are F - c v.

    States are 8 coordinates, their velocities and 4 roads with each of two lags.
    """
    m = matrices(p, experiment.rig)
    inverse = np.linalg.inv(m.mass)
    spring, tire, damper = (np.diag([p[f"{c}.{name}"] for c in CORNERS])
                            for name in ("spring_rate", "tire_stiffness", "tire_damping"))  # fmt: skip
    baseline = np.diag([experiment.baseline_damping[c] for c in CORNERS])
    stiffness = m.stiffness + m.spring.T @ spring @ m.spring + WHEEL.T @ tire @ WHEEL
    damping = m.damping + m.shock.T @ baseline @ m.shock + WHEEL.T @ damper @ WHEEL
    roads = [experiment.rig.index(channel(c, "road")) for c in CORNERS]
    others = [k for k, name in enumerate(experiment.rig) if quantity(name) != "road"]
    inputs, eight = len(experiment.inputs), np.eye(8)
    A, B = np.zeros((24, 24)), np.zeros((24, inputs))
    a, b = (1.0 / rate for rate in _RATES)
    direct, gains = (a + b) / (a * b), (b / (a * (a - b)), a / (b * (b - a)))  # 1 and 1 / (1 + s/L) of each lag
    A[:8, 8:16] = eight
    A[8:16, :8], A[8:16, 8:16] = -inverse @ stiffness, -inverse @ damping
    B[8:16, roads] = inverse @ WHEEL.T @ (tire + direct * damper)
    for lag, rate, gain in zip((slice(16, 20), slice(20, 24)), _RATES, gains, strict=True):
        A[8:16, lag], A[lag, lag] = gain * inverse @ WHEEL.T @ damper, -rate * np.eye(4)
        B[lag, roads] = rate * np.eye(4)
    B[8:16, others] = inverse @ m.load.T
    B[8:16, len(experiment.rig) :] = -inverse @ m.shock.T
    position, velocity, acceleration, road = output_rows(p, m, experiment.outputs)
    C = np.hstack([position, velocity, np.zeros((len(position), 8))]) + acceleration @ A[8:16]
    D = acceleration @ B[8:16]
    D[:, roads] += road
    for k, name in enumerate(experiment.outputs):
        if quantity(name) == "tire_force":
            c = CORNERS.index(name.rpartition(".")[0])
            lagged = [gain * damper[c] for gain in gains]
            C[k] = np.concatenate([-tire[c, c] * WHEEL[c], -damper[c, c] * WHEEL[c], *lagged])
            D[k, roads[c]] = tire[c, c] + direct * damper[c, c]
    channels, outputs = (tuple(Channel(n, _unit(n)) for n in ns) for ns in (experiment.inputs, experiment.outputs))
    return StateSpace(A, B, C, D, channels, outputs, name=experiment.name)


def port_laws(p: Mapping[str, float], experiment: Experiment) -> dict[str, Friction]:
    """Return the friction and the springs at the ports for parameters by name.

    The force k p w^2 of a progressive spring with the wheel travel w is that of a port spring with the displacement
    d = r w, for a port that moves with the spring:

        k2 = k p / r^3

    Ports whose displacement is not an output have no spring.
    """
    laws = {}
    for c in CORNERS:
        seen = channel(c, "displacement") in experiment.outputs
        spring = p[f"{c}.spring_rate"] * p[f"{c}.spring_progression"] / p[f"{c}.motion_ratio"] ** 3 if seen else 0.0
        laws[c] = Friction(bristle=bristle_of(p, c), spring=spring)
    return laws


def _unit(name: str) -> str:
    kind = quantity(name)
    return _UNITS.get(kind, "m/s2" if kind.endswith("acceleration") else "N")
