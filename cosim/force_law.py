"""Shock FMUs as force laws for somebody else's integrator: exact at any trial point, or held over a step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cosim.components.fmu_component import FmuComponent
from cosim.engine import force_law as engine
from cosim.force_ports import Corners, Parameters, PortName
from eightpost.errors import FmuError, InputError

# ---- Common part of the objects that give a host the forces ---------------------------------------------------------


class ForceLoop:
    """Shock FMUs at the corners of a host's vehicle; see `ForceLaw` for the arguments and errors."""

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
        self._corners = Corners(fmu, corners=corners, ports=ports or {}, parameters=parameters or {}, engine=engine)
        for component in self._corners.components:
            self._check(component)
        motion = self._corners.motion
        self._clock, self._force = motion.clock, motion.force
        self._velocity, self._displacement = motion.trial[:, 0], motion.trial[:, 1]

    def _check(self, component: FmuComponent) -> None:
        """Raise an error if the loop needs what the FMU of a corner does not offer."""

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the corners, in the order of all arrays."""
        return tuple(self._corners.names)

    @property
    def time(self) -> float:
        """Time of the accepted point [s], up to which the FMUs have stepped."""
        return float(self._clock[0])

    @property
    def messages(self) -> tuple[str, ...]:
        """Warnings of all FMUs since the start, each once, with the name of the corner."""
        return tuple(f"{c._name}: {text}" for c in self._corners.components for text in c.messages)

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium: the shock has moved at this velocity for a long time. A second call starts again.

        Args:
            time: Start time [s].
            velocity: Shock velocity [m/s], positive in compression, float or (N,).
            displacement: Shock displacement [m], float or (N,).

        Returns:
            Shock force [N], float or (N,).

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        self._corners.start(time, velocity, displacement)
        return self._forces()

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
        self._clock[1] = time
        self._velocity[:] = velocity
        self._displacement[:] = displacement
        reason = self._corners.operate(operation)
        if reason:
            raise self._corners.error(reason)

    def _forces(self) -> Any:
        return self._force.item(0) if self._scalar else self._force.copy()


# ---- Exact at any trial point, without side effects -----------------------------------------------------------------


class ForceLaw(ForceLoop):
    """Shock FMUs whose forces an integrator asks for at its own trial points: loop C of docs/how_to/hosts.md.

    The force at a trial point (t, velocity, displacement) is that at the end of one step of the FMU from the last
    accepted point, with inputs that change linearly in between. The FMU is returned to the accepted point before every
    evaluation, so trial points may come in any order, may be repeated, and may be rejected. The integrator may be
    explicit or implicit, with fixed or variable steps:

        law = ForceLaw("shock.fmu", corners=("lf", "rf", "lr", "rr"))
        law.start(0.0, velocity, displacement)
        ...                                        # in the right-hand side, in every stage and iteration:
        force = law.force(t, velocity, displacement)
        ...                                        # after every step that the integrator accepted:
        law.accept(t, velocity, displacement)

    Error and cost: the seven-DOF car with four LPNL2 shocks on a track has errors of 1.7, 0.65, 0.13 and 0.04 % of the
    standard deviation of the shock velocity at steps of 8, 4, 2 and 1 ms, with a Runge-Kutta integrator of fourth order
    (docs/how_to/hosts.md). An evaluation takes 4 us for one shock and 5 us for four (benchmarks/force_law.py),
    interpreted 28 us and 91 us. The integrator keeps its order with a shock without states; with lag, the ramps between
    accepted points are of second order.

    If t is the accepted time, the inputs jump to the trial values and no time passes: the step is 1 ns, which
    is the limit of a short step for laws whose time constants are far longer.

    If an FMU takes no input derivatives, its inputs are held: at their mean for most of the step, and at the trial
    values for its last 1/1024, because the force follows the inputs at the end of the step. The states of the shock
    are then of second order in the size of the step; with input derivatives they are as exact as the FMU.

    Args:
        fmu: FMU file of a shock (FMI 2.0 or 3.0 co-simulation, with canGetAndSetFMUstate), or one for each corner.
        corners: Names of the corners. With None and one file, values are floats; otherwise they are arrays (N,).
        ports: Names of the FMU's variables for `velocity`, `displacement` and `force`, where they differ; units are
            converted from the FMU's definitions. (name, -1.0) is a variable with the opposite sign, and
            `displacement` may be None. Values passed here are in SI units and positive in compression.
        parameters: Parameters of all corners, or a table of them by corner, in the FMU's own units.
        engine: `auto` or `compiled`: the compiled loop, compiled by the first use on a machine; `python`: interpreted.
        difference: Change of velocity [m/s] and displacement [m] for `jacobian`.

    Raises:
        FmuError: A file cannot be used, or the FMU cannot save its state.
        WiringError: A port does not fit the FMU's variables.
        InputError: An argument cannot be used.
    """

    def __init__(
        self,
        fmu: str | Path | Sequence[str | Path],
        *,
        corners: Sequence[str] | None = None,
        ports: Mapping[str, PortName] | None = None,
        parameters: Parameters | None = None,
        engine: str = "auto",
        difference: float = 1e-6,
    ) -> None:
        if not (math.isfinite(difference) and difference > 0.0):
            raise InputError(f"difference is {difference!r}; give a positive change of velocity [m/s]")
        super().__init__(fmu, corners=corners, ports=ports, parameters=parameters, engine=engine)
        self._corners.difference = float(difference)

    def _check(self, component: FmuComponent) -> None:
        if not component.capabilities.state:
            raise FmuError(_no_state(component.source))
        if not component.capabilities.variable_step:
            raise FmuError(_fixed_step(component.source))

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium and return the force there [N]; see `ForceLoop.start`.

        Raises:
            StepError: An FMU cannot be loaded, or refuses a value or the start.
            InputError: An input is not finite.
        """
        first = super().start(time, velocity, displacement)
        self._corners.save()
        return first

    def force(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force at a trial point; the accepted point remains.

        Args:
            time: Time of the trial point [s], not before the accepted one.
            velocity: Shock velocity [m/s], positive in compression, float or (N,).
            displacement: Shock displacement [m], float or (N,).

        Returns:
            Shock force [N], float or (N,); positive in compression.

        Raises:
            InputError: The time is before the accepted one, or an input is not finite.
            StepError: The law has not started, or an FMU refuses the step.
        """
        self._operate(engine.TRIAL, time, velocity, displacement)
        return self._forces()

    def accept(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Make a point the accepted one, after the integrator has accepted its step, and return the force there.

        If the last evaluation was at the same point, the FMU is not stepped again.

        Raises:
            InputError: The time is before the accepted one, or an input is not finite.
            StepError: The law has not started, or an FMU refuses the step.
        """
        self._operate(engine.ACCEPT, time, velocity, displacement)
        return self._forces()

    def jacobian(self, time: float, velocity: Any, displacement: Any = 0.0) -> tuple[Any, Any]:
        """Return the derivatives of `force` at a trial point: that of the FMU's output, and of the step before it.

        A directional derivative of the FMU would contain the first part alone. So the derivative is a central
        difference of `force`, of the two inner or the two outer of four intervals of `difference`: of that pair which
        contains no jump. It is correct to about 1e-6.

        Returns:
            Derivatives with respect to velocity [N.s/m] and displacement [N/m], floats or (N,).

        Raises:
            InputError: The time is before the accepted one, or an input is not finite.
            StepError: The law has not started, or an FMU refuses the step.
        """
        self._operate(engine.DIFFERENTIATE, time, velocity, displacement)
        jacobian = self._corners.motion.jacobian
        if self._scalar:
            return float(jacobian[0, 0]), float(jacobian[0, 1])
        return jacobian[:, 0].copy(), jacobian[:, 1].copy()


def _no_state(source: str) -> str:
    return (
        f"{source} cannot save its state (canGetAndSetFMUstate is false in its model description), so it cannot be "
        "tried at points that the integrator may reject; use cosim.HeldForce (loop A) or cosim.ExtrapolatedForce "
        "(loop B) with a smaller step, or ask its maker for an FMU with states"
    )


def _fixed_step(source: str) -> str:
    return (
        f"{source} steps at fixed communication points only (canHandleVariableCommunicationStepSize is false in its "
        "model description), so it cannot be tried at arbitrary times; use cosim.HeldForce (loop A) with its own step"
    )


# ---- For hosts that cannot repeat a step: the force is held over the host's next step (loops A and B) ---------------


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
