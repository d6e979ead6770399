"""The C functions of an FMU, with argument types and a record of the last call; FMI 3.0 with the names of FMI 2.0."""

from __future__ import annotations

import _ctypes
import ctypes
import math
import mmap
import os
import platform
import re
import shutil
import sys
import tempfile
from ctypes import POINTER, byref, c_bool, c_char_p, c_double, c_float, c_int, c_int32, c_int64, c_uint, c_void_p
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlparse

from eightpost.fmi import FUNCTIONS, OLD_TYPES, Description, function_name

WARNING: Final = 1
DISCARD: Final = 2
ERROR: Final = 3
FATAL: Final = 4
#: fmi2Type.
MODEL_EXCHANGE: Final = 0
CO_SIMULATION: Final = 1
#: fmi2StatusKind.
TERMINATED: Final = 3
#: Recorded name of the only call with NULL that the standard allows.
FREEING_NOTHING: Final = "fmi2FreeInstance(NULL)"
STATUS_NAMES: Final = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")

Logger = ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)


class Callbacks(ctypes.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = (
        ("logger", Logger),
        ("allocateMemory", c_void_p),
        ("freeMemory", c_void_p),
        ("stepFinished", c_void_p),
        ("componentEnvironment", c_void_p),
    )


class EventInfo(ctypes.Structure):
    """fmi2EventInfo."""

    _fields_ = (
        ("newDiscreteStatesNeeded", c_int),
        ("terminateSimulation", c_int),
        ("nominalsOfContinuousStatesChanged", c_int),
        ("valuesOfContinuousStatesChanged", c_int),
        ("nextEventTimeDefined", c_int),
        ("nextEventTime", c_double),
    )


class MissingFunctionError(Exception):
    """The binary does not export a function."""


class FmuLibrary:
    """A loaded binary.

    `call` writes the name of the function into the file `progress` first, so that it is known after a crash.
    `categories` are the log categories that its instances have used; `has_mixed` is whether an instance has called the
    logger of another one.
    """

    version = 2  #: Version of FMI.
    calls = 0  #: Number of calls that were begun in this process.
    place = ""  #: Place of the calls, for the message about a crash.

    def __init__(self, path: Path, progress: Path) -> None:
        self.path, self.progress = path, progress
        self.categories: set[bytes] = set()
        self.has_mixed = False
        with progress.open("r+b") as stream:
            stream.write(bytes(512))
            stream.flush()
            self._progress = mmap.mmap(stream.fileno(), 512)
        self._functions: dict[str, Any] = {}
        self._called: dict[str, Any] = {}  # by the names of FMI 2.0
        self.begin(f"loading {path.name}")
        self._library = ctypes.CDLL(str(path), mode=getattr(os, "RTLD_NOW", 0) | getattr(os, "RTLD_LOCAL", 0))

    def again(self) -> FmuLibrary:
        """Load a copy of the binary with separate static memory."""
        folder = tempfile.mkdtemp(prefix="eightpost_binary_", dir=self.path.parent)
        copy = self._copied(Path(shutil.copy2(self.path, folder)))
        copy.path, copy.categories = self.path, self.categories
        shutil.rmtree(folder, ignore_errors=True)  # on systems that can remove a loaded file, at most one copy remains
        return copy

    def unload(self) -> None:
        """Unload the binary, after which nothing of it may be called."""
        if sys.platform != "win32":
            self.begin("unloading of the binary")
            _ctypes.dlclose(self._library._handle)

    def _copied(self, path: Path) -> FmuLibrary:
        return FmuLibrary(path, self.progress)

    def begin(self, call: str, note: str = "") -> None:
        """Record the name of a call before it is made."""
        FmuLibrary.calls += 1
        text = f"{call}{note}{FmuLibrary.place}".encode()[:500]
        self._progress[: len(text) + 1] = text + b"\0"

    def call(self, name: str, *arguments: Any, note: str = "") -> int:
        """Call fmi2<name>; return its status.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        function = self._called.get(name)
        if function is None:
            function = self._called[name] = self.function(name)
        self.begin(f"fmi2{name}", note)
        return int(function(*arguments) or 0)

    def function(self, name: str) -> Any:
        """Return fmi2<name>.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        return self.native(name)

    def native(self, name: str) -> Any:
        """Return the function of the binary's own version of FMI, with the types of its arguments and of its result.

        Raises:
            MissingFunctionError: The function is not exported.
        """
        if name not in self._functions:
            in_c, types = f"fmi{self.version}{name}", FUNCTIONS[self.version][name]
            try:
                function = getattr(self._library, in_c)
            except AttributeError:
                raise MissingFunctionError(f"{in_c} is not exported") from None
            function.argtypes, function.restype = types.arguments, types.result
            self._functions[name] = function
        return self._functions[name]


def memory_functions() -> tuple[int | None, int | None]:
    """Return the addresses of calloc and free of the C library."""
    c = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
    calloc, free = (ctypes.cast(function, c_void_p).value for function in (c.calloc, c.free))
    return calloc, free


def binary_path(folder: Path, identifier: str, fmi: int) -> Path | None:
    """Return the binary for this platform in an unpacked FMU of an FMI version, 2 or 3.

    None if it does not exist, or if the identifier could name a file outside the FMU.
    """
    if not identifier.isidentifier():
        return None
    paths = (folder / name for name in binary_members(identifier, fmi))
    return next((path for path in paths if path.is_file()), None)


def binary_members(identifier: str, fmi: int) -> tuple[str, ...]:
    """Return the possible names of a binary for this platform in an archive of an FMI version, 2 or 3."""
    suffix = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    return tuple(f"binaries/{name}/{identifier}{suffix}" for name in platform_folders(fmi))


def platform_folders(fmi: int) -> tuple[str, ...]:
    """Return the folders of binaries/ for this platform: in FMI 2.0 its own name, then that of FMI 3.0."""
    system = {"win32": "win", "darwin": "darwin"}.get(sys.platform, "linux")
    machine = "aarch64" if platform.machine().lower() in ("arm64", "aarch64") else "x86_64"
    bits = "64" if sys.maxsize > 2**32 else "32"
    tuple_name = f"{machine}-{ {'win': 'windows'}.get(system, system) }"
    own = (f"{system}{bits}",) if machine == "x86_64" or system == "darwin" else ()
    return (tuple_name,) if fmi == 3 else (*own, tuple_name)


# ==== FMI 3.0 with the names and arguments of FMI 2.0 ================================================================

Logger3 = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
Update = ctypes.CFUNCTYPE(None, c_void_p, c_double, c_bool, c_bool, c_bool, c_bool, POINTER(c_bool), POINTER(c_double))

Clock = ctypes.CFUNCTYPE(None, c_void_p)

_INTEGERS = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
TYPES: Final[dict[str, Any]] = {name: getattr(ctypes, f"c_{name.lower()}") for name in _INTEGERS} | {
    "Float64": c_double, "Float32": c_float, "Boolean": c_bool, "String": c_char_p, "Enumeration": c_int64,
}  # fmt: skip

#: Type of FMI 3.0 for a reference that no variable has.
_USUAL = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "String": "String"}


def library_of(description: Description, path: Path, progress: Path) -> FmuLibrary:
    """Load a binary of either FMI version; see `FmuLibrary`."""
    return FmuLibrary3(description, path, progress) if description.fmi == 3 else FmuLibrary(path, progress)


@dataclass
class _Live:
    """Data of one instance: its callbacks, its experiment, and the inputs and derivatives for the next step."""

    callbacks: tuple[Any, ...] = ()
    experiment: tuple[Any, ...] = (0, 0.0, 0.0, 0, 0.0)
    inputs: dict[int, float] = field(default_factory=dict)
    slopes: dict[int, float] = field(default_factory=dict)
    begin: float = 0.0  #: Start of the last step [s].
    requests: list[float] = field(default_factory=list)  #: Times [s] of its updates in which inputs were requested.
    event: c_bool = field(default_factory=c_bool)  #: eventHandlingNeeded of the last step.
    terminate: c_bool = field(default_factory=c_bool)  #: terminateSimulation.
    early: c_bool = field(default_factory=c_bool)  #: earlyReturn.
    last: c_double = field(default_factory=c_double)  #: lastSuccessfulTime [s].


class FmuLibrary3(FmuLibrary):
    """A loaded binary of FMI 3.0; `call` and `function` take names and arguments of FMI 2.0."""

    version = 3
    unset = False  #: Value of the flags that a step returns before the FMU sets them.

    def __init__(self, description: Description, path: Path, progress: Path) -> None:
        super().__init__(path, progress)
        self._description = description
        self._natives = {int(v.reference): v.native for v in description.variables if v.is_callable}
        self._instances: dict[int, _Live] = {}

    def _copied(self, path: Path) -> FmuLibrary:
        return FmuLibrary3(self._description, path, self.progress)

    def function(self, name: str) -> Any:
        """Return a function with the arguments of fmi2<name>.

        Raises:
            MissingFunctionError: The function of FMI 3.0 is not exported.
        """
        kind = name[3:]
        if kind in _USUAL:
            return lambda *arguments: self._exchange(name[:3], kind, *arguments)
        if name == "FreeInstance":
            return self.native(name)
        return getattr(self, f"_{name}", None) or self.native(function_name(name))

    def begin(self, call: str, note: str = "") -> None:
        """Record the name of a call before it is made, with the function of FMI 3.0."""
        super().begin(_name_3(call), note)

    def live(self, address: int | None) -> _Live:
        """Return the data of an instance, with what its last step reported."""
        return self._instances.setdefault(address or 0, _Live())

    # ---- Life ------------------------------------------------------------------------------------------------------

    def _Instantiate(  # noqa: N802
        self, name: bytes, kind: int, guid: bytes, resources: bytes | None, callbacks: Any, visible: int, logging: int
    ) -> int | None:
        logger = callbacks._obj.logger
        live = _Live()
        log = Logger3(lambda _environment, status, category, text: logger(None, b"", status, category, text))
        update = Update(lambda *arguments: self._update(live, *arguments))
        live.callbacks = (log, update)
        place = None if resources is None else path_of(resources)
        if kind == CO_SIMULATION:
            required = self.intermediate_inputs
            references = (c_uint * len(required))(*required)
            none = ctypes.cast(c_void_p(None), Update)
            address = self.native("InstantiateCoSimulation")(
                name, guid, place, visible, logging, False, False, references, len(required), None, log,
                update if required else none,
            )  # fmt: skip
        else:
            address = self.native("InstantiateModelExchange")(name, guid, place, visible, logging, None, log)
        if address is None:
            return None
        self._instances[address] = live
        return int(address)

    @property
    def intermediate_inputs(self) -> list[int]:
        """References of the inputs that can be set in intermediate updates."""
        return [int(v.reference) for v in self._description.interpolated_inputs]

    def _SetupExperiment(self, address: int, *experiment: Any) -> int:  # noqa: N802
        self.live(address).experiment = experiment
        return 0

    def _EnterInitializationMode(self, address: int) -> int:  # noqa: N802
        return int(self.native("EnterInitializationMode")(address, *self.live(address).experiment))

    def _Reset(self, address: int) -> int:  # noqa: N802
        live = self.live(address)
        live.slopes.clear()
        live.inputs.clear()
        return int(self.native("Reset")(address))

    # ---- Values ----------------------------------------------------------------------------------------------------

    def _exchange(self, way: str, kind: str, address: int, references: Any, count: int, values: Any) -> int:
        """Set or get variables one after another if a type has several types in FMI 3.0."""
        if references is None or values is None:
            return int(self.native(f"{way}{_USUAL[kind]}")(address, references, count, None, count))
        natives = [self._native_of(reference, kind) for reference in references[:count]]
        if kind == "Real" and way == "Set":
            self.live(address).inputs.update((references[k], values[k]) for k in range(count))
        if kind in ("Real", "String") and set(natives) <= {_USUAL[kind]}:
            return int(self.native(f"{way}{_USUAL[kind]}")(address, references, count, values, count))
        worst = 0
        for k, native in enumerate(natives):
            buffer = (TYPES[native] * 1)(values[k])
            name = f"{way}{'Int64' if native == 'Enumeration' else native}"
            worst = max(worst, int(self.native(name)(address, (c_uint * 1)(references[k]), 1, buffer, 1)))
            if way == "Get":
                values[k] = buffer[0]
        return worst

    def _native_of(self, reference: int, kind: str) -> str:
        native = self._natives.get(reference, "")
        old = OLD_TYPES.get(native)
        return native if old == kind or (kind, old) == ("Integer", "Enumeration") else _USUAL[kind]

    def _SetRealInputDerivatives(self, address: int, references: Any, count: int, orders: Any, slopes: Any) -> int:  # noqa: N802
        if references is None or orders is None or slopes is None:
            return ERROR  # an FMU of FMI 3.0 has no such call
        known = set(self.intermediate_inputs)
        if any(orders[k] != 1 or references[k] not in known for k in range(count)):
            return ERROR
        self.live(address).slopes.update((references[k], slopes[k]) for k in range(count))
        return 0

    def _GetRealOutputDerivatives(self, address: int, references: Any, count: int, orders: Any, values: Any) -> int:  # noqa: N802
        numbers = (c_int32 * count)(*orders)
        return int(self.native("GetOutputDerivatives")(address, references, count, numbers, values, count))

    def _GetDirectionalDerivative(  # noqa: N802
        self, address: int, unknowns: Any, n_unknowns: int, knowns: Any, n_knowns: int, seed: Any, result: Any
    ) -> int:
        function = self.native("GetDirectionalDerivative")
        return int(function(address, unknowns, n_unknowns, knowns, n_knowns, seed, n_knowns, result, n_unknowns))

    # ---- Steps -----------------------------------------------------------------------------------------------------

    def _update(self, live: _Live, _environment: Any, time: float, set_requested: bool, *_others: Any) -> None:
        if not set_requested:
            return
        live.requests.append(time)
        for reference, slope in live.slopes.items():
            value = live.inputs.get(reference, self._start(reference)) + slope * (time - live.begin)
            address = next((a for a, one in self._instances.items() if one is live), 0)
            self.native("SetFloat64")(address, (c_uint * 1)(reference), 1, (c_double * 1)(value), 1)

    def _start(self, reference: int) -> float:
        variable = next(v for v in self._description.variables if v.reference == str(reference))
        return variable.number("start") or 0.0

    def _DoStep(self, address: int, time: float, h: float, final: int) -> int:  # noqa: N802
        live = self.live(address)
        live.begin = time
        live.requests.clear()
        live.event.value = live.terminate.value = live.early.value = self.unset
        live.last.value = math.nan if self.unset else time
        results = (byref(live.event), byref(live.terminate), byref(live.early), byref(live.last))
        status: int = self.native("DoStep")(address, time, h, bool(final), *results)
        for reference, slope in live.slopes.items():
            live.inputs[reference] = live.inputs.get(reference, self._start(reference)) + slope * h
        live.slopes.clear()
        return max(status, DISCARD) if live.terminate.value else status

    def _GetBooleanStatus(self, address: int, kind: int, value: Any) -> int:  # noqa: N802
        value._obj.value = int(kind == TERMINATED and self.live(address).terminate.value)
        return 0

    # ---- Model exchange --------------------------------------------------------------------------------------------

    def _NewDiscreteStates(self, address: int, info: Any) -> int:  # noqa: N802
        flags = [c_bool() for _ in range(5)]
        time = c_double()
        status = int(self.native("UpdateDiscreteStates")(address, *map(byref, flags), byref(time)))
        for (name, _), flag in zip(info._obj._fields_, flags, strict=False):
            setattr(info._obj, name, int(flag.value))
        info._obj.nextEventTime = time.value
        return status

    def _CompletedIntegratorStep(self, address: int, final: int, enter: Any, end: Any) -> int:  # noqa: N802
        flags = c_bool(), c_bool()
        status = int(self.native("CompletedIntegratorStep")(address, bool(final), *map(byref, flags)))
        enter._obj.value, end._obj.value = (int(flag.value) for flag in flags)
        return status


@cache
def _name_3(call: str) -> str:
    name, mark, rest = re.fullmatch(r"(\w*)(\W?)(.*)", call, re.DOTALL).groups()  # type: ignore[union-attr]
    return f"fmi3{function_name(name[4:])}{mark}{rest}" if name.startswith("fmi2") else call


def path_of(resources: bytes) -> bytes:
    """Return the path of a folder with a separator at its end (FMI 3.0) from its URI (FMI 2.0)."""
    from urllib.request import url2pathname  # noqa: PLC0415 -- a third of a probe's start, also of FMI 2.0

    return (url2pathname(urlparse(resources.decode()).path) + "/").encode()
