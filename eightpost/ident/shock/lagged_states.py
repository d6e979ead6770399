"""States of the law `hysteresis` over whole records: the lagged velocity and the travel of the stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from math import exp, expm1, inf
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.knots import KnotBasis
from eightpost.ident.shock.runs import Runs
from eightpost.shock.compiled import compiled_loop
from eightpost.shock.law import MOST_PIECES, STRAIGHT

#: Change of a logarithm for derivatives by differences.
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class States:
    """States over all N samples of runs, as a function of their parameters.

    Attributes:
        runs: Records.
        basis: Basis of the curve, whose range determines the nodes of ln tau.
        parameters: ln tau at the nodes (3,), then ln of yield travel and time constant if there is a stop.
        is_fine: Whether intervals with a large change of velocity are divided, as in the law.
    """

    runs: Runs
    basis: KnotBasis
    parameters: Array
    is_fine: bool = True

    @cached_property
    def velocity(self) -> Array:
        """Lagged velocity u (N,) [m/s]."""
        return self._lagged(self.parameters[:3])

    def columns(self) -> Array:
        """Return the columns (N, K) of f1, and that of the stop if there is one: their weights are forces [N]."""
        found = self.basis.design(self.velocity) / self.basis.speed
        return np.column_stack([found, self._travel(self.parameters[3:])]) if self.parameters.size > 3 else found

    def derivatives(self, slopes: Array, stop: Array) -> Array:
        """Return the derivatives of the force (N, s) [N] by the parameters.

        Args:
            slopes: Slopes (K,) of f1 times the highest speed of the basis [N].
            stop: Force of the stop at its yield travel (1,) [N]; (0,) without a stop.
        """
        steps = _STEP * np.eye(self.parameters.size)
        slope = np.interp(self.velocity, self.basis.knots, slopes / self.basis.speed)
        lagged = [slope * (self._lagged(self.parameters[:3] + step[:3]) - self.velocity) for step in steps[:3]]
        taken = [self._travel(self.parameters[3:] + step[3:]) for step in steps[3:]]
        stopped = [stop * (travel - self._travel(self.parameters[3:])) for travel in taken]
        return np.array([*lagged, *stopped]).T / _STEP

    def _lagged(self, logarithms: Array) -> Array:
        nodes = (0.5 * self.basis.knots[0], 0.0, 0.5 * self.basis.knots[-1])
        return np.concatenate(
            [_lagged_velocity(v, step, logarithms, nodes, is_fine=self.is_fine) for v, step in self._motions]
        )

    def _travel(self, logarithms: Array) -> Array:
        """Return the travel of the stop over its yield travel (N,) [1]."""
        limit, time_constant = np.exp(logarithms).tolist()
        return np.concatenate([_stop_travel(v, step, limit, time_constant) for v, step in self._motions]) / limit

    @property
    def _motions(self) -> list[tuple[Array, float]]:
        pairs = zip(self.runs.prepared, self.runs.parts, strict=True)
        return [(np.ascontiguousarray(self.runs.velocity[part]), p.step) for p, part in pairs]


# ---- One record -----------------------------------------------------------------------------------------------------


def _lagged_velocity(
    velocity: Array, step: float, logarithms: Array, nodes: tuple[float, ...], *, is_fine: bool
) -> Array:
    """Return the lagged velocity (N,) [m/s] of a record; it starts at the velocity.

    Args:
        velocity: Damper velocity (N,) [m/s].
        step: Sampling interval [s].
        logarithms: ln tau at the nodes (3,), tau in s.
        nodes: Lagged velocities (3,) [m/s] between which ln tau is linear.
        is_fine: Whether intervals with a large change of velocity are divided, as in the law.
    """
    lagged = np.empty(velocity.size)
    straight = STRAIGHT if is_fine else inf
    _lagged_velocity_loop()(velocity, step, tuple(logarithms.tolist()), nodes, straight, lagged)
    return lagged


def _stop_travel(velocity: Array, step: float, yield_travel: float, time_constant: float) -> Array:
    """Return the travel (N,) [m] of a stop over a record with velocities (N,) [m/s]; it starts in equilibrium.

    Args:
        velocity: Damper velocity (N,) [m/s].
        step: Sampling interval [s].
        yield_travel: Travel beyond which the stop creeps [m].
        time_constant: Time constant of the creep [s].
    """
    travel = np.empty(velocity.size)
    _stop_travel_loop()(velocity, step, yield_travel, time_constant, travel)
    return travel


@cache
def _lagged_velocity_loop() -> Callable[..., None]:
    def loop(velocity: Any, step: Any, logarithms: Any, nodes: Any, straight: Any, lagged: Any) -> None:
        u = velocity[0]
        lagged[0] = u
        for n in range(1, velocity.size):
            start, end = velocity[n - 1], velocity[n]
            count = min(int(abs(end - start) / straight) + 1, MOST_PIECES)
            for k in range(count):
                a, b = start + (end - start) * (k / count), start + (end - start) * ((k + 1) / count)
                h, after = step / count, u
                for _ in range(2):
                    middle = 0.5 * (u + after)
                    if middle <= nodes[0]:
                        level = logarithms[0]
                    elif middle >= nodes[2]:
                        level = logarithms[2]
                    elif middle < nodes[1]:
                        share = (middle - nodes[0]) / (nodes[1] - nodes[0])
                        level = logarithms[0] + share * (logarithms[1] - logarithms[0])
                    else:
                        share = (middle - nodes[1]) / (nodes[2] - nodes[1])
                        level = logarithms[1] + share * (logarithms[2] - logarithms[1])
                    ratio = h / exp(level)
                    rise = -expm1(-ratio)
                    after = u + (a - u) * rise + (b - a) * (1.0 - rise / ratio)
                u = after
            lagged[n] = u

    return compiled_loop(loop)


@cache
def _stop_travel_loop() -> Callable[..., None]:
    def loop(velocity: Any, step: Any, limit: Any, time_constant: Any, travel: Any) -> None:
        kept = exp(-step / time_constant)
        e = 0.0
        if velocity[0] > 0.0:
            e = limit + velocity[0] * time_constant
        elif velocity[0] < 0.0:
            e = -limit + velocity[0] * time_constant
        travel[0] = e
        for n in range(1, velocity.size):
            e += 0.5 * step * (velocity[n - 1] + velocity[n])
            if e > limit:
                e = limit + (e - limit) * kept
            elif e < -limit:
                e = -limit + (e + limit) * kept
            travel[n] = e

    return compiled_loop(loop)
