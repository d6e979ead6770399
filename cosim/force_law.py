"""Shock FMUs as force laws for somebody else's integrator: exact at any trial point, without side effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.components.fmu_component import FmuComponent
from cosim.engine import force_law as engine
from cosim.force_loop import ForceLoop
from cosim.force_ports import Parameters, PortName
from eightpost.errors import FmuError, InputError


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
    (docs/how_to/hosts.md). An evaluation takes 4 us for one shock and 5 us for four,
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
