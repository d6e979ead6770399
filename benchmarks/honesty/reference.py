"""Reference solution of a run: each vehicle with its shocks as one set of differential equations.

Vehicles of one system are not connected with each other, so each is solved separately (benchmarks/honesty/kernel.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.honesty import kernel
from benchmarks.honesty.cars import vehicle
from benchmarks.honesty.cases import Case, DrawnBristle, DrawnCar
from benchmarks.honesty.shocks import LAWS, DrawnShock
from eightpost.vehicle import StateSpace

Array = NDArray[np.float64]

#: Typical sizes of a displacement [m], a velocity [m/s], a lagged force [N] and a bristle's deflection [m].
_SIZES = (1e-3, 1e-1, 1e2, 1e-4)
#: Most steps of the search for the state at rest, and the last relative change.
_MOST_NEWTON_STEPS, _AT_REST = 50, 1e-13
#: Maximum number of integration steps for each vehicle.
_MOST_STEPS = 10_000_000


@dataclass(frozen=True)
class Answer:
    """Solution of a system at `time` (N,) [s]."""

    time: Array  #: Time since the start of the run [s].
    values: Array  #: Channels by time (C, N), SI.
    names: tuple[str, ...]  #: Names of the channels (C,), as in the product.
    units: tuple[str, ...]  #: SI units of the channels (C,).
    steps: int  #: Number of integration steps, for all vehicles.


class UnsolvedError(RuntimeError):
    """Error for a reference whose step became too small."""


def solve(case: Case, times: Array, tolerance: float) -> Answer:
    """Return the solution of a case at times (N,) [s] of the run.

    Args:
        case: System and scenario.
        times: Times in order, from 0.
        tolerance: Allowed error of a step, relative to the typical size of each state [1].

    Raises:
        UnsolvedError: The integration does not reach the end.
    """
    values, names, units, steps = [], [], [], 0
    for car in case.cars:
        equations = _Equations(case, car)
        found, made = equations.solve(times, tolerance)
        values.append(found)
        names += equations.names
        units += equations.units
        steps += made
    return Answer(times, np.vstack(values), tuple(names), tuple(units), steps)


def shock_numbers(shock: DrawnShock, friction: tuple[float, float], bristle: DrawnBristle) -> Array:
    """Return the kernel's parameters of a shock, and of the friction and the spring at its port (COLUMNS,)."""
    port, curve, own = shock.port, shock.curve, shock.own
    return np.array(
        [
            LAWS.index(shock.law),
            *(port.motion_ratio, port.compression_scale, port.rebound_scale),
            *(port.gas_stiffness, port.gas_preload, port.seal_friction, port.friction_velocity),
            *(own.get("time_constant", 0.0), own.get("lag_full_force", 0.0), own.get("lag_zero_force", 1.0)),
            *(curve.transition_speed, curve.transition_width, curve.compression_speed, curve.rebound_speed),
            *(curve.compression_slope, curve.rebound_slope),
            *friction,
            *(bristle.force, bristle.reach, bristle.static_ratio, bristle.stribeck_velocity, bristle.spring),
            *(*curve.inner, *curve.compression, *curve.rebound),
        ]
    )


class _Equations:
    """One vehicle with its shocks, q'' = A_q q + G F + b(t)."""

    def __init__(self, case: Case, car: DrawnCar) -> None:
        self._case, self._car = case, car
        self._model = model = vehicle(car.model).coupled()
        self._ports = tuple(car.shocks)
        count = len(model.A) // 2
        assert not model.A[:count, :count].any() and not model.A[count:, count:].any()
        self._stiffness = np.ascontiguousarray(model.A[count:, :count])
        self._forces = [model.input_names.index(self._named(port, "force")) for port in self._ports]
        self._driven = [k for k in range(len(model.inputs)) if k not in self._forces]
        self._mobility = np.ascontiguousarray(model.B[count:, self._forces])
        rows = [model.output_names.index(self._named(port, "displacement")) for port in self._ports]
        self._strut = np.ascontiguousarray(model.C[rows, :count])
        self._shocks = np.array(
            [
                shock_numbers(shock, car.friction.get(port, (0.0, 1.0)), car.bristles.get(port, DrawnBristle()))
                for port, shock in car.shocks.items()
            ]
        )

    @property
    def names(self) -> list[str]:
        """Names of the vehicle's outputs, followed by the shocks' forces."""
        own = [f"{self._car.name}.{name}" for name in self._model.output_names]
        return own + [f"{self._car.shock_name(port)}.force" for port in self._ports]

    @property
    def units(self) -> list[str]:
        """Units of these channels."""
        return [channel.unit for channel in self._model.outputs] + ["N"] * len(self._ports)

    def solve(self, times: Array, tolerance: float) -> tuple[Array, int]:
        """Return the channels at the times (C, N), and the number of steps."""
        knots = np.union1d(times, self._own_points(float(times[-1])))
        drive = self._inputs(knots)
        count = len(self._stiffness)
        pushes = np.ascontiguousarray((self._model.B[count:, self._driven] @ drive).T)
        start = self._equilibrium(pushes[0])
        sizes = np.repeat(_SIZES, [count, count, len(self._ports), len(self._ports)])
        matrices = (self._stiffness, self._strut, self._mobility, self._shocks)
        states, made = kernel.integrate(knots, pushes, *matrices, start, sizes, tolerance, _MOST_STEPS)
        if made < 0 or not np.isfinite(states[-1]).all():
            raise UnsolvedError(
                f"seed {self._case.seed}: {self._car.name} has no solution at a tolerance of {tolerance:g}"
            )
        at = np.searchsorted(knots, times)
        return self._channels(states[at], drive[:, at]), made

    def _named(self, port: str, quantity: str) -> str:
        return f"{port}.{quantity}" if port else quantity

    def _own_points(self, end: float) -> Array:
        """Return the drive's own points within the run [s]."""
        scenario = self._case.scenario
        if scenario.drive is None:
            return np.zeros(0)
        own = scenario.drive.series.time - scenario.drive_start
        return np.asarray(own[(own > 0.0) & (own < end)])

    def _inputs(self, knots: Array) -> Array:
        """Return the inputs other than shock forces, at the knots (D, N)."""
        scenario, rows = self._case.scenario, []
        for k in self._driven:
            name = f"{self._car.name}.{self._model.input_names[k]}"
            if scenario.drive is None or name not in scenario.drive.names:
                rows.append(np.zeros_like(knots))
                continue
            series = scenario.drive.series
            rows.append(np.interp(knots + scenario.drive_start, series.time, series[name]))
        return np.array(rows)

    def _equilibrium(self, push: Array) -> Array:
        """Return the state at rest under the first inputs, with lagged forces and deflections of bristles 0.

        A_q q + G (r (F_0 + K r S q) + k2 (S q)^2) + b = 0
        """
        columns = (kernel.RATIO, kernel.GAS_RATE, kernel.GAS, kernel.SPRING)
        ratio, rate, gas, spring = (self._shocks[:, column] for column in columns)
        matrix = self._stiffness + self._mobility @ ((ratio**2 * rate)[:, None] * self._strut)
        q = np.linalg.solve(matrix, -push - self._mobility @ (ratio * gas))
        for _ in range(_MOST_NEWTON_STEPS if spring.any() else 0):
            x = self._strut @ q
            off = matrix @ q + self._mobility @ (ratio * gas + spring * x**2) + push
            slope = matrix + self._mobility @ ((2.0 * spring * x)[:, None] * self._strut)
            change = np.linalg.solve(slope, -off)
            q = q + change
            if np.abs(change).max() <= _AT_REST * (np.abs(q).max() + 1e-3):
                break
        else:
            if spring.any():
                raise UnsolvedError(f"seed {self._case.seed}: {self._car.name} has no state at rest")
        return np.concatenate([q, np.zeros(q.size + 2 * len(self._ports))])

    def _channels(self, states: Array, drive: Array) -> Array:
        """Return the outputs of the vehicle and the forces of the shocks (C, N)."""
        forces, frictions = kernel.port_forces(states, self._strut, self._shocks)
        model: StateSpace = self._model
        inputs = np.empty((len(model.inputs), len(states)))
        inputs[self._driven], inputs[self._forces] = drive, forces + frictions
        return np.vstack([model.C @ states[:, : len(model.A)].T + model.D @ inputs, forces])
