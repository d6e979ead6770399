"""Vehicle of the file format from a grey-box car: a linear model about the mean of the tests, and friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.ident.vehicle.grey_box.car import BREAKAWAY, STEP_RATE, STRIBECK, WHEEL, matrices, output_rows
from eightpost.ident.vehicle.grey_box.kernel import bristle_forces
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, StateSpace
from eightpost.vehicle.statespace import Channel

#: Cut-off of the lag that makes the road's velocity, which tire dampers need, a proper input [rad/s].
_LAG = 2.0 * np.pi * 500.0

#: Friction velocities that are tried [m/s], and the duration of the record for it [s].
_VELOCITIES, _SECONDS = (0.001, 0.002, 0.003, 0.006, 0.012, 0.024, 0.048), 30.0

#: Units of outputs and loads by quantity.
_UNITS = {
    "velocity": "m/s", "displacement": "m", "tire_force": "N", "ride_height": "m",
    "roll_moment": "N.m", "pitch_moment": "N.m", "road": "m",
}  # fmt: skip


def linear_model(p: Mapping[str, float], experiment: Experiment) -> StateSpace:
    """Return the linear model with the baseline damping for parameters by name; its inputs are F - c v.

    States are 8 coordinates, their velocities and 4 lagged roads.
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
    A, B = np.zeros((20, 20)), np.zeros((20, inputs))
    A[:8, 8:16] = eight
    A[8:16, :8], A[8:16, 8:16] = -inverse @ stiffness, -inverse @ damping
    A[8:16, 16:], A[16:, 16:] = -_LAG * inverse @ WHEEL.T @ damper, -_LAG * np.eye(4)
    B[8:16, roads] = inverse @ WHEEL.T @ (tire + _LAG * damper)
    B[16:, roads] = _LAG * np.eye(4)
    B[8:16, others] = inverse @ m.load.T
    B[8:16, len(experiment.rig) :] = -inverse @ m.shock.T
    position, velocity, acceleration, road = output_rows(p, m, experiment.outputs)
    C = np.hstack([position, velocity, np.zeros((len(position), 4))]) + acceleration @ A[8:16]
    D = acceleration @ B[8:16]
    D[:, roads] += road
    for k, name in enumerate(experiment.outputs):
        if quantity(name) == "tire_force":
            c = CORNERS.index(name.rpartition(".")[0])
            C[k] = np.concatenate([-tire[c, c] * WHEEL[c], -damper[c, c] * WHEEL[c], -_LAG * damper[c]])
            D[k, roads[c]] = tire[c, c] + _LAG * damper[c, c]
    channels, outputs = (tuple(Channel(n, _unit(n)) for n in ns) for ns in (experiment.inputs, experiment.outputs))
    return StateSpace(A, B, C, D, channels, outputs, name=experiment.name)


def _unit(name: str) -> str:
    kind = quantity(name)
    return _UNITS.get(kind, "m/s2" if kind.endswith("acceleration") else "N")


def port_friction(p: Mapping[str, float], test: TimeSeries, ports: Sequence[str]) -> dict[str, Friction]:
    """Return the file format's friction `F_f tanh(v / v_f)` that comes closest to the bristles in a test.

    The format has no sticking friction; the difference is a limit of the vehicle file, not of the fit.
    """
    every = max(1, round(STEP_RATE / test.sample_rate))
    count = min(len(test), round(_SECONDS * test.sample_rate))
    best: tuple[float, dict[str, Friction]] = (np.inf, {})
    fine = {c: np.asarray(resample(test[channel(c, "velocity")][:count], count * every)) for c in ports}
    forces = {c: _bristle_force(p, c, fine[c], test.sample_rate * every) for c in ports}
    for width in _VELOCITIES:
        laws, left = {}, 0.0
        for c in ports:
            shape = np.tanh(fine[c] / width)
            size = max(float(shape @ forces[c]) / max(float(shape @ shape), 1e-300), 0.0)
            left += float(np.sum((forces[c] - size * shape) ** 2)) / max(float(np.sum(forces[c] ** 2)), 1e-300)
            laws[c] = Friction(size, width)
        if left < best[0]:
            best = left, laws
    return best[1]


def _bristle_force(p: Mapping[str, float], corner: str, velocity: Array, rate: float) -> Array:
    law = np.array([p[f"{corner}.friction"], BREAKAWAY, p["friction_reach"], STRIBECK])
    return np.asarray(bristle_forces(velocity, law, 1.0 / rate))
