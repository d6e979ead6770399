"""An FMU of FMI 2.0 or 3.0 for co-simulation as a component of this process."""

from __future__ import annotations

import ctypes
import math
import os
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fmpy import fmi1, fmi2

from cosim.components.component import FunctionTable, address_of
from cosim.components.fmu_calls import FMU2Elements, FMU3Elements
from cosim.components.fmu_description import internal_step
from cosim.components.fmu_file import FmuFile, SharedFmu
from cosim.components.watch import ADVICE, FmuLog, OpenedFmu, Surroundings, calling, returned
from cosim.engine import blocks
from eightpost.errors import EightpostError, StepError, TerminatedError
from eightpost.fmi import DISCARD, ERROR, FATAL, PENDING

# ==== An instance of an FMU: what outlives a run and must be freed in order ==========================================

#: Name of the FMI functions for a type, and the C type of its values.
_KINDS: Mapping[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}

#: Number of integers of 32 bits that are not negative.
_INTEGERS = 1 << 31

#: Functions that every FMU must have.
_NEEDED = (
    "Instantiate", "FreeInstance", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "DoStep",
    "GetReal", "SetReal", "Terminate",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _TypedBuffer:
    """Values of one type, with the references of their variables."""

    kind: str  #: Real, Integer or Boolean, as in fmi2GetReal.
    places: tuple[int, ...]  #: Positions of the values among all requested values.
    references: Any  #: Value references (C array).
    buffer: Any  #: Values (C array).

    def number(self, value: float) -> float | int:
        """Return a value converted to the type of the buffer.

        Raises:
            OverflowError: An integer does not fit into 32 bits.
        """
        if self.kind == "Real":
            return value
        if self.kind == "Boolean":
            return int(value != 0.0)
        if not -_INTEGERS <= round(value) < _INTEGERS:
            raise OverflowError(f"the integer {value:.0f} does not fit into 32 bits")
        return round(value)


@dataclass(eq=False)
class State:
    """Saved state, with the time and the inputs at which it was saved."""

    place: Any  #: Pointer to the state; its number if another process holds it.
    time: float
    inputs: Mapping[str, float]


#: All instances in this process: an FMU may allow only one, and fmi2Fatal applies to all instances of an FMU.
_instances: weakref.WeakSet[_FmuInstance] = weakref.WeakSet()


@dataclass(eq=False)
class _FmuInstance:
    """Objects that outlive a run and must be freed in order: states, the instance, libraries, the folder."""

    fmu: FmuFile  #: Unpacked FMU.
    name: str  #: Name of the component.
    log: FmuLog  #: Log for the FMU's messages.
    #: Shared FMU, referenced so that its folder exists until the end; None if the folder is managed elsewhere.
    shared: SharedFmu | None = None
    slave: Any = None
    states: list[State] = field(default_factory=list)
    spare: list[Any] = field(default_factory=list)
    failed: bool = False
    dead: bool = False
    _buffers: dict[tuple[str, ...], tuple[_TypedBuffer, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _instances.add(self)

    def ready(self) -> Any:
        """Return an instance in its initial state: the last run's after a reset, or a new one.

        Raises:
            StepError: Another component holds an FMU that allows one instance, or an instance of it failed fatally.
            Exception: The FMU cannot be loaded or instantiated.
        """
        if self.dead:
            raise StepError(
                f"component {self.name!r} ({self.fmu.path.name}) failed fatally before (fmi{self.fmu.version}Fatal): "
                "none of its functions may be called any more in this process; load it again, or run it in its own "
                "process: --isolate, IsolatedComponent"
            )
        return self._reset() or self._new()

    def buffers(self, names: Sequence[str]) -> tuple[_TypedBuffer, ...]:
        """Return one buffer for each type of function that the variables need; String is not supported."""
        key = tuple(names)
        if key not in self._buffers:
            places: dict[str, list[int]] = {}
            for place, name in enumerate(key):
                places.setdefault(_KINDS[self.fmu.variables[name].type][0], []).append(place)
            buffers = []
            for kind, rows in places.items():
                references = (ctypes.c_uint * len(rows))(*[self.fmu.rows.references[key[place]] for place in rows])
                buffers.append(_TypedBuffer(kind, tuple(rows), references, (_KINDS[kind][1] * len(rows))()))
            self._buffers[key] = tuple(buffers)
        return self._buffers[key]

    def functions(self) -> FunctionTable:
        """Return the addresses of its functions for the loop; freeing a state is skipped after fmi2Fatal."""
        (instance, addresses), free = self.slave.addresses(), blocks.STATE(self._free_for_the_loop)
        return FunctionTable(
            set_real=addresses["SetReal"],
            set_slopes=addresses["SetRealInputDerivatives"],
            do_step=addresses["DoStep"],
            get_real=addresses["GetReal"],
            save=addresses["GetFMUstate"],
            restore=addresses["SetFMUstate"],
            derive=addresses["GetDirectionalDerivative"],
            free=0 if self.slave.missing(["FreeFMUstate"]) else address_of(free),
            instance=instance,
            references=self.fmu.rows.references,
            keep=free,
        )

    def finish(self, *, terminate: bool) -> None:
        """Terminate if it stepped without an error; free the instance unless its reset can be relied on."""
        if self.slave is None:
            return
        self.free_states()
        terminate = terminate and not self.failed  # after fmi2Error only freeing or a reset is allowed (2.0.4, 4.2.4)
        if terminate:
            with suppress(Exception):
                self.slave.terminate()
        if not (self.fmu.is_ours and terminate) or self.fmu.once:
            self.free_instance()

    def free_states(self) -> None:
        """Free all states, in use or spare."""
        pointers = [*(state.place for state in self.states), *self.spare]
        self.states.clear()
        self.spare.clear()
        for pointer in pointers:
            with suppress(Exception):
                self.slave.free_state(ctypes.byref(pointer))

    def free_instance(self) -> None:
        """Free the instance, which has terminated or failed, and unload its library."""
        slave, self.slave, self.failed = self.slave, None, False
        if slave is None:
            return
        with suppress(Exception):
            if slave.component:
                slave.freeInstance()
            else:
                slave.freeLibrary()

    def abandon(self) -> None:
        """Never call this FMU again, even to free it: fmi2Fatal applies to all its instances (FMI 2.0.4, 2.1.3)."""
        for other in self._alike():
            other.slave, other.dead = None, True
            if other.shared is not None:
                other.shared.forget()
            other.states.clear()
            other.spare.clear()

    def release(self, owner: int) -> None:
        """Free everything, except in a process that was forked off the owner, which still needs it."""
        if os.getpid() != owner:
            return
        self.free_states()
        self.free_instance()
        if not self.dead:
            self.log.close()
        self.shared = None

    def _alike(self) -> list[_FmuInstance]:
        mine = self.fmu.description.guid
        return [i for i in list(_instances) if i is self or (i.slave is not None and i.fmu.description.guid == mine)]

    def _free_for_the_loop(self, _instance: int, pointer: int) -> int:
        if self.dead or self.slave is None:
            return 0
        status: int = self.slave.free_state(ctypes.cast(pointer, ctypes.POINTER(ctypes.c_void_p)))
        return status

    def _reset(self) -> Any:
        """Return the last run's instance after a reset; None if there is no instance or it cannot be reset."""
        slave = self.slave
        if slave is None:
            return None
        errors = self.log.errors
        with suppress(Exception):
            slave.reset()
            slave.setDebugLogging(True, [])
            if self.log.errors == errors:
                return slave
        self.free_instance()
        return None

    def _new(self) -> Any:
        holder = next((i for i in self._alike() if i is not self), None)
        if self.fmu.once and holder is not None:
            raise StepError(
                f"component {self.name!r} ({self.fmu.path.name}) allows one instance per process, and component "
                f"{holder.name!r} has it; run each in its own process: --isolate, IsolatedComponent"
            )
        place = Path.cwd()
        try:
            self.slave = slave = loaded(self.fmu, self.name)
            can = self.fmu.capabilities
            needed = [*_NEEDED, *(["SetRealInputDerivatives"] if can.interpolates_inputs else [])]
            needed += ["GetFMUstate", "SetFMUstate", "FreeFMUstate"] if can.state else []
            if missing := slave.missing(needed):
                raise LookupError(f"its library has no {', '.join(missing)}")
            slave.begin(self.log)
        except BaseException:
            self.free_instance()
            raise
        finally:
            os.chdir(place)  # fmpy stays in the library's folder if the library cannot be loaded
        return slave


def loaded(fmu: FmuFile, name: str, *, compile_calls: bool = True) -> Any:
    """Return an instance whose library is loaded, before `begin` instantiates it.

    Args:
        fmu: Unpacked FMU.
        name: Name of the instance.
        compile_calls: Whether the calls of the loop are machine code in FMI 3.0; see `FMU3Elements`.
    """
    options: dict[str, Any] = {
        "guid": fmu.description.guid,
        "unzipDirectory": str(fmu.folder.absolute()),
        "modelIdentifier": fmu.identifier,
        "instanceName": name,
    }
    if fmu.version == 2:
        return FMU2Elements(str(fmu.library), **options)
    return FMU3Elements(fmu.rows, slack=internal_step(fmu.description), compile_calls=compile_calls, **options)


# ==== Component ======================================================================================================

_REASONS = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"}


class FmuComponent(OpenedFmu):
    """One instance of an FMU in this process. Names are resolved once per set of names, so that stepping is fast.

    The instance of an FMU that this project built is kept after a run and reset for the next one; that of any other is
    freed after each run and created again for the next. An FMU that crashes ends this process, and an FMU that hangs
    blocks it, until a command is ended after the time limit: see IsolatedComponent. Every call of a run raises
    StepError if the component has not begun or the FMU refuses it. Values are in the FMU's own units; 1 is true.

    Args:
        path: FMU file (.fmu).
        name: Name of the component.
        compile_missing: Whether to compile the FMU's sources if it has no binary for this platform.
        folder: Folder in which the FMU is unpacked already; None unpacks it into a temporary folder, shared by all
            components of this FMU.

    Raises:
        FmuError: The file is missing, damaged or unsafe, is not an FMU of FMI 2.0 or 3.0 for co-simulation, or has no
            binary for this platform.
    """

    def __init__(
        self, path: str | Path, name: str, *, compile_missing: bool = False, folder: str | Path | None = None
    ) -> None:
        shared = SharedFmu.of(path, compile_missing=compile_missing) if folder is None else None
        fmu = FmuFile.unpacked(path, folder or "") if shared is None else shared.fmu
        self._log = FmuLog(name, fmu.names_in_log, fmu.folder)
        super().__init__(fmu, name, self._log.messages)
        self._instance = _FmuInstance(fmu, name, self._log, shared)
        # close() releases everything: on call, or when the component or the interpreter ends; runs may precede it.
        self.close = weakref.finalize(self, self._instance.release, os.getpid())
        self._slave: Any = None
        self._steps = self._begun = False
        self._start_time = 0.0
        self._label = f"{name!r} ({fmu.path.name})"
        #: Whether it shares this process with others: calls are recorded, and changes of the process undone.
        self.is_guarded = folder is None
        self._surroundings = Surroundings.now()

    @property
    def usable(self) -> bool:
        """False after fmi2Fatal: then no function of this FMU may be called in this process."""
        return not self._instance.dead

    def blame(self, changed: str) -> None:
        """Record that the FMU changed shared state, described by `changed`; the change has been undone."""
        self._changed[f"it changed {changed}; that was undone"] = None

    def functions(self) -> FunctionTable:
        """Return the addresses of the running instance's functions, for the loop."""
        self._running()
        return self._instance.functions()

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call of the loop that the FMU refused, and handle the instance accordingly.

        Args:
            what: Name of the failed call: "step", "set inputs".
            status: fmi2Status that the FMU returned.
            time: Time at which the step begins [s].
            inputs: Input values of the call, in the FMU's own units.
        """
        self._stand(time, self._inputs | dict(inputs))
        return self._refusal(what, status, f"fmi{self._fmu.version}DoStep" if what == "step" else "it")

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Create an instance, or reset the last run's if it was kept, set parameters and enter initialization.

        Args:
            start: Time at which the run starts [s].
            stop: Time at which the run ends [s]; infinity if it is not known.
            parameters: Values by name, in the FMU's own units.
        """
        self.finish()
        self._stand(start, {})
        self._start_time = start
        self._changed.clear()
        self._surroundings = Surroundings.now()
        with self._guard("instantiate"):
            self._slave = self._ready()
        self._log.messages.clear()
        for name, value in parameters.items():
            self._call_without_error(f"set {name} = {value!r}", self._set_parameter, name, value)
        end = None if stop == math.inf else stop
        self._call("set up the experiment", self._slave.setupExperiment, startTime=start, stopTime=end)
        self._call("enter initialization", self._slave.enterInitializationMode)

    def end_initialization(self) -> None:
        """Leave initialization mode."""
        self._call_without_error("leave initialization", self._running().exitInitializationMode)
        self._steps = True
        self._call("limit its log", self._limit_log)

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set inputs (N,) of any type but String."""
        slave = self._running()
        self._inputs.update(zip(names, values, strict=True))
        for part in self._instance.buffers(names):
            try:
                part.buffer[:] = [part.number(values[place]) for place in part.places]
            except OverflowError as error:
                raise self._failure("failed to set inputs", f"{error}.") from error
            self._call("set inputs", slave.set_values, part.kind, part.references, part.buffer)

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set first derivatives (N,) of real inputs (N,), per second, for the next step; see `capabilities`."""
        slave = self._running()
        (part,), count = self._instance.buffers(names), len(names)
        orders, slopes = (ctypes.c_int * count)(*[1] * count), (ctypes.c_double * count)(*values)
        arguments = ("SetRealInputDerivatives", part.references, count, orders, slopes)
        self._call("set input derivatives", slave.call, *arguments)

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the values (N,) of variables (N,) of any type but String."""
        slave, values = self._running(), [0.0] * len(names)
        for part in self._instance.buffers(names):
            self._call("get outputs", slave.get_values, part.kind, part.references, part.buffer)
            for place, value in zip(part.places, part.buffer, strict=True):
                values[place] = float(value)
        return values

    def derive(self, outputs: Sequence[str], inputs: Sequence[str], changes: Sequence[float]) -> list[float]:
        """Return how real outputs (N,) change, without delay, with small changes (M,) of real inputs (M,)."""
        slave, steps = self._running(), (ctypes.c_double * len(inputs))(*changes)
        (sought,), (into,) = self._instance.buffers(outputs), self._instance.buffers(inputs)
        arguments = (sought.references, len(outputs), into.references, len(inputs), steps, sought.buffer)
        self._call("give directional derivatives", slave.call, "GetDirectionalDerivative", *arguments)
        return list(sought.buffer)

    def step(self, time: float, step: float) -> None:
        """Make one step from `time` by `step` [s]; if no state is saved, tell the FMU that it will not be repeated."""
        slave = self._running()
        self._time = time
        final = 0 if self._instance.states else 1
        self._call(f"step from {time:g} s by {step:g} s", slave.call, "DoStep", time, step, final)
        self._time = time + step

    def save(self) -> object:
        """Return the current state, for `restore`; it is freed by `free` or at the end of the run."""
        slave = self._running()
        self._check_state()
        pointer = self._instance.spare.pop() if self._instance.spare else fmi2.fmi2FMUstate()
        self._call("save its state", slave.call, "GetFMUstate", ctypes.byref(pointer))
        state = State(pointer, self._time, dict(self._inputs))
        self._instance.states.append(state)
        return state

    def restore(self, state: object) -> None:
        """Restore a state that `save` returned; the state remains valid."""
        slave, saved = self._running(), self._saved(state)
        self._call("restore a state", slave.call, "SetFMUstate", saved.place)
        self._stand(saved.time, saved.inputs)

    def free(self, state: object) -> None:
        """Free a state; its memory is used by the next `save`."""
        saved = self._saved(state)
        self._instance.states.remove(saved)
        self._instance.spare.append(saved.place)

    def finish(self) -> None:
        """Terminate, and free the instance unless it can be reset for the next `begin`."""
        slave, self._slave = self._slave, None
        steps, self._steps = self._steps, False
        if slave is not None:
            with self._guard("terminate"):
                self._instance.finish(terminate=steps)

    @contextmanager
    def _guard(self, what: str) -> Iterator[None]:
        """Record that the FMU is called to do something, and undo the changes of the call to shared state."""
        if not self.is_guarded:
            yield
            return
        try:
            with calling(self._label, what):
                yield
        finally:
            for changed in self._surroundings.restore():
                self.blame(changed)

    def _saved(self, state: object) -> State:
        if not isinstance(state, State) or state not in self._instance.states:
            raise self._unknown_state()
        return state

    def _running(self) -> Any:
        # fmi2Fatal of another instance of this FMU ends this one too.
        if self._slave is None or self._instance.slave is None:
            raise self._not_begun()
        return self._slave

    def _ready(self) -> Any:
        try:
            return self._instance.ready()
        except EightpostError:
            raise
        except Exception as error:  # fmpy raises bare Exceptions if it cannot load or instantiate
            raise self._failure("failed to instantiate", f"{error}.", self._advice_on_instantiation()) from error
        finally:
            self._begun = True

    def _advice_on_instantiation(self) -> str:
        if self._fmu.needs_tool:
            return "install the tool that made it; the FMU cannot run without it (needsExecutionTool)"
        if self._begun and not self._fmu.is_ours:
            return (
                "some FMUs allow only one instance per process: run it in processes of its own: --isolate, "
                "IsolatedComponent"
            )
        return ""

    def _limit_log(self) -> None:
        """Log only warnings and errors from here on: a debug message in every step would cost more than the step."""
        categories = sorted(self._fmu.log_categories & _REASONS)
        with suppress(fmi1.FMICallException):  # an FMU without this function keeps its log as it is
            self._slave.setDebugLogging(bool(categories), categories)

    def _set_parameter(self, name: str, value: float | bool | str) -> None:
        kind, reference = self.variables[name].type, (ctypes.c_uint * 1)(self._fmu.rows.references[name])
        if kind == "Real":
            values: Any = (ctypes.c_double * 1)(float(value))
        elif kind == "String":
            values = (ctypes.c_char_p * 1)(str(value).encode())
        else:
            values = (ctypes.c_int * 1)(bool(value) if kind == "Boolean" else int(value))
        self._slave.set_values("Integer" if kind == "Enumeration" else kind, reference, values)

    def _call(self, what: str, function: Callable[..., Any], *arguments: Any, **options: Any) -> None:
        try:
            with self._guard(what):
                function(*arguments, **options)
        except fmi1.FMICallException as error:
            raise self._refusal(what, error.status, error.function) from error
        except (OSError, AttributeError) as error:  # Windows raises OSError if an FMU accesses invalid memory
            raise self._failure(f"failed to {what}", f"{error}.") from error

    def _call_without_error(self, what: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Make a call that also fails if the FMU logs an error: some FMUs (PythonFMU's) report it nowhere else."""
        errors = self._log.errors
        self._call(what, function, *arguments)
        if self._log.errors > errors:
            raise self._failure(f"failed to {what}", "it logged an error.")

    def _refusal(self, what: str, status: int, function: str) -> StepError:
        """Return the error for an FMI status above a warning, and apply the FMI rules for later calls."""
        why, to_do, terminated = returned(status, function, self._fmu.version), self._advice(what, status), False
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
        """Return how far a step came, what to do, and whether the FMU ended the simulation."""
        reached, ended = self._slave.last_step()
        until = f" It reached {reached:g} s." if math.isfinite(reached) else ""
        if ended:
            to_do = "end the run before that time, or find out why it ends"
            how = "fmi2Terminated" if self._fmu.version == 2 else "terminateSimulation"
            return f"{until} It ended the simulation ({how}).", to_do, True
        return until, "use a smaller coupling step", False

    def _advice(self, what: str, status: int) -> str:
        """Return what to do about a call that was refused with a status."""
        is_first = what.startswith("step") and self._time <= self._start_time  # later steps have the same size
        if is_first and status == ERROR and not self.capabilities.variable_step:
            only = self.capabilities.only_step
            size = "the size that its maker names" if only is None else f"{only:g} s"
            return f"it accepts steps of one size only: give {size} as the coupling step (step, --step)"
        return ADVICE.get(status, "tell its maker")
