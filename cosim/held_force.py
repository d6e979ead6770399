"""Shock FMUs for hosts that cannot repeat a step: the force is held over the host's next step (loops A and B)."""

from __future__ import annotations

from typing import Any

from cosim.engine import force_law as engine
from cosim.force_loop import ForceLoop
from cosim.force_ports import Corners
from eightpost.errors import InputError


class HeldForce(ForceLoop):
    """Loop A: the FMU steps over the host's next step with the velocity of now; its force at the end is held over it.

        force = loop.step(t, h, velocity, displacement)     # before each step of the host from t to t + h

    An error of first order: 6.0, 2.2 and 0.84 % of the standard deviation of the shock velocity at steps of 4, 2 and
    1 ms for the seven-DOF car on a track (docs/how_to/hosts.md). A step takes 6 us for four shocks. The loop needs
    nothing but fmi2DoStep (fmi3DoStep), and works with every FMU.
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
        return self._forces()


class ExtrapolatedForce(ForceLoop):
    """Loop B: the FMU follows the host with a ramp of the velocity, and its force is extrapolated by half a step.

        force = loop.step(t, h, velocity, displacement)     # before each step of the host from t to t + h

    With equal steps the host holds `1.5 F - 0.5 F_old` over its step, the force at the middle of it: an error of second
    order, 3.5, 0.93 and 0.23 % of the standard deviation of the shock velocity at steps of 4, 2 and 1 ms for the
    seven-DOF car on a track (docs/how_to/hosts.md). A step takes 10 us for four shocks. The extrapolation is stable
    only while damping c and mass m satisfy c h / m < 0.5 or so, where m is the mass that the shock moves at the port:
    the wheel's. An FMU without input derivatives gets its inputs held; see `ForceLaw`.
    """

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium and return the force there [N]; see `ForceLoop.start`.

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        first = super().start(time, velocity, displacement)
        self._slope = 0.0 * self._force
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
            before = self._force.copy()
            self._operate(engine.FOLLOW, time, velocity, displacement)
            self._slope = (self._force - before) / passed
        ahead = self._force + 0.5 * step * self._slope
        return ahead.item(0) if self._scalar else ahead
