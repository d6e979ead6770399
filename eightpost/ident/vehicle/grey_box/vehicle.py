"""Vehicle of the file format from a grey-box car: a linear model about the mean of the tests, and laws of its ports."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eightpost.corners import CORNERS, channel
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.ident.vehicle.grey_box.car import WHEEL, bristle_of, matrices, output_rows
from eightpost.vehicle import Friction, StateSpace
from eightpost.vehicle.statespace import Channel

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
    direct, gains = _road_velocity()
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


def _road_velocity() -> tuple[float, tuple[float, float]]:
    """Return the filter of `_RATES` as direct term and gains [1/s] of both lags 1 / (1 + s/L)."""
    a, b = (1.0 / rate for rate in _RATES)
    return (a + b) / (a * b), (b / (a * (a - b)), a / (b * (b - a)))


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
