"""Shock FMUs for hosts that cannot repeat a step: the force is held over the host's next step (loops A and B)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cosim.engine import force_law as engine
from cosim.force_ports import Corners, Parameters, PortName
from eightpost.errors import InputError


class _Loop:
    """Common part of both loops; the arguments are those of `ForceLaw`, and an FMU needs no states."""

    def __init__(
        self,
        fmu: str | Path | Sequence[str | Path],
        *,
        corners: Sequence[str] | None = None,
        ports: Mapping[str, PortName] | None = None,
        parameters: Parameters | None = None,
        engine: str = "auto",
    ) -> None:
        self._scalar = corners is None and isinstance(fmu, (str, Path))
        self._corners = Corners(
            fmu, corners=corners, ports=ports or {}, parameters=parameters or {}, engine=engine, difference=1e-6
        )
        self._motion = self._corners.motion

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the corners, in the order of all arrays."""
        return tuple(self._corners.names)

    @property
    def time(self) -> float:
        """Time up to which the FMUs have stepped [s]."""
        return float(self._motion.clock[0])

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium and return the force there [N]; see `ForceLaw.start`.

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        self._corners.start(time, velocity, displacement)
        return self._as_given(self._motion.force.copy())

    def close(self) -> None:
        """End the run and unload the FMUs."""
        self._corners.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _operate(self, operation: int, time: float, velocity: Any, displacement: Any) -> None:
        self._motion.clock[1] = time
        self._motion.trial[:, 0], self._motion.trial[:, 1] = velocity, displacement
        reason = self._corners.operate(operation)
        if reason:
            raise self._corners.error(reason)

    def _as_given(self, force: Any) -> Any:
        return force.item(0) if self._scalar else force


class HeldForce(_Loop):
    """Loop A: the FMU steps over the host's next step with the velocity of now; its force at the end is held over it.

        force = loop.step(t, h, velocity, displacement)     # before each step of the host from t to t + h

    An error of first order: 6.0, 2.2 and 0.84 % of the standard deviation of the shock velocity at steps of 4, 2 and
    1 ms for the seven-DOF car on a track (docs/hosts.md). A step takes 6 us for four shocks. The loop needs nothing but
    fmi2DoStep, and works with every FMU.
    """

    def step(self, time: float, step: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force to hold from `time` for `step` [s].

        Args:
            time: Time at which the host's step begins [s]; the end of the last step.
            step: Size of the host's step [s].
            velocity: Shock velocity at `time` [m/s], positive in compression, float or (N,).
            displacement: Shock displacement at `time` [m], float or (N,).

        Returns:
            Shock force [N], float or (N,); positive in compression.

        Raises:
            InputError: The step does not begin where the last one ended, or a value is not finite or not positive.
            StepError: The loop has not started, or an FMU refuses the step.
        """
        if abs(time - self.time) > Corners.SHORTEST * max(1.0, abs(time)):
            raise InputError(
                f"the step begins at {time:.9g} s, but the last one ended at {self.time:.9g} s; call step once per step"
            )
        if not step > Corners.SHORTEST:
            raise InputError(f"the step from {time:.9g} s is {step!r} s; give a positive step [s]")
        self._operate(engine.HOLD, self.time + step, velocity, displacement)
        return self._as_given(self._motion.force.copy())


class ExtrapolatedForce(_Loop):
    """Loop B: the FMU follows the host with a ramp of the velocity, and its force is extrapolated by half a step.

        force = loop.step(t, h, velocity, displacement)     # before each step of the host from t to t + h

    With equal steps the host holds `1.5 F - 0.5 F_old` over its step, the force at the middle of it: an error of second
    order, 3.5, 0.93 and 0.23 % of the standard deviation of the shock velocity at steps of 4, 2 and 1 ms for the
    seven-DOF car on a track (docs/hosts.md). A step takes 10 us for four shocks. The extrapolation is stable only while
    damping c and mass m satisfy c h / m < 0.5 or so, where m is the mass that the shock moves at the port: the wheel's.
    An FMU without input derivatives gets its inputs held; see `ForceLaw`.
    """

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium and return the force there [N]; see `ForceLaw.start`.

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        first = super().start(time, velocity, displacement)
        self._slope = 0.0 * self._motion.force
        return first

    def step(self, time: float, step: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force to hold from `time` for `step` [s].

        Args:
            time: Time at which the host's step begins [s].
            step: Size of the host's step [s].
            velocity: Shock velocity at `time` [m/s], positive in compression, float or (N,).
            displacement: Shock displacement at `time` [m], float or (N,).

        Returns:
            Shock force [N], float or (N,); positive in compression.

        Raises:
            InputError: The time is before that of the last call, or a value is not finite or not positive.
            StepError: The loop has not started, or an FMU refuses the step.
        """
        if not step > Corners.SHORTEST:
            raise InputError(f"the step from {time:.9g} s is {step!r} s; give a positive step [s]")
        passed = time - self.time
        if not abs(passed) <= Corners.SHORTEST:
            before = self._motion.force.copy()
            self._operate(engine.FOLLOW, time, velocity, displacement)
            self._slope = (self._motion.force - before) / passed
        return self._as_given(self._motion.force + 0.5 * step * self._slope)
