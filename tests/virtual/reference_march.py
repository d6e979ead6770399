"""Integration of the virtual rig in numpy, with the same steps as the compiled one: the reference of its tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from eightpost.array_types import Array
from eightpost.shock import ShockLaw
from eightpost.virtual import Car, Friction, LinearDamper, Motion, PhysicalDamper, Run, Shock, Springs, Tires
from eightpost.virtual.drivefiles import LEAD, RATE, STEPS
from eightpost.virtual.shocks import TruthDamper, ValveSide
from eightpost.virtual.simulate import Drives, _inputs, _motion

# ---- Shocks ---------------------------------------------------------------------------------------------------------

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
        self._law, self._states = law, [law.start(0.0)] * ports

    def advance(self, before: Array, after: Array, displacement: Array, step: float) -> Array:
        starts, ends = before.tolist(), after.tolist()
        law = self._law
        self._states = [law.advance(s, v, w, step) for s, v, w in zip(self._states, starts, ends, strict=True)]
        outputs = zip(self._states, ends, displacement.tolist(), strict=True)
        return np.array([law.response(s, w, x).force for s, w, x in outputs])


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
    return PhysicalBank(shock, ports)


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


# ---- Springs, tires and friction ------------------------------------------------------------------------------------


def spring_force(springs: Springs, compression: Array) -> Array:
    """Return the change of the springs' force from static (C, B) [N] at a compression (C, B) [m]."""
    spring = springs.rate * compression * (1.0 + springs.progression * compression)
    into = np.maximum(compression - springs.stop_gap, 0.0)
    return np.asarray(spring + springs.stop_rate * into * into)


def tire_force(tires: Tires, deflection: Array, speed: Array) -> Array:
    """Return the change of the tire force from static (C, B) [N], with the minimum -W."""
    return np.asarray(np.maximum(tires.stiffness * deflection + tires.damping * speed, -tires.static_load))


def bend(friction: Friction, before: Array, velocity: Array, step: float) -> Array:
    """Return the exact bristle deflection z (C, B) [m] after `step` [s] at a constant velocity (C, B) [m/s]."""
    speed = np.abs(velocity)
    ratio = velocity / friction.stribeck_velocity
    level = friction.coulomb + (friction.breakaway - friction.coulomb) * np.exp(-ratio * ratio)
    reach = np.maximum(level, 1e-9) / friction.stiffness
    steady = np.sign(velocity) * reach
    after = steady + (before - steady) * np.exp(-speed * step / reach)
    return np.asarray(np.where(speed > 1e-12, after, before))


# ---- Integration ----------------------------------------------------------------------------------------------------


def reference_motions(car: Car, runs: Sequence[Run], *, lead: float = LEAD, steps: int = STEPS) -> list[Motion]:
    """Return the motion of the car in every run; see `simulate` for the arguments."""
    inputs = [_inputs(car, run.drive) for run in runs]
    records = reference_march(car, [run.shocks for run in runs], Drives(inputs, round(lead * RATE), steps))
    return [_motion(car, *own) for own in zip(runs, inputs, records, strict=True)]


def reference_march(car: Car, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run: q, q', q'', shock, friction and tire forces.

    Args:
        car: Car to simulate.
        shocks: Shocks at the corners for each run.
        drives: Drives of the runs.
    """
    runs, steps, samples = len(drives.values), drives.weights.shape[1], max(map(len, drives.values))
    stepper = _Stepper(car, ShockSet(shocks), 1.0 / (RATE * steps), runs)
    records = np.empty((samples, 3 * car.mass.size + 3 * len(car.corners), runs))
    for sample in range(-drives.lead, samples):
        if sample >= 0:
            records[sample] = stepper.record()
        values, slopes = _between(drives, sample)
        for k in range(steps):
            stepper.step(values[k], slopes[k])
    return [records[: len(values), :, i] for i, values in enumerate(drives.values)]


class _Stepper:
    """States of all runs, and their integration by one step."""

    def __init__(self, car: Car, shocks: ShockSet, step: float, runs: int) -> None:
        self._car, self._shocks, self._step = car, shocks, step
        dofs, corners = car.mass.size, len(car.corners)
        self._corners = corners
        self.q, self.v, self.a = (np.zeros((dofs, runs)) for _ in range(3))
        self._speed, self._bend = np.zeros((corners, runs)), np.zeros((corners, runs))
        self._shock_force, self._friction, self._tire = (np.zeros((corners, runs)) for _ in range(3))
        self._ports = np.vstack([car.shock, car.wheel, car.spring])
        inverse = (1.0 / car.mass)[:, None]
        self._push = inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])
        self._stiffness, self._damping = -inverse * car.stiffness, -inverse * car.damping
        self._linear = bool(np.any(car.stiffness) or np.any(car.damping))

    def record(self) -> Array:
        """Return q, v, a, shock, friction and tire forces, stacked (3 D + 3 C, B)."""
        return np.vstack([self.q, self.v, self.a, self._shock_force, self._friction, self._tire])

    def step(self, drive: Array, slope: Array) -> None:
        """Advance by one step, at whose end the inputs are `drive` (U, B) with the slope `slope` (U, B) [1/s]."""
        h, car, n = self._step, self._car, self._corners
        self.q = self.q + h * (self.v + (0.5 * h) * self.a)
        guess = self.v + h * self.a
        places, speeds = self._ports @ self.q, self._ports @ guess
        speed = speeds[:n]
        self._shock_force = self._shocks.advance(self._speed, speed, places[:n], h)
        self._bend = bend(car.friction, self._bend, 0.5 * (self._speed + speed), h)
        self._friction = car.friction.stiffness * self._bend
        self._tire = tire_force(car.tires, drive[:n] - places[n : 2 * n], slope[:n] - speeds[n : 2 * n])
        spring = spring_force(car.springs, places[2 * n :])
        forces = np.vstack([self._shock_force + self._friction, self._tire, spring, drive[n:]])
        a = self._push @ forces
        if self._linear:
            a = a + self._stiffness @ self.q + self._damping @ guess
        self.v = self.v + (0.5 * h) * (self.a + a)
        self.a, self._speed = a, self._ports[:n] @ self.v


def _between(drives: Drives, sample: int) -> tuple[Array, Array]:
    """Return values and slopes [1/s] (S, U, B) of all runs after each step from `sample` to the next."""
    knots = np.stack([*_at(drives, sample), *_at(drives, sample + 1)])  # (4, B, U)
    values, slopes = (np.einsum("sk,kbu->sub", weights, knots) for weights in drives.weights)
    return values, slopes * RATE


def _at(drives: Drives, sample: int) -> tuple[Array, Array]:
    """Return the values and slopes per sample (B, U) of every run at a sample."""
    growth, rise = drives.growth[sample + drives.lead]
    places = [min(max(sample, 0), len(rows) - 1) for rows in drives.values]
    values = np.stack([rows[place] for rows, place in zip(drives.values, places, strict=True)])
    slopes = np.stack([rows[p] * float(p == sample) for rows, p in zip(drives.slopes, places, strict=True)])
    return values * growth, slopes * growth + values * rise
