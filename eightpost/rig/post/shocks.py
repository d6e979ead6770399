"""Shocks of the car on the virtual rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.truth_damper import TruthDamper, ValveSide
from eightpost.shock.law import ShockLaw

# ---- Physical dampers on the virtual rig ----------------------------------------------------------------------------

#: The L-stable second-order method ROS2.
_GAMMA = 1.0 + math.sqrt(0.5)


class PhysicalBank:
    """K ports with the same physical damper; each has its own chamber levels and gas volume."""

    def __init__(self, damper: PhysicalDamper, ports: int) -> None:
        """Initialise every damper at rest at mid-travel."""
        self._damper, self._ports = damper, ports
        self._states = np.array([damper._rest(0.0)] * ports)
        self._places, self._drag = np.zeros(ports), np.zeros(ports)
        self._now = (0.0, 0.0)
        self._rates = damper.plant.rates(self._motion)
        self._jacobian = damper.plant.jacobian(self._motion)

    def _motion(self, t: float) -> tuple[float, float]:
        return self._now

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        """Return the forces (K,) [N] after a step; see `Bank.advance` for the arguments."""
        for k in range(self._ports):
            self._now = (float(displacement[k]), 0.5 * (float(before[k]) + float(after[k])))
            self._states[k] = self._step(self._states[k], step)
        self._update_drag(displacement)
        return self._force()

    def _step(self, states: Array, step: float) -> Array:
        """Return the states after a step at a constant velocity."""
        matrix = np.eye(3) - step * _GAMMA * np.array(self._jacobian(states, 0.0))
        first = np.linalg.solve(matrix, np.array(self._rates(states, 0.0)))
        second = np.array(self._rates(states + step * first, 0.0)) - 2.0 * first
        return np.asarray(states + step * (1.5 * first + 0.5 * np.linalg.solve(matrix, second)))

    def _update_drag(self, displacement: Array) -> None:
        """Update the Dahl friction of the seals to new displacements (K,) [m]."""
        seals, moved = self._damper.seals, displacement - self._places
        end = np.copysign(seals.drag, moved)
        self._drag = end + (self._drag - end) * np.exp(-np.abs(moved) / seals.length)
        self._places = displacement

    def _force(self) -> Array:
        damper = self._damper
        fluid, cylinder = damper.fluid, damper.cylinder
        pressures = fluid.vapour_pressure + fluid.span * np.exp(self._states[:, :2])
        ends = pressures[:, 0] * cylinder.compression_area - pressures[:, 1] * cylinder.rebound_area
        return np.asarray(ends + damper.plant.force(0.0, 0.0) + self._drag)


# ---- Shocks on the virtual rig --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinearDamper:
    """Linear damper F = c v.

    Attributes:
        damping: Damping c [N.s/m].
    """

    damping: float


Shock = LinearDamper | ShockLaw | TruthDamper | PhysicalDamper


class Bank(Protocol):
    """Interface of K ports with the same shock and with their states."""

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        """Return the forces (K,) [N] after a step [s].

        Args:
            before: Port velocities (K,) at the start of the step [m/s].
            after: Port velocities (K,) at the end of the step [m/s]; the velocity is linear in between.
            displacement: Port displacements (K,) at the end of the step [m].
            step: Duration of the step [s].
        """
        ...


class _LinearBank:
    def __init__(self, damper: LinearDamper) -> None:
        self._damping = damper.damping

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        return self._damping * after


class _LawBank:
    """Bank for any law, which calls the methods `advance` and `response` of the law for each port."""

    def __init__(self, law: ShockLaw, ports: int) -> None:
        self._law, self._lagged = law, [0.0] * ports

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        starts, ends = before.tolist(), after.tolist()
        law = self._law
        self._lagged = [law.advance(f, v, w, step) for f, v, w in zip(self._lagged, starts, ends, strict=True)]
        outputs = zip(self._lagged, ends, displacement.tolist(), strict=True)
        return np.array([law.response(f, w, x).force for f, w, x in outputs])


class _FluidBank:
    """Bank for demonstration dampers: dF/dt = k0 (1 + |F| / F1) (v - g(F)) with an exponential Rosenbrock step."""

    def __init__(self, damper: TruthDamper, ports: int) -> None:
        self._damper, self._valve = damper, np.zeros(ports)

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        damper, force = self._damper, self._valve
        flow, slope = self._flow(force)
        stiffness = damper.fluid_stiffness * (1.0 + np.abs(force) / damper.stiffening_force)
        rate = stiffness * (0.5 * (before + after) - flow)
        decay = step * stiffness * slope
        self._valve = force + step * rate * -np.expm1(-decay) / decay
        gas = damper.gas_stiffness * displacement + damper.gas_preload
        return np.asarray(self._valve + gas + damper.seal_drag * np.tanh(after / damper.seal_velocity))

    def _flow(self, force: Array) -> tuple[Array, Array]:
        """Return the flow velocity g(F) (K,) and its slope (K,)."""
        sides = [_side_flow(side, np.abs(force)) for side in (self._damper.compression, self._damper.rebound)]
        pushed = force >= 0.0
        flow = np.where(pushed, sides[0][0], -sides[1][0])
        return flow, np.where(pushed, sides[0][1], sides[1][1])


def _side_flow(side: ValveSide, force: Array) -> tuple[Array, Array]:
    root = np.sqrt(side.bleed_linear**2 + 4.0 * side.bleed_square * force)
    level = (force - side.opening_force) / side.opening_width
    rest = np.logaddexp(0.0, -side.opening_force / side.opening_width)
    flow = 2.0 * force / (root + side.bleed_linear)
    flow = flow + side.opening_width / side.open_damping * (np.logaddexp(0.0, level) - rest)
    return flow, 1.0 / root + 0.5 * (1.0 + np.tanh(0.5 * level)) / side.open_damping


def _bank(shock: Shock, ports: int) -> Bank:
    if isinstance(shock, LinearDamper):
        return _LinearBank(shock)
    if isinstance(shock, ShockLaw):
        return _LawBank(shock, ports)
    if isinstance(shock, TruthDamper):
        return _FluidBank(shock, ports)
    if isinstance(shock, PhysicalDamper):
        return PhysicalBank(shock, ports)
    raise ParameterError(f"the virtual rig does not support the shock {shock!r}")


class ShockSet:
    """Shocks of all corners and runs."""

    def __init__(self, shocks: Sequence[Sequence[Shock]]) -> None:
        """Group the ports by shock.

        Args:
            shocks: Shocks at the C corners for each of B runs.
        """
        ports: dict[int, tuple[Shock, list[int]]] = {}
        runs = len(shocks)
        for run, corners in enumerate(shocks):
            for corner, shock in enumerate(corners):
                ports.setdefault(id(shock), (shock, []))[1].append(corner * runs + run)
        self._groups = [(np.array(places), _bank(shock, len(places))) for shock, places in ports.values()]

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        """Return the forces (C, B) [N] after a step; see `Bank.advance` for the arguments, here with shape (C, B)."""
        forces = np.empty_like(after)
        flat = forces.reshape(-1)
        for places, bank in self._groups:
            flat[places] = bank.advance(
                before.reshape(-1)[places], after.reshape(-1)[places], displacement.reshape(-1)[places], step
            )
        return forces
