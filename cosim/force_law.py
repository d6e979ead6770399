"""Shock FMUs as force laws for somebody else's integrator: exact at any trial point, or held over a step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cosim.components.component import Conversion, FunctionTable, convert_between, free_states, named_unit
from cosim.components.fmu_component import FmuComponent
from cosim.engine import blocks
from cosim.engine import force_law as engine
from cosim.engine.march import bound, compiled, is_interpreted
from eightpost.errors import EightpostError, FmuError, InputError, StepError, WiringError

# ==== Ports of one FMU ===============================================================================================

#: Unit and causality of each port.
_PORTS = {"velocity": ("m/s", "input"), "displacement": ("m", "input"), "force": ("N", "output")}

#: Name of a port's variable in the FMU; (name, gain) if the variable is `gain` times the port's quantity, for example
#: -1 where the FMU counts rebound as positive; None for a displacement that the FMU does not need.
PortName = str | tuple[str, float] | None

#: Parameters of all corners, or by the corner's name.
Parameters = Mapping[str, Any]


@dataclass(frozen=True)
class Port:
    """Variable of a port, and the conversion from SI units to the variable's, signs included."""

    name: str
    conversion: Conversion


def _ports(component: FmuComponent, names: Mapping[str, PortName]) -> dict[str, Port]:
    """Return the ports of an FMU; one that is not named has its own name.

    An FMU without a variable named `displacement` is one whose force does not depend on it.
    """
    if unknown := sorted(set(names) - set(_PORTS)):
        raise WiringError(f"{unknown[0]!r} is not a port of a shock; its ports are {', '.join(_PORTS)}")
    wanted: dict[str, PortName] = {port: names.get(port, port) for port in _PORTS}
    if "displacement" not in names and "displacement" not in component.variables:
        wanted["displacement"] = None
    ports = {}
    for port, name in wanted.items():
        if name is not None:
            variable, gain = name if isinstance(name, tuple) else (name, 1.0)
            ports[port] = Port(variable, _conversion(component, port, variable, gain))
        elif port != "displacement":
            raise WiringError(f"{component.source}: the {port} of a shock cannot be left out; name its variable")
    return ports


def _conversion(component: FmuComponent, port: str, name: str, gain: float) -> Conversion:
    unit, causality = _PORTS[port]
    variable = component.variables.get(name)
    if variable is None or variable.type != "Real" or variable.causality != causality:
        offered = [v.name for v in component.variables.values() if (v.type, v.causality) == ("Real", causality)]
        raise WiringError(
            f"{component.source} has no Real {causality} {name!r} for the {port}; name the variable with "
            f"ports={{{port!r}: ...}}: its Real {causality}s are {', '.join(offered) or 'none'}"
        )
    if not (math.isfinite(gain) and gain != 0.0):
        raise WiringError(f"{component.source}: the gain of {name} must be finite and not zero, not {gain!r}")
    own = convert_between(named_unit(unit), variable.unit, f"{port} [{unit}] -> {component.source}: {name}")
    return Conversion(own.factor * gain, own.offset)


def _opened(fmus: str | Path | Sequence[str | Path], corners: Sequence[str] | None) -> list[FmuComponent]:
    """Open one FMU for each corner; without names of corners, those of the files."""
    if isinstance(fmus, (str, Path)):
        paths = [Path(fmus)] * (1 if corners is None else len(corners))
    else:
        paths = [Path(path) for path in fmus]
    names = list(corners) if corners is not None else [path.stem for path in paths]
    if corners is None and len(set(names)) < len(names):
        names = [f"{name} {k + 1}" for k, name in enumerate(names)]
    if len(names) != len(paths) or not paths:
        raise InputError(f"{len(paths)} FMUs for {len(names)} corners; give one FMU for all, or one for each corner")
    return [FmuComponent(path, name) for path, name in zip(paths, names, strict=True)]


def _parameters_of(parameters: Parameters, name: str, names: Sequence[str]) -> dict[str, Any]:
    """Return one corner's parameters from those of all corners, or from a table by corner."""
    if not any(isinstance(value, Mapping) for value in parameters.values()):
        return dict(parameters)
    if unknown := sorted(set(parameters) - set(names)):
        raise InputError(f"parameters name {unknown[0]!r}, which is not a corner; the corners are {', '.join(names)}")
    return dict(parameters.get(name, {}))


# ==== Blocks of the engine ===========================================================================================

#: Largest time difference that counts as none [s]; and the step over which inputs jump if no time passes.
SHORTEST = 1e-9

#: Descriptions of the calls, by their numbers in cosim.engine.plan.
_CALLS = ("set inputs", "set input derivatives", "step", "give its force", "save its state", "restore its state")


def _blank_motion(count: int) -> engine.Motion:
    shapes = {"clock": (3,), "around": (4,)} | dict.fromkeys(("read", "force"), (count,))
    arrays: dict[str, Any] = {name: np.zeros(shapes.get(name, (count, 2))) for name in engine.Motion._fields}
    return engine.Motion(**arrays | {"states": np.zeros(count, np.int64), "failure": np.zeros(3, np.int64)})


def _plan(
    components: Sequence[FmuComponent],
    ports: Sequence[Mapping[str, Port]],
    tables: Sequence[FunctionTable],
    motion: engine.Motion,
    difference: float,
) -> tuple[engine.Ports, Any]:
    """Return the block of functions and ports, and the arrays that must live as long as it is used."""
    count = len(tables)
    references, orders = np.zeros((count, 3), dtype=np.uint32), np.ones(2, dtype=np.int32)
    scale, offset = np.ones((count, 3)), np.zeros((count, 3))
    for i, (table, named) in enumerate(zip(tables, ports, strict=True)):
        for k, port in enumerate(_PORTS):
            if port in named:
                references[i, k] = table.references[named[port].name]
                scale[i, k], offset[i, k] = named[port].conversion.factor, named[port].conversion.offset
        scale[i, 2], offset[i, 2] = 1.0 / scale[i, 2], -offset[i, 2] / scale[i, 2]

    def integers(values: Any) -> Any:
        return np.array(list(values), dtype=np.int64)

    def rows(array: Any, column: int = 0) -> Any:
        first, step = array.ctypes.data + column * array.itemsize, array.strides[0]
        return integers(first + step * i for i in range(count))

    functions = ("set_real", "set_slopes", "do_step", "get_real", "save", "restore", "instance")
    plan = engine.Ports(
        **{name: integers(getattr(table, name) for table in tables) for name in functions},
        ramped=integers(c.capabilities.interpolates_inputs for c in components),
        inputs=rows(references),
        orders=integers([orders.ctypes.data] * count),
        output=rows(references, 2),
        width=integers(2 if "displacement" in named else 1 for named in ports),
        values=rows(motion.values),
        slopes=rows(motion.slopes),
        read=rows(motion.read),
        scale=scale,
        offset=offset,
        shortest=SHORTEST,
        difference=difference,
    )
    return plan, (references, orders)


# ==== Common part of the objects that give a host the forces =========================================================


class ForceLoop:
    """Shock FMUs at the corners of a host's vehicle, and errors that name the corner; see `ForceLaw` for the arguments.

    Calls raise InputError for a value that is not finite, and StepError if the loop has not started or an FMU refuses.
    """

    def __init__(
        self,
        fmu: str | Path | Sequence[str | Path],
        *,
        corners: Sequence[str] | None = None,
        ports: Mapping[str, PortName] | None = None,
        parameters: Parameters | None = None,
        engine: str = "auto",
    ) -> None:
        if engine not in ("auto", "compiled", "python"):
            raise InputError(f"engine is {engine!r}; give auto, compiled or python")
        self._scalar = corners is None and isinstance(fmu, (str, Path))
        self._components = _opened(fmu, corners)
        self._names = [component._name for component in self._components]
        self._ports = [_ports(component, ports or {}) for component in self._components]
        self._parameters = [_parameters_of(parameters or {}, name, self._names) for name in self._names]
        for component in self._components:
            self._check(component)
        self._bind = bound if is_interpreted(engine) else partial(compiled, instead={})
        self._difference = 1e-6  # change of an input for the Jacobian [m/s], [m]
        self._motion = _blank_motion(len(self._components))
        self._clock, self._force, self._trial = self._motion.clock, self._motion.force, self._motion.trial
        self._tables: list[FunctionTable] = []
        self._keep: Any = None
        self._operation: Any = None

    def _check(self, component: FmuComponent) -> None:
        """Raise an error if the loop needs what the FMU of a corner does not offer."""

    @property
    def corners(self) -> tuple[str, ...]:
        """Names of the corners, in the order of all arrays."""
        return tuple(self._names)

    @property
    def time(self) -> float:
        """Time of the accepted point [s], up to which the FMUs have stepped."""
        return float(self._clock[0])

    @property
    def messages(self) -> tuple[str, ...]:
        """Warnings of all FMUs since the start, each once, with the name of the corner."""
        return tuple(f"{c._name}: {text}" for c in self._components for text in c.messages)

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium: the shock has moved at this velocity for a long time. A second call starts again.

        Args:
            time: Start time [s].
            velocity: Shock velocity [m/s], positive in compression, float or (N,).
            displacement: Shock displacement [m], float or (N,).

        Returns:
            Shock force [N], float or (N,).
        """
        self._finish()
        m = self._motion
        m.clock[:] = time, time, math.nan
        m.trial[:, 0], m.trial[:, 1] = velocity, displacement
        self._check_finite()
        m.accepted[:] = m.trial
        for k, component in enumerate(self._components):
            component.begin(float(time), math.inf, self._parameters[k])
            inputs, force = self._inputs(k), self._ports[k]["force"]
            component.set(list(inputs), list(inputs.values()))
            component.end_initialization()
            (value,) = component.get([force.name])
            m.force[k] = (value - force.conversion.offset) / force.conversion.factor
        self._tables = [component.functions() for component in self._components]
        plan, self._keep = _plan(self._components, self._ports, self._tables, m, self._difference)
        self._operation = self._bind(engine.operate)(plan, m)
        return self._forces()

    def close(self) -> None:
        """End the run and unload the FMUs."""
        self._finish()
        for component in self._components:
            component.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _finish(self) -> None:
        with suppress(EightpostError):
            free_states(self._tables, self._motion.states)
        self._motion.states.fill(0)
        self._tables, self._keep, self._operation = [], None, None
        for component in self._components:
            component.finish()

    def _operate(self, operation: int, time: float, velocity: Any, displacement: Any) -> Any:
        """Run an operation of the engine at a point; return the forces."""
        self._clock[1] = time
        self._trial[:, 0] = velocity
        self._trial[:, 1] = displacement
        if self._operation is None:
            raise StepError(f"the shocks {', '.join(self._names)} have not started; call start() first")
        reason = self._operation(operation)
        if reason:
            self._fail(reason)
        return self._forces()

    def _forces(self) -> Any:
        return self._force.item(0) if self._scalar else self._force.copy()

    def _fail(self, reason: int) -> None:
        """Raise the error of an operation that failed for a reason of cosim.engine.force_law."""
        if reason == engine.NOT_FINITE:
            self._check_finite()
        if reason == engine.BACKWARD:
            raise InputError(
                f"time {self._clock[1]:.9g} s is before the last accepted time, {self.time:.9g} s: a force law cannot "
                "go back beyond it; accept a point only after the integrator's step is final"
            )
        status, k, call = (int(number) for number in self._motion.failure)
        raise self._components[k].refused(_CALLS[call], status, self.time, self._inputs(k))

    def _check_finite(self) -> None:
        time = self._clock[1]
        if not math.isfinite(time):
            raise InputError(f"time is {time}; give a finite time [s]")
        for name, row in zip(self._names, self._trial, strict=True):
            for port, value in zip(("velocity", "displacement"), row, strict=True):
                if not math.isfinite(value):
                    raise InputError(
                        f"{name}: {port} is {value} at {time:.9g} s; the integrator diverged, or the host passed a "
                        "value that was not computed"
                    )

    def _inputs(self, k: int) -> dict[str, float]:
        values = zip(("velocity", "displacement"), self._trial[k], strict=True)
        ports = [(self._ports[k][port], float(value)) for port, value in values if port in self._ports[k]]
        return {port.name: port.conversion(value) for port, value in ports}


# ==== Exact at any trial point, without side effects =================================================================


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
        self._difference = float(difference)

    def _check(self, component: FmuComponent) -> None:
        if not component.capabilities.state:
            raise FmuError(
                f"{component.source} cannot save its state (canGetAndSetFMUstate is false in its model description), "
                "so it cannot be tried at points that the integrator may reject; use cosim.HeldForce (loop A) or "
                "cosim.ExtrapolatedForce (loop B) with a smaller step, or ask its maker for an FMU with states"
            )
        if not component.capabilities.variable_step:
            raise FmuError(
                f"{component.source} steps at fixed communication points only (canHandleVariableCommunicationStepSize "
                "is false in its model description), so it cannot be tried at arbitrary times; use cosim.HeldForce "
                "(loop A) with its own step"
            )

    def start(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Start in equilibrium and return the force there [N]; see `ForceLoop.start`."""
        first, m = super().start(time, velocity, displacement), self._motion
        for k, table in enumerate(self._tables):
            status = blocks.call_state(table.save, table.instance, m.states.ctypes.data + 8 * k)
            if status > 1:
                raise self._components[k].refused("save its state", status, self.time, self._inputs(k))
        return first

    def force(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force at a trial point [N], float or (N,), positive in compression; the accepted point remains.

        Args:
            time: Time of the trial point [s], not before the accepted one.
            velocity: Shock velocity [m/s], positive in compression, float or (N,).
            displacement: Shock displacement [m], float or (N,).
        """
        return self._operate(engine.TRIAL, time, velocity, displacement)

    def accept(self, time: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Make a point the accepted one, after the integrator has accepted its step, and return the force there.

        If the last evaluation was at the same point, the FMU is not stepped again.
        """
        return self._operate(engine.ACCEPT, time, velocity, displacement)

    def jacobian(self, time: float, velocity: Any, displacement: Any = 0.0) -> tuple[Any, Any]:
        """Return the derivatives of `force` at a trial point: that of the FMU's output, and of the step before it.

        A directional derivative of the FMU would contain the first part alone. So the derivative is a central
        difference of `force`, of the two inner or the two outer of four intervals of `difference`: of that pair which
        contains no jump. It is correct to about 1e-6.

        Returns:
            Derivatives with respect to velocity [N.s/m] and displacement [N/m], floats or (N,).
        """
        self._operate(engine.DIFFERENTIATE, time, velocity, displacement)
        jacobian = self._motion.jacobian
        if self._scalar:
            return float(jacobian[0, 0]), float(jacobian[0, 1])
        return jacobian[:, 0].copy(), jacobian[:, 1].copy()


# ==== For hosts that cannot repeat a step: the force is held over the host's next step (loops A and B) ===============


class HeldForce(ForceLoop):
    """Loop A: the FMU steps over the host's next step with the velocity of now; its force at the end is held over it.

        force = loop.step(t, h, velocity, displacement)     # before each step of the host from t to t + h

    An error of first order: 6.0, 2.2 and 0.84 % of the standard deviation of the shock velocity at steps of 4, 2 and
    1 ms for the seven-DOF car on a track (docs/how_to/hosts.md). A step takes 6 us for four shocks. The loop needs
    nothing but fmi2DoStep (fmi3DoStep), and works with every FMU.
    """

    def step(self, time: float, step: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force to hold from `time` for `step` [s], in N, float or (N,), positive in compression.

        Args:
            time: Time at which the host's step begins [s]; the end of the last step.
            step: Size of the host's step [s].
            velocity: Shock velocity at `time` [m/s], positive in compression, float or (N,).
            displacement: Shock displacement at `time` [m], float or (N,).
        """
        if abs(time - self.time) > SHORTEST * max(1.0, abs(time)):
            raise InputError(
                f"the step begins at {time:.9g} s, but the last one ended at {self.time:.9g} s; call step once per step"
            )
        _check_step(time, step)
        return self._operate(engine.HOLD, self.time + step, velocity, displacement)


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
        """Start in equilibrium and return the force there [N]; see `ForceLoop.start`."""
        first = super().start(time, velocity, displacement)
        self._slope = 0.0 * self._force
        return first

    def step(self, time: float, step: float, velocity: Any, displacement: Any = 0.0) -> Any:
        """Return the force to hold from `time`, not before the last call's, for `step` [s]; see `HeldForce.step`."""
        _check_step(time, step)
        passed = time - self.time
        if not abs(passed) <= SHORTEST:
            before = self._force.copy()
            self._operate(engine.FOLLOW, time, velocity, displacement)
            self._slope = (self._force - before) / passed
        ahead = self._force + 0.5 * step * self._slope
        return ahead.item(0) if self._scalar else ahead


def _check_step(time: float, step: float) -> None:
    if not step > SHORTEST:
        raise InputError(f"the step from {time:.9g} s is {step!r} s; give a positive step [s]")
