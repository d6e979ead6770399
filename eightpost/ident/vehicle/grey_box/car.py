"""The grey-box family of cars: heave, pitch, two roll angles, four hubs; solid or independent axles.

The coordinates are heights: of the chassis above the front and the rear axle, half the differences of its left and
right heights there, and the four hubs. Masses are those of heights [kg], so no length of the car needs to be known. An
axle's hubs may be coupled by inertia (a solid axle), and the shocks and springs may be inboard: each then moves with
both hubs of its axle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError
from eightpost.ident.output_error import Parameter, ParameterTable
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.ident.vehicle.grey_box.kernel import Numbers, march
from eightpost.vehicle import Bristle

#: Integration steps per second, at least [Hz].
STEP_RATE = 1250.0

#: Number of states: coordinates, velocities, accelerations, bristles, accelerations one step before.
_STATES = 36

#: Friction of the family, of which force and reach are fitted: Stribeck velocity [m/s], static over sliding force.
BRISTLE = Bristle(static_ratio=1.15, stribeck_velocity=0.01)

#: Parameters that the base fit leaves at their start values.
OPTIONAL = (
    *(f"{c}.spring_progression" for c in CORNERS),
    *(f"{c}.tire_stiffening" for c in CORNERS),
)

#: Loads that the family can have.
_AERO = tuple(f"{corner}.aero" for corner in CORNERS)
_MODAL = ("heave_force", "roll_moment", "pitch_moment")


def declared(starts: Mapping[str, float], rig: Sequence[str]) -> ParameterTable:
    """Return the parameters of the family.

    Args:
        starts: Start values by parameter; those missing have typical values.
        rig: Inputs of the rig; they decide the parameters of the loads.
    """
    rows = [
        *(_positive(f"front.mass {kind}", "kg", 600.0) for kind in ("heave", "roll")),
        *(_positive(f"rear.mass {kind}", "kg", 600.0) for kind in ("heave", "roll")),
        Parameter("mass coupling heave", "kg", 0.0, -3000.0, 3000.0, size=100.0),
        _positive("twist_stiffness", "N/m", 1e6, 1e3),
        _positive("twist_damping", "N.s/m", 1e3, 1.0),
        Parameter("front.bar", "N/m", 0.0, -1e6, 1e6, size=2e4),
        *(Parameter(f"{axle}.mass coupling", "kg", 0.0, -200.0, 200.0, size=10.0) for axle in ("front", "rear")),
        *(Parameter(f"{axle}.shock_share", "1", 0.0, -0.6, 0.6, size=0.1) for axle in ("front", "rear")),
        Parameter("rear.spring_share", "1", 0.0, -0.6, 0.6, size=0.1),
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
            Parameter(f"{c}.spring_progression", "1/m", 0.0, -20.0, 20.0, size=1.0),
            Parameter(f"{c}.tire_stiffening", "1/m", 0.0, -50.0, 50.0, size=5.0),
        ]
    places = {"front": 1.0, "rear": 0.0}
    if _AERO[0] in rig:
        for axle, place in places.items():
            rows.append(Parameter(f"{axle}.aero_place", "1", place, -2.0, 3.0, size=0.2))
            rows.append(Parameter(f"{axle}.aero_spread", "1", 0.7, 0.0, 3.0, size=0.2))
    else:
        rows.append(Parameter("heave_share", "1", 0.5, -1.0, 2.0, size=0.1))
        rows.append(Parameter("pitch_arm", "1/m", 0.35, 0.0, 3.0, size=0.1))
        rows += [Parameter(f"{axle}.roll_arm", "1/m", 0.6, -1.0, 5.0, size=0.1) for axle in places]
    rows += [Parameter(f"{axle}.overhang", "1", 0.4, -1.0, 2.0, size=0.1) for axle in places]
    rows += [
        Parameter("driver_place", "1", 0.3, -1.0, 2.0, size=0.1),
        Parameter("driver_spread", "1", 0.2, -2.0, 2.0, size=0.1),
    ]
    return ParameterTable(tuple(_started(row, starts) for row in rows))


def _positive(name: str, unit: str, start: float, low: float | None = None, high: float | None = None) -> Parameter:
    low, high = start / 100.0 if low is None else low, start * 100.0 if high is None else high
    return Parameter(name, unit, start, low, high, "logarithmic")


def _started(row: Parameter, starts: Mapping[str, float]) -> Parameter:
    value = float(np.clip(starts.get(row.name, row.start), row.low, row.high))
    return Parameter(row.name, row.unit, value, row.low, row.high, row.scale, row.size, row.prior, row.fixed)


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
    if _AERO[0] in rig:
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


class GreyBoxCar:
    """Model of the family for the output-error engine: inputs are roads, loads and port forces minus c v.

    Args:
        experiment: Inputs, outputs and baseline damping of the tests.
        names: Names of the parameters in the order of the values.
        static: Static tire loads (4,) [N]; infinite where they are not known, which excludes lift-off.

    Raises:
        InputError: The experiment is not that of a car with four corners.
    """

    state_sizes = np.concatenate(
        [np.full(8, 0.01), np.full(8, 0.3), np.full(8, 10.0), np.full(4, 1e-4), np.full(8, 10.0)]
    )

    def __init__(self, experiment: Experiment, names: Sequence[str], static: Array) -> None:
        if experiment.ports != CORNERS:
            raise InputError(f"{experiment.name}: the recipe grey-box needs the corners {', '.join(CORNERS)}")
        self._experiment, self._names, self._static = experiment, tuple(names), static
        self._baseline = np.array([experiment.baseline_damping[c] for c in CORNERS])

    def start(self, values: Array) -> Array:
        """Return the states at rest (K, 36)."""
        return np.zeros((len(values), _STATES))

    def run(self, values: Array, states: Array, inputs: Array, rate: float) -> tuple[Array, Array]:
        """Simulate a record; arguments, shapes and results are those of `eightpost.ident.output_error.Model.run`."""
        every = max(1, int(np.ceil(STEP_RATE / rate - 1e-9)))
        drive = _finer(inputs, rate, every)
        outputs = np.empty((len(values), len(inputs) - 1, len(self._experiment.outputs)))
        ends = np.array(states, dtype=np.float64)
        march(self.numbers(values), drive, 1.0 / (rate * every), every, ends, outputs)
        return outputs, ends

    def numbers(self, values: Array) -> Numbers:
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


def _finer(inputs: Array, rate: float, every: int) -> Array:
    """Return roads, road velocities, loads and port forces (N every + 1, 12 + A), interpolated without aliases.

    The road velocity is the derivative of the interpolated road: differences between samples would be too small at high
    frequencies.
    """
    count = len(inputs) - 1
    rise = (inputs[count - 1] - inputs[0]) / max(count - 1, 1)
    waves = inputs[:count] - inputs[0] - np.arange(count)[:, None] * rise
    spectra = np.fft.rfft(waves[:, :4], axis=0)
    turns = 2j * np.pi * np.fft.rfftfreq(count, 1.0 / rate)[:, None]
    slopes = _resampled(np.fft.irfft(turns * spectra, count, axis=0), every) + rise[:4] * rate
    fine = _resampled(waves, every) + inputs[0] + np.arange(count * every)[:, None] / every * rise
    whole = np.hstack([fine[:, :4], slopes, fine[:, 4:]])
    return np.ascontiguousarray(np.vstack([whole, whole[-1:]]))


def _resampled(values: Array, every: int) -> Array:
    return np.asarray(resample(values, len(values) * every), dtype=np.float64) if every > 1 else values
