"""An instance of an FMU: typed calls of its C functions, and buffers for its variables."""

from __future__ import annotations

import ctypes
import os
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cosim.components.fmi2_slave import FMU2Elements
from cosim.components.fmi3_slave import FMU3Elements
from cosim.components.fmu_description import internal_step
from cosim.components.fmu_file import FmuFile, SharedFmu
from cosim.components.fmu_log import FmuLog
from cosim.components.functions import FunctionTable, address_of
from cosim.engine import blocks
from eightpost.errors import StepError

# ---- Buffers for the values of an FMU's variables -------------------------------------------------------------------

#: Name of the FMI functions for a type, and the C type of its values.
_KINDS: Mapping[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}


#: Number of integers of 32 bits that are not negative.
_INTEGERS = 1 << 31


@dataclass(frozen=True, slots=True)
class TypedBuffer:
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


# ---- Instance of an FMU in this process -----------------------------------------------------------------------------

#: All instances in this process: an FMU may allow only one, and fmi2Fatal applies to all instances of an FMU.
_instances: weakref.WeakSet[FmuInstance] = weakref.WeakSet()

#: Functions that every FMU must have.
_NEEDED = (
    "Instantiate", "FreeInstance", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "DoStep",
    "GetReal", "SetReal", "Terminate",
)  # fmt: skip


@dataclass(eq=False)
class State:
    """Saved state, with the time and the inputs at which it was saved."""

    pointer: Any
    time: float
    inputs: Mapping[str, float]


@dataclass(eq=False)
class FmuInstance:
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
    _buffers: dict[tuple[str, ...], tuple[TypedBuffer, ...]] = field(default_factory=dict)

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

    def buffers(self, names: Sequence[str]) -> tuple[TypedBuffer, ...]:
        """Return one buffer for each type of function that the variables need; String is not supported."""
        key = tuple(names)
        if key not in self._buffers:
            places: dict[str, list[int]] = {}
            for place, name in enumerate(key):
                places.setdefault(_KINDS[self.fmu.variables[name].type][0], []).append(place)
            buffers = []
            for kind, own in places.items():
                references = (ctypes.c_uint * len(own))(*[self.fmu.rows.references[key[place]] for place in own])
                buffers.append(TypedBuffer(kind, tuple(own), references, (_KINDS[kind][1] * len(own))()))
            self._buffers[key] = tuple(buffers)
        return self._buffers[key]

    def functions(self) -> FunctionTable:
        """Return the addresses of its functions for the loop; freeing a state is skipped after fmi2Fatal."""
        (instance, found), free = self.slave.addresses(), blocks.SAVE(self._free_for_the_loop)
        return FunctionTable(
            set_real=found["SetReal"],
            set_slopes=found["SetRealInputDerivatives"],
            do_step=found["DoStep"],
            get_real=found["GetReal"],
            save=found["GetFMUstate"],
            restore=found["SetFMUstate"],
            derive=found["GetDirectionalDerivative"],
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
        terminate = (
            terminate and not self.failed
        )  # after fmi2Error only freeing or a reset is allowed (FMI 2.0.4, 4.2.4)
        if terminate:
            with suppress(Exception):
                self.slave.terminate()
        if not (self.fmu.is_ours and terminate) or self.fmu.once:
            self.free_instance()

    def free_states(self) -> None:
        """Free all states, in use or spare."""
        pointers = [*(state.pointer for state in self.states), *self.spare]
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

    def _alike(self) -> Iterator[FmuInstance]:
        """Yield all instances of this FMU, including this one."""
        mine = self.fmu.description.guid
        yield from [
            i for i in list(_instances) if i is self or (i.slave is not None and i.fmu.description.guid == mine)
        ]

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
        self._check_not_held()
        place = Path.cwd()
        try:
            self.slave = slave = loaded(self.fmu, self.name)
            self._check_functions(slave)
            slave.begin(self.log)
        except BaseException:
            self.free_instance()
            raise
        finally:
            os.chdir(place)  # fmpy stays in the library's folder if the library cannot be loaded
        return slave

    def _check_functions(self, slave: Any) -> None:
        can = self.fmu.capabilities
        needed = [*_NEEDED, *(["SetRealInputDerivatives"] if can.interpolates_inputs else [])]
        needed += ["GetFMUstate", "SetFMUstate", "FreeFMUstate"] if can.state else []
        if missing := slave.missing(needed):
            raise LookupError(f"its library has no {', '.join(missing)}")

    def _check_not_held(self) -> None:
        holder = next((i for i in self._alike() if i is not self), None)
        if self.fmu.once and holder is not None:
            raise StepError(
                f"component {self.name!r} ({self.fmu.path.name}) allows one instance per process, and component "
                f"{holder.name!r} has it; run each in its own process: --isolate, IsolatedComponent"
            )


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
