"""Integration of the virtual rig: velocity Verlet at a fixed step of 0.2 ms, all runs and their pieces side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError, StepError
from eightpost.rig.post.drive import Drives, Span, spans_of
from eightpost.rig.post.shocks import Shock, ShockSet
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.rig.post.car import Car

    Array = NDArray[np.float64]

#: Samples per second of the rig's records (6.1.5) [Hz], and steps of the integration per sample: 5 kHz.
RATE, STEPS = 1250.0, 4

#: Time before each record in which the car comes into motion [s]; cut off.
LEAD = 6.0


@dataclass(frozen=True, slots=True)
class Run:
    """What one run is made of.

    Attributes:
        drive: What the actuators really do, at `RATE`, with the car's `inputs` as channels.
        shocks: One per corner.
    """

    drive: TimeSeries
    shocks: tuple[Shock, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What a run's car really did; changes from the static state under gravity alone.

    Attributes:
        time: (N,) [s].
        drive: (U, N), roads and loads in the order of the car's inputs.
        position: q (D, N).
        velocity: (D, N).
        acceleration: (D, N).
        shock_force: (C, N) [N].
        friction_force: (C, N) [N].
        tire_force: (C, N), the change from static [N].
    """

    time: Array
    drive: Array
    position: Array
    velocity: Array
    acceleration: Array
    shock_force: Array
    friction_force: Array
    tire_force: Array


def simulate(car: Car, runs: Sequence[Run], *, piece: float | None = None, lead: float = LEAD) -> list[Motion]:
    """Return what the car does in every run.

    Each run starts at rest; during `lead` before the record its first samples' roads and loads are brought in and held.

    Args:
        car: The truth.
        runs: Drives and shocks.
        piece: Longer runs are computed in pieces of this length at once, each from rest with the drive of the `lead`
            before it [s]: what the car has forgotten by then must not matter, so not for static loading. None for none.
        lead: [s].

    Raises:
        ParameterError: A drive lacks an input or has another rate; a run has not one shock per corner.
        StepError: The motion grew beyond all bounds.
    """
    for run in runs:
        _check(car, run)
    spans = [span for k, run in enumerate(runs) for span in spans_of(k, run.drive.time.size, RATE, piece)]
    drives = Drives([_inputs(car, run.drive) for run in runs], spans, round(lead * RATE), STEPS)
    shocks = ShockSet([runs[span.run].shocks for span in spans])
    records = _march(car, shocks, drives)
    return [_motion(car, run, [(s, records[:, :, i]) for i, s in enumerate(spans) if s.run == k])
            for k, run in enumerate(runs)]  # fmt: skip


def _check(car: Car, run: Run) -> None:
    missing = [name for name in car.inputs if name not in run.drive]
    if missing:
        raise ParameterError(f"the drive lacks {', '.join(missing)}; the {car.name} has {', '.join(car.inputs)}")
    if run.drive.time.size < 2 or abs(run.drive.sample_rate - RATE) > 1e-6 * RATE:
        raise ParameterError(f"the drive must be sampled at {RATE:g} Hz; resample it first")
    if len(run.shocks) != len(car.corners):
        raise ParameterError(f"the {car.name} takes {len(car.corners)} shocks, not {len(run.shocks)}")


def _inputs(car: Car, drive: TimeSeries) -> Array:
    return np.stack([drive[name] for name in car.inputs])


def _march(car: Car, shocks: ShockSet, drives: Drives) -> Array:
    """Return the records (N, 3 D + 3 C, B) of every piece from its own start.

        q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)

    Second order; the shocks and the friction go by their own exponentials.
    """
    dofs, corners, runs = car.mass.size, len(car.corners), drives.runs
    step = 1.0 / (RATE * STEPS)
    stepper = _Stepper(car, shocks, step, runs)
    records = np.empty((drives.samples, 3 * dofs + 3 * corners, runs))
    for sample in range(-drives.lead, drives.samples):
        if sample >= 0:
            records[sample] = stepper.record()
        if sample % 500 == 0 and not np.isfinite(stepper.q).all():
            raise StepError(
                f"the {car.name} left all bounds near {sample / RATE:.2f} s; are its shocks and drive sane?"
            )
        values, slopes = drives.between(sample)
        for k in range(STEPS):
            stepper.step(values[k], slopes[k])
    return records


class _Stepper:
    """The state of all runs, and one step of it."""

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
        """Go one step on to where the inputs are `drive` (U, B) and change by `slope` (U, B) [1/s]."""
        h, car, n = self._step, self._car, self._corners
        self.q = self.q + h * (self.v + (0.5 * h) * self.a)
        guess = self.v + h * self.a
        places, speeds = self._ports @ self.q, self._ports @ guess
        speed = speeds[:n]
        self._shock_force = self._shocks.advance(self._speed, speed, places[:n], h)
        self._bend = car.friction.bend(self._bend, 0.5 * (self._speed + speed), h)
        self._friction = car.friction.force(self._bend)
        self._tire = car.tires.force(drive[:n] - places[n : 2 * n], slope[:n] - speeds[n : 2 * n])
        spring = car.springs.force(places[2 * n :])
        forces = np.vstack([self._shock_force + self._friction, self._tire, spring, drive[n:]])
        a = self._push @ forces
        if self._linear:
            a = a + self._stiffness @ self.q + self._damping @ guess
        self.v = self.v + (0.5 * h) * (self.a + a)
        self.a, self._speed = a, self._ports[:n] @ self.v


def _motion(car: Car, run: Run, parts: list[tuple[Span, Array]]) -> Motion:
    """Return a run's motion from its pieces' records (N, R)."""
    whole = np.concatenate([record[: span.stop - span.start] for span, record in parts]).T
    dofs, corners = car.mass.size, len(car.corners)
    bounds = np.cumsum([dofs, dofs, dofs, corners, corners])
    return Motion(run.drive.time, _inputs(car, run.drive), *(np.ascontiguousarray(p) for p in np.split(whole, bounds)))
