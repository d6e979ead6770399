"""The grey-box family of cars: parameters, start values of a fit, and simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.signal import resample

from eightpost.array_types import Array, Complex
from eightpost.cache import kept
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError
from eightpost.extras import needs
from eightpost.ident.grey_box.output_error import Parameter, ParameterTable
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.least_squares import linear_solution
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, StateSpace
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after
from eightpost.vehicle.statespace import Channel

with needs("fit", "identification"):
    from numba import njit

# ==== Cars: heave, pitch, two roll angles, four hubs; solid or independent axles =====================================
# The coordinates are heights: of the chassis above the front and the rear axle, half the differences of its left and
# right heights there, and the four hubs. Masses are those of heights [kg], so no length of the car needs to be known.
# An axle's hubs may be coupled by inertia (a solid axle), and the shocks and springs may be inboard: each then moves
# with both hubs of its axle.

#: Friction of the family, of which force and reach are fitted: Stribeck velocity [m/s], static over sliding force.
BRISTLE = Bristle(static_ratio=1.15, stribeck_velocity=0.01)

#: Parameters that the base fit leaves at their start values.
OPTIONAL = (*(f"{c}.spring_progression" for c in CORNERS), *(f"{c}.tire_stiffening" for c in CORNERS))

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
    """Return the parameters of the family; those without a start value have typical ones.

    The inputs of the rig decide the parameters of the loads.
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
    rows += [Parameter("driver_place", "1", 0.3, -1.0, 2.0, 0.1), Parameter("driver_spread", "1", 0.2, -2.0, 2.0, 0.1)]
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
            raise InputError(
                f"the recipe grey-box does not know the output {name}; leave it out (--set output-channels)"
            )
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


# ==== Start values: balances of forces, solved by linear least squares in the frequency domain =======================
# Each hub's tire force is the sum of its inertia, spring and shock; each axle's suspension forces are the sum of the
# chassis' inertia and the loads. These regressions are biased by noise and friction, but close enough for the fit.

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
    fast = lines.w > 2.0 * np.pi * _TIRES
    w = lines.w[fast]
    for corner in CORNERS:
        tire, road, hub = (lines.of[channel(corner, q)][fast] for q in ("tire_force", "road", "hub_acceleration"))
        deflection = road - hub / -(w**2)
        stiffness, damping = _solve(tire, [deflection, 1j * w * deflection])
        found[f"{corner}.tire_stiffness"] = _limited("tire_stiffness", stiffness)
        found[f"{corner}.tire_damping"] = _limited("tire_damping", damping)
    return found | _chassis(lines, experiment, loads, travels)


def _lines(tests: Sequence[TimeSeries], names: Sequence[str]) -> _Lines:
    parts: dict[str, list[Complex]] = {name: [] for name in names}
    frequencies = []
    for test in tests:
        every = np.fft.rfftfreq(len(test), 1.0 / test.sample_rate)
        inside = (every >= _LOW) & (every <= _HIGH)
        frequencies.append(2.0 * np.pi * every[inside])
        window = np.hanning(len(test))
        for name, part in parts.items():
            values = test[name]
            part.append(np.fft.rfft(window * (values - values.mean()))[inside] / np.sqrt(len(test)))
    return _Lines(
        np.concatenate(frequencies).astype(np.float64), {name: np.concatenate(part) for name, part in parts.items()}
    )


def _solve(target: Complex, columns: Sequence[Complex]) -> Array:
    """Return the real least-squares coefficients of complex columns."""
    matrix = np.stack(columns, axis=1)
    rows, y = np.vstack([matrix.real, matrix.imag]), np.concatenate([target.real, target.imag])
    return linear_solution(rows, y, weakest=1e-10)


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
        travels[corner] = np.asarray(sum(inverse[i, j] * of[channel(c, "displacement")] for j, c in enumerate(pair)))
    return found


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
    if aero:
        for k, axle in enumerate(("front", "rear")):
            found[f"{axle}.aero_place"] = float(front[2 + k])
            found[f"{axle}.aero_spread"] = abs(float(over_front[2 + k] + over_rear[2 + k]))
        return found
    modal = [name for name in names if name in ("heave_force", "pitch_moment")]
    if "heave_force" in modal:
        found["heave_share"] = float(front[2 + modal.index("heave_force")])
    if "pitch_moment" in modal:
        k = 2 + modal.index("pitch_moment")
        found["pitch_arm"] = 0.5 * float(rear[k] - front[k])
    if "roll_moment" in names:
        found |= {"front.roll_arm": float(over_front[2]), "rear.roll_arm": float(over_rear[2])}
    return found


def _limited(kind: str, value: float) -> float:
    low, high = _LIMITS[kind]
    return float(np.clip(value, low, high))


# ==== Simulation for many sets of parameters, in compiled steps ======================================================
#     q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h (3/2 a - 1/2 a-)),  v+ = v + h/2 (a + a+)
#
# with the acceleration a- one step before. The step is of second order and needs one evaluation of the forces. The
# velocity that it predicts is of third order: a predictor v + h a would act like additional damping. The bristle of the
# friction is exact for the mean velocity of a step.

#: Integration steps per second, at least [Hz].
_STEP_RATE = 1250.0


class Numbers(NamedTuple):
    """Arrays of K cars with 8 coordinates, 4 ports, A loads and Y outputs."""

    shock: Array  #: Port displacements per q (K, 4, 8).
    spring: Array  #: Spring displacements per q (K, 4, 8).
    push: Array  #: Accelerations per force of ports, springs, tires and loads (K, 8, 12 + A).
    stiffness: Array  #: Accelerations per q of the other elements (K, 8, 8).
    damping: Array  #: Accelerations per q' of the other elements (K, 8, 8).
    springs: Array  #: Rate, progression of the springs (K, 4, 2).
    tires: Array  #: Stiffness, damping, stiffening, static load of the tires (K, 4, 4).
    friction: Array  #: Sliding force, reach, static ratio and Stribeck velocity of the bristles (K, 4, 4).
    baseline: Array  #: Damping about which the ports are driven (4,).
    position: Array  #: Outputs per q (K, Y, 8).
    velocity: Array  #: Outputs per q' (K, Y, 8).
    acceleration: Array  #: Outputs per q'' (K, Y, 8).
    road: Array  #: Outputs per road (K, Y, 4).
    tire: Array  #: Outputs per tire force (Y, 4).


def _compile(function: Callable[..., Any]) -> Any:
    options = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc"}}
    return kept(cast("Any", njit(**options)(function)), BRISTLE_FILE)


@_compile
def march(numbers: Any, inputs: Array, step: float, every: int, outputs: Array) -> None:
    """Fill outputs (K, N, Y) of cars that start at rest, with `every` steps [s] per sample.

    Inputs are roads, road velocities, loads, port forces minus baseline damping (N every + 1, 12 + A).
    """
    dofs = 8
    loads = inputs.shape[1] - 12
    forces = np.zeros(12 + loads)
    guess, ports = np.zeros(dofs), np.zeros(4)
    for run in range(outputs.shape[0]):
        state, earlier = np.zeros(28), np.zeros(dofs)  # q, q', q'', bristles; q'' one step before
        q, v, a, z = state[:8], state[8:16], state[16:24], state[24:]
        shock, spring, push = numbers.shock[run], numbers.spring[run], numbers.push[run]
        stiffness, damping = numbers.stiffness[run], numbers.damping[run]
        for c in range(4):
            ports[c] = _dot(shock[c], v)
        for k in range(outputs.shape[1] * every):
            if k % every == 0:
                _observe(numbers, run, inputs[k], state, outputs[run, k // every])
            drive = inputs[k + 1]
            for i in range(dofs):
                q[i] += step * (v[i] + 0.5 * step * a[i])
                guess[i] = v[i] + step * (1.5 * a[i] - 0.5 * earlier[i])
            for c in range(4):
                speed, way = _dot(shock[c], guess), _dot(spring[c], q)
                law = numbers.friction[run, c]
                z[c] = deflection_after(z[c], 0.5 * (ports[c] + speed), step, law[1], law[2], law[3])
                rate = numbers.springs[run, c]
                forces[c] = drive[8 + loads + c] + numbers.baseline[c] * speed + law[0] / law[1] * z[c]
                forces[4 + c] = rate[0] * way * (1.0 + rate[1] * way)
                forces[8 + c] = _tire_force(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - guess[4 + c])
            for j in range(loads):
                forces[12 + j] = drive[8 + j]
            for i in range(dofs):
                new = _dot(push[i], forces) + _dot(stiffness[i], q) + _dot(damping[i], guess)
                v[i] += 0.5 * step * (a[i] + new)
                earlier[i], a[i] = a[i], new
            for c in range(4):
                ports[c] = _dot(shock[c], v)
            if k % 500 == 0 and not abs(q[0]) < 1e3:
                outputs[run] = np.nan
                break


@_compile
def _observe(numbers: Any, run: int, drive: Array, state: Array, outputs: Array) -> None:
    """Fill the outputs (Y,) of a state (28,)."""
    q, v, a, tires = state[:8], state[8:16], state[16:24], np.empty(4)
    for c in range(4):
        tires[c] = _tire_force(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - v[4 + c])
    for y in range(outputs.size):
        total = _dot(numbers.position[run, y], q) + _dot(numbers.velocity[run, y], v)
        total += _dot(numbers.acceleration[run, y], a)
        for c in range(4):
            total += numbers.road[run, y, c] * drive[c] + numbers.tire[y, c] * tires[c]
        outputs[y] = total


@_compile
def _dot(row: Array, x: Array) -> float:
    total = 0.0
    for i in range(x.size):
        total += row[i] * x[i]
    return total


@_compile
def _tire_force(tire: Array, deflection: float, rate: float) -> float:
    force = tire[0] * deflection * (1.0 + tire[2] * deflection) + tire[1] * rate
    return float(max(force, -tire[3]))


class GreyBoxCar:
    """Model of the family for the output-error engine: inputs are roads, loads and port forces minus c v.

    The static tire loads (4,) [N] are infinite where they are not known, which excludes lift-off.

    Raises:
        InputError: The experiment is not that of a car with four corners.
    """

    def __init__(self, experiment: Experiment, names: Sequence[str], static: Array) -> None:
        if experiment.ports != CORNERS:
            raise InputError(f"{experiment.name}: the recipe grey-box needs the corners {', '.join(CORNERS)}")
        self._experiment, self._names, self._static = experiment, tuple(names), static
        self._baseline = np.array([experiment.baseline_damping[c] for c in CORNERS])

    def run(self, values: Array, inputs: Array, rate: float) -> Array:
        """Return the outputs (K, N, Y) for parameters (K, P), inputs (N, U) and a sample rate [Hz]; see `Model`."""
        every = max(1, int(np.ceil(_STEP_RATE / rate - 1e-9)))
        outputs = np.empty((len(values), len(inputs), len(self._experiment.outputs)))
        march(self._numbers(values), _finer(inputs, rate, every), 1.0 / (rate * every), every, outputs)
        return outputs

    def _numbers(self, values: Array) -> Numbers:
        """Return the arrays of cars with parameters (K, P)."""
        rows = [self._one(dict(zip(self._names, row.tolist(), strict=True))) for row in values]
        stacked = [np.ascontiguousarray(np.stack(parts)) for parts in zip(*rows, strict=True)]
        tire = np.array([[float(n == channel(c, "tire_force")) for c in CORNERS] for n in self._experiment.outputs])
        shock, spring, push, stiffness, damping, springs, tires, friction, *rows_of_outputs = stacked
        position, velocity, acceleration, road = rows_of_outputs
        return Numbers(shock, spring, push, stiffness, damping, springs, tires, friction, self._baseline, position,
                       velocity, acceleration, road, tire)  # fmt: skip

    def _one(self, p: Mapping[str, float]) -> tuple[Array, ...]:
        m = matrices(p, self._experiment.rig)
        inverse = np.linalg.inv(m.mass)
        push = inverse @ np.hstack([-m.shock.T, -m.spring.T, WHEEL.T, m.load.T])
        springs = np.array([[p[f"{c}.spring_rate"], p[f"{c}.spring_progression"]] for c in CORNERS])
        tires = np.array([[p[f"{c}.tire_stiffness"], p[f"{c}.tire_damping"], p[f"{c}.tire_stiffening"], load]
                          for c, load in zip(CORNERS, self._static, strict=True)])  # fmt: skip
        friction = np.array([astuple(bristle_of(p, c)) for c in CORNERS])
        other = -inverse @ m.stiffness, -inverse @ m.damping
        rows = m.shock, m.spring, push, *other, springs, tires, friction, *output_rows(p, m, self._experiment.outputs)
        return tuple(np.asarray(row, dtype=np.float64) for row in rows)


def _finer(inputs: Array, rate: float, every: int) -> Array:
    """Return roads, road velocities, loads and port forces (N every + 1, 12 + A), interpolated without aliases.

    The road velocity is the derivative of the interpolated road: differences between samples would be too small at high
    frequencies.
    """
    count = len(inputs)
    rise = (inputs[-1] - inputs[0]) / max(count - 1, 1)
    waves = inputs - inputs[0] - np.arange(count)[:, None] * rise
    spectra = np.fft.rfft(waves[:, :4], axis=0)
    turns = 2j * np.pi * np.fft.rfftfreq(count, 1.0 / rate)[:, None]
    slopes = _resampled(np.fft.irfft(turns * spectra, count, axis=0), every) + rise[:4] * rate
    fine = _resampled(waves, every) + inputs[0] + np.arange(count * every)[:, None] / every * rise
    whole = np.hstack([fine[:, :4], slopes, fine[:, 4:]])
    return np.ascontiguousarray(np.vstack([whole, whole[-1:]]))


def _resampled(values: Array, every: int) -> Array:
    return np.asarray(resample(values, len(values) * every), dtype=np.float64) if every > 1 else values
