"""Simulation of the grey-box car for many sets of parameters, in compiled steps.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h (3/2 a - 1/2 a-)),  v+ = v + h/2 (a + a+)

with the acceleration a- one step before. The step is of second order and needs one evaluation of the forces. The
velocity that it predicts is of third order: a predictor v + h a would act like additional damping. The bristle of the
friction is exact for the mean velocity of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from typing import Any, NamedTuple, cast

import numpy as np
from numba import njit
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.corners import CORNERS, channel
from eightpost.errors import InputError
from eightpost.ident.grey_box.family import WHEEL, bristle_of, matrices, output_rows
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after

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
                forces[8 + c] = _tire(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - guess[4 + c])
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
        tires[c] = _tire(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - v[4 + c])
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
def _tire(tire: Array, deflection: float, rate: float) -> float:
    force = tire[0] * deflection * (1.0 + tire[2] * deflection) + tire[1] * rate
    return float(max(force, -tire[3]))


class GreyBoxCar:
    """Model of the family for the output-error engine: inputs are roads, loads and port forces minus c v.

    Args:
        experiment: Inputs, outputs and baseline damping of the tests.
        names: Names of the parameters in the order of the values.
        static: Static tire loads (4,) [N]; infinite where they are not known, which excludes lift-off.

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
