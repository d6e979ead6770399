"""An FMI 2.0 co-simulation FMU as a component, through fmpy."""

from __future__ import annotations

import ctypes
import os
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fmpy import fmi1, fmi2

from cosim.fmu_failure import (
    DISCARD,
    ERROR,
    FATAL,
    PENDING,
    advice,
    no_state,
    not_begun,
    returned,
    unknown_state,
)
from cosim.fmu_file import FmuFile, SharedFmu
from cosim.fmu_instance import FmuInstance, State
from cosim.fmu_log import FmuLog
from cosim.functions import FunctionTable
from cosim.opened_fmu import OpenedFmu
from cosim.surroundings import Surroundings
from cosim.typed_buffer import TypedBuffer, typed_buffers
from cosim.watch import calling
from eightpost.errors import EightpostError, StepError, TerminatedError

_REASONS = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"}
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3  # fmi2StatusKind


class FmuComponent(OpenedFmu):
    """One instance of an FMU in this process; names are resolved once per set of names, so that stepping costs little.

    The instance of an FMU that this project built is kept after a run and reset for the next one; that of any other is
    freed after each run and made anew for the next. An FMU that crashes ends this process, one that hangs holds it up:
    see IsolatedComponent.

    Args:
        path: The .fmu file.
        name: Name of the component.
        compile_missing: Whether to compile the FMU's sources where it has no binary for this platform.
        folder: Where the FMU is unpacked already; None unpacks it into a temporary folder, once for all components.

    Raises:
        FmuError: The file is missing, damaged or unsafe, is not an FMI 2.0 co-simulation FMU, or has no binary for
            this platform.
    """

    def __init__(
        self, path: str | Path, name: str, *, compile_missing: bool = False, folder: str | Path | None = None
    ) -> None:
        shared = None
        if folder is None:
            shared = SharedFmu.of(path, compile_missing=compile_missing)
            fmu = shared.fmu
        else:
            fmu = FmuFile.unpacked(path, folder)
        self._log = FmuLog(name, fmu.names_in_log, fmu.folder)
        super().__init__(fmu, name, self._log.messages)
        self._instance = FmuInstance(fmu, name, self._log, shared)
        # Frees all: with the component, with the interpreter, or on call; a component may begin more than once.
        self.close = weakref.finalize(self, self._instance.release, os.getpid())
        self._references = fmu.references
        self._arrays: dict[tuple[str, ...], tuple[TypedBuffer, ...]] = {}
        self._slave: Any = None
        self._steps = self._begun = False
        # In a process of its own there is nothing that others share.
        self._guarded = folder is None and not fmu.is_ours
        self._surroundings = Surroundings.now()

    @property
    def usable(self) -> bool:
        """False after fmi2Fatal: then nothing of the FMU in this process may be called any more."""
        return not self._instance.dead

    @property
    def is_guarded(self) -> bool:
        """Whether it is watched for ending this process or changing what it shares with others."""
        return self._guarded

    def blame(self, changed: str) -> None:
        """Note that it changed what it shares with others, as `changed` says; that is undone."""
        self._changed[f"it changed {changed}; that was undone"] = None

    def functions(self) -> FunctionTable:
        """Return the addresses of the running instance's functions, for the loop.

        Raises:
            StepError: It has not begun.
        """
        self._running()
        return self._instance.functions(self._references)

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call that the loop made and the FMU refused, and treat the instance accordingly.

        Args:
            what: The call, as what it failed to do: "step", "set inputs".
            status: What it returned, an fmi2Status.
            time: At which the step begins [s].
            inputs: Values that it was given, in its own units.
        """
        self._stand(time, self._inputs | dict(inputs))
        return self._refusal(what, status, "fmi2DoStep" if what == "step" else "it")

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Make an instance, or reset the last run's where it is kept, set parameters, set up and enter initialization.

        Args:
            start: Time at which the run starts [s].
            stop: Time at which it ends [s].
            parameters: Values by name, in its own units.

        Raises:
            StepError: It cannot be loaded or instantiated, refuses a value, or failed fatally before.
        """
        self.finish()
        self._stand(start, {})
        self._changed.clear()
        self._surroundings = Surroundings.now()
        with self._guard():
            self._slave = self._ready()
        self._log.messages.clear()
        for name, value in parameters.items():
            self._call_without_error(f"set {name} = {value!r}", self._set_parameter, name, value)
        self._call("set up the experiment", self._slave.setupExperiment, startTime=start, stopTime=stop)
        self._call("enter initialization", self._slave.enterInitializationMode)

    def end_initialization(self) -> None:
        """Leave initialization mode.

        Raises:
            StepError: It has not begun, or refuses.
        """
        self._call_without_error("leave initialization", self._running().exitInitializationMode)
        self._steps = True
        self._call("limit its log", self._limit_log)

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set inputs of any type but String.

        Args:
            names: Of the inputs (N,).
            values: Values of the variables (N,), in the FMU's own units; 1 is true.

        Raises:
            StepError: It has not begun, or refuses a value.
        """
        slave = self._running()
        self._inputs.update(zip(names, values, strict=True))
        for part in self._buffers(names):
            part.buffer[:] = [part.number(values[place]) for place in part.places]
            setter = getattr(slave, f"fmi2Set{part.kind}")
            self._call("set inputs", setter, slave.component, part.references, len(part.buffer), part.buffer)

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set first derivatives of real inputs, for the next step.

        Args:
            names: Of the inputs (N,).
            values: Their derivatives (N,), in its own units per second.

        Raises:
            StepError: It has not begun, or refuses (`capabilities.interpolates_inputs`).
        """
        slave = self._running()
        (part,), count = self._buffers(names), len(names)
        orders, slopes = (ctypes.c_int * count)(*[1] * count), (ctypes.c_double * count)(*values)
        arguments = (slave.component, part.references, count, orders, slopes)
        self._call("set input derivatives", slave.fmi2SetRealInputDerivatives, *arguments)

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the values (N,) of variables (N,) of any type but String, in its own units; 1 is true.

        Raises:
            StepError: It has not begun, or refuses.
        """
        slave, values = self._running(), [0.0] * len(names)
        for part in self._buffers(names):
            getter = getattr(slave, f"fmi2Get{part.kind}")
            self._call("get outputs", getter, slave.component, part.references, len(part.buffer), part.buffer)
            for place, value in zip(part.places, part.buffer, strict=True):
                values[place] = float(value)
        return values

    def step(self, time: float, step: float) -> None:
        """Do one step from `time` by `step` [s]; where no state is saved, its end is a point of no return.

        Raises:
            StepError: It has not begun, or refuses the step.
        """
        slave = self._running()
        self._time = time
        final = 0 if self._instance.states else 1
        self._call(f"step from {time:g} s by {step:g} s", slave.fmi2DoStep, slave.component, time, step, final)
        self._time = time + step

    def save(self) -> object:
        """Return its state now, for `restore`; `free` it, or it is freed with the end of the run.

        Raises:
            StepError: It has not begun, cannot save its state (`capabilities.state`), or fails to.
        """
        slave = self._running()
        if not self.capabilities.state:
            raise StepError(no_state(self._name, self.source))
        pointer = self._instance.spare.pop() if self._instance.spare else fmi2.fmi2FMUstate()
        self._call("save its state", slave.fmi2GetFMUstate, slave.component, ctypes.byref(pointer))
        state = State(pointer, self._time, dict(self._inputs))
        self._instance.states.append(state)
        return state

    def restore(self, state: object) -> None:
        """Go back to a state that `save` returned; it stays good for more.

        Raises:
            StepError: It has not begun, the state is not one of this run, or it fails to.
        """
        slave, known = self._running(), self._known(state)
        self._call("restore a state", slave.fmi2SetFMUstate, slave.component, known.pointer)
        self._stand(known.time, known.inputs)

    def free(self, state: object) -> None:
        """Give a state back; its memory serves the next `save`.

        Raises:
            StepError: The state is not one of this run.
        """
        known = self._known(state)
        self._instance.states.remove(known)
        self._instance.spare.append(known.pointer)

    def finish(self) -> None:
        """Terminate, and free the instance unless it may be reset for the next `begin`."""
        slave, self._slave = self._slave, None
        steps, self._steps = self._steps, False
        if slave is not None:
            with self._guard():
                self._instance.finish(terminate=steps)

    @contextmanager
    def _guard(self) -> Iterator[None]:
        """Say who is called, and undo what the call changes of what all share."""
        if not self._guarded:
            yield
            return
        try:
            with calling(self._name):
                yield
        finally:
            for changed in self._surroundings.restore():
                self.blame(changed)

    def _known(self, state: object) -> State:
        if not isinstance(state, State) or state not in self._instance.states:
            raise StepError(unknown_state(self._name, self.source))
        return state

    def _running(self) -> Any:
        # fmi2Fatal of another instance of this FMU ends this one too.
        if self._slave is None or self._instance.slave is None:
            raise StepError(not_begun(self._name, self.source))
        return self._slave

    def _ready(self) -> Any:
        try:
            return self._instance.ready()
        except EightpostError:
            raise
        except Exception as error:  # fmpy raises bare Exceptions where it cannot load or instantiate
            raise self._failure("failed to instantiate", f"{error}.", self._advice_on_instantiation()) from error
        finally:
            self._begun = True

    def _advice_on_instantiation(self) -> str:
        if self._fmu.needs_tool:
            return "install the tool that made it: it cannot run without (needsExecutionTool)"
        if self._begun and not self._fmu.is_ours:
            return (
                "a process may be able to make one instance of it only: run it in processes of its own: --isolate, "
                "IsolatedComponent"
            )
        return ""

    def _limit_log(self) -> None:
        """From here on log only what goes wrong: a debug message in every step would cost more than the step."""
        wanted = sorted(self._fmu.log_categories & _REASONS)
        with suppress(fmi1.FMICallException):  # an FMU without such a switch runs on
            self._slave.setDebugLogging(bool(wanted), wanted)

    def _set_parameter(self, name: str, value: float | bool | str) -> None:
        kind, references = self.variables[name].type, [self._references[name]]
        if kind == "Real":
            self._slave.setReal(references, [value])
        elif kind == "Boolean":
            self._slave.setBoolean(references, [bool(value)])
        elif kind == "String":
            self._slave.setString(references, [str(value)])
        else:
            self._slave.setInteger(references, [int(value)])

    def _buffers(self, names: Sequence[str]) -> tuple[TypedBuffer, ...]:
        """Return memory for values, by the types that the names have."""
        key = tuple(names)
        if key not in self._arrays:
            types = {name: self.variables[name].type for name in key}
            self._arrays[key] = typed_buffers(key, types, self._references)
        return self._arrays[key]

    def _call(self, what: str, function: Callable[..., Any], *arguments: Any, **options: Any) -> None:
        try:
            with self._guard():
                function(*arguments, **options)
        except fmi1.FMICallException as error:
            raise self._refusal(what, error.status, error.function) from error
        except (OSError, AttributeError) as error:  # Windows raises OSError where an FMU touches memory it must not
            raise self._failure(f"failed to {what}", f"{error}.") from error

    def _call_without_error(self, what: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Call where an error in the log counts too: some FMUs (PythonFMU's) can say it nowhere else."""
        errors = self._log.errors
        self._call(what, function, *arguments)
        if self._log.errors > errors:
            raise self._failure(f"failed to {what}", "it logged an error.")

    def _refusal(self, what: str, status: int, function: str) -> StepError:
        """What an FMI status above a warning means, and what may still be called after it."""
        why, to_do, terminated = returned(status, function), advice(status), False
        if status == DISCARD:
            to_do = "its inputs may be out of its range"
            if what.startswith("step"):
                more, to_do, terminated = self._discarded()
                why += more
        failure = self._failure(f"failed to {what}", why, to_do)
        if terminated:
            failure = TerminatedError(str(failure))
        if status == FATAL:
            self._instance.abandon()
            self._slave = None
        elif status == PENDING:
            with suppress(Exception):
                self._slave.cancelStep()
        self._instance.failed = status >= ERROR or status < 0
        return failure

    def _discarded(self) -> tuple[str, str, bool]:
        """Return how far a step came, what to do, and whether the FMU wants no more steps."""
        reached, ended = ctypes.c_double(float("nan")), ctypes.c_int(0)
        slave = self._slave
        with suppress(Exception):
            slave.fmi2GetRealStatus(slave.component, _LAST_SUCCESSFUL_TIME, ctypes.byref(reached))
        with suppress(Exception):
            slave.fmi2GetBooleanStatus(slave.component, _TERMINATED, ctypes.byref(ended))
        until = f" It came to {reached.value:g} s." if reached.value == reached.value else ""
        if ended.value:
            to_do = "end the run before, or see why it ends"
            return f"{until} It wants to end the simulation (fmi2Terminated).", to_do, True
        return until, "take a smaller coupling step", False
