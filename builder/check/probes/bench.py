"""Bench of a probe: instances of an FMU, and the calls and runs that a probe makes."""

from __future__ import annotations

import ctypes
import itertools
import math
import random
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import c_char_p, c_double, c_int, c_int64, c_size_t, c_uint, c_uint64, c_void_p
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from builder.check.probes.library import (
    CO_SIMULATION,
    DISCARD,
    ERROR,
    STATUS_NAMES,
    TERMINATED,
    WARNING,
    Callbacks,
    FmuLibrary,
    Logger,
    MissingFunctionError,
    binary_path,
    library_of,
    memory_functions,
)
from builder.check.rules import Fault, listed
from eightpost.fmi import Description, Variable, read_description

Value = float | int | bool | str
C_TYPES: dict[str, Any] = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_char_p}


class CallError(Exception):
    """A call failed that had to succeed; the message contains its name, its status and the last log message."""


class TerminatedError(CallError):
    """The FMU has ended the simulation, which is allowed: a step returned fmi2Discard and the status is terminated."""


@dataclass(frozen=True)
class Message:
    """One log message."""

    status: int
    text: bytes


@dataclass(frozen=True)
class _Birth:
    """Arguments of fmi2Instantiate; `kind` is fmi2Type."""

    guid: str
    resources: str | None
    logging: bool = False
    kind: int = CO_SIMULATION
    name: str = "probe"


def base_type(variable: Variable) -> str:
    """Return the type of the functions that set and read a variable."""
    return "Integer" if variable.type == "Enumeration" else variable.type


def _c_type(variable: Variable) -> Any:
    """Return the type of C that holds any value of a variable; FMI 3.0 has integers of 64 bits."""
    if base_type(variable) != "Integer" or not variable.native:
        return C_TYPES[base_type(variable)]
    return c_uint64 if variable.native.startswith("U") else c_int64


def refused(status: int) -> bool:
    """Return whether a status rejects a call: fmi2Discard, fmi2Error, fmi2Fatal."""
    return status >= DISCARD


#: Addresses that instances hand back to their loggers; nothing is there.
_ENVIRONMENTS = itertools.count(0x1000, 0x10)


class Instance:
    """An instance of an FMU; `address` is None if fmi2Instantiate returned NULL."""

    def __init__(self, library: FmuLibrary, birth: _Birth) -> None:
        self.library = library
        self.messages: list[Message] = []
        self._logger = Logger(self._log)
        self._environment = next(_ENVIRONMENTS)
        self._callbacks = Callbacks(self._logger, *memory_functions(), None, self._environment)
        function = library.function("Instantiate")
        library.begin("fmi2Instantiate")
        self.address: int | None = function(
            birth.name.encode(), birth.kind, birth.guid.encode(), birth.resources and birth.resources.encode(),
            ctypes.byref(self._callbacks), 0, int(birth.logging),
        )  # fmt: skip

    def _log(self, environment: int | None, _name: bytes, status: int, category: bytes, text: bytes) -> None:
        self.library.has_mixed |= environment not in (None, self._environment)
        self.messages.append(Message(status, text or b""))
        self.library.categories.add(category or b"")

    def last_message(self) -> str:
        """Return the last logged warning or error as text to append to a message."""
        found = [m for m in self.messages if m.status >= WARNING]
        return f": {found[-1].text.decode('utf-8', 'replace').strip()[:300]}" if found else ""

    def call(self, name: str, *arguments: Any, note: str = "") -> int:
        """Call fmi2<name> with this instance as first argument."""
        return self.library.call(name, self.address, *arguments, note=note)

    def need(self, name: str, *arguments: Any, note: str = "") -> None:
        """Call a function that must succeed.

        Raises:
            CallError: The call failed.
        """
        status = self.call(name, *arguments, note=note)
        if refused(status):
            raise CallError(f"fmi2{name}{note} returned {status_name(status)}{self.last_message()}")

    def free(self) -> None:
        """Free the instance."""
        if self.address is not None:
            self.library.begin("fmi2FreeInstance")
            self.library.function("FreeInstance")(self.address)
            self.address = None

    def set(self, variable: Variable, value: Value) -> int:
        """Set one variable."""
        kind = base_type(variable)
        content = value.encode() if isinstance(value, str) else value
        buffer = (_c_type(variable) * 1)(content)
        return self.call(f"Set{kind}", _references([variable]), 1, buffer, note=f" of {variable.name} to {value}")

    def get(self, variable: Variable) -> tuple[int, Value]:
        """Get one variable."""
        kind = base_type(variable)
        buffer = (_c_type(variable) * 1)()
        status = self.call(f"Get{kind}", _references([variable]), 1, buffer, note=f" of {variable.name}")
        value = buffer[0]
        return status, (value or b"").decode("utf-8", "replace") if kind == "String" else value

    def set_reals(self, variables: Sequence[Variable], values: Sequence[float]) -> int:
        """Set Reals together."""
        if not variables:
            return 0
        return self.call("SetReal", _references(variables), len(variables), (c_double * len(variables))(*values))

    def get_reals(self, variables: Sequence[Variable]) -> tuple[int, list[float]]:
        """Get Reals together."""
        if not variables:
            return 0, []
        buffer = (c_double * len(variables))()
        status = self.call("GetReal", _references(variables), len(variables), buffer)
        return status, list(buffer)

    def reals(self, variables: Sequence[Variable]) -> list[float]:
        """Get Reals, which must succeed.

        Raises:
            CallError: The call failed.
        """
        status, values = self.get_reals(variables)
        if refused(status):
            raise CallError(f"fmi2GetReal returned {status_name(status)}{self.last_message()}")
        return values

    def step(self, time: float, h: float) -> int:
        """Do a step, after which earlier states will not be restored (noSetFMUStatePriorToCurrentPoint)."""
        return self.call("DoStep", time, h, 1, note=f" from {time!r} by {h!r} s")

    def advance(self, time: float, h: float) -> None:
        """Do a step that must succeed.

        Raises:
            TerminatedError: The FMU has ended the simulation, which is allowed.
            CallError: The step was rejected, or it failed: some FMUs report that as an end of the simulation and log an
                error.
        """
        before = len(self.messages)
        status = self.step(time, h)
        is_fault = any(m.status >= ERROR for m in self.messages[before:])
        if status == DISCARD and not is_fault and self.has_terminated():
            raise TerminatedError(f"the FMU ended the simulation itself in the step from {time!r} s by {h!r} s")
        if refused(status):
            raise CallError(f"fmi2DoStep from {time!r} by {h!r} s returned {status_name(status)}{self.last_message()}")

    def has_terminated(self) -> bool:
        """Return whether the step that returned fmi2Discard has ended the simulation (fmi2Terminated)."""
        value = c_int()
        try:
            status = self.call("GetBooleanStatus", TERMINATED, ctypes.byref(value))
        except MissingFunctionError:
            return False
        return not refused(status) and bool(value.value)

    def state(self) -> c_void_p:
        """Get a new FMU state, which must succeed."""
        state = c_void_p()
        self.need("GetFMUstate", ctypes.byref(state))
        return state

    def serialized(self, state: c_void_p) -> bytes:
        """Return the bytes of an FMU state, which must succeed."""
        size = c_size_t()
        self.need("SerializedFMUstateSize", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.need("SerializeFMUstate", state, buffer, size.value)
        return bytes(buffer.raw)

    def deserialize(self, content: bytes) -> tuple[int, c_void_p]:
        """Return the status and the deserialized state."""
        state = c_void_p()
        return self.call("DeSerializeFMUstate", content, len(content), ctypes.byref(state)), state

    def directional(self, unknown: Variable, *knowns: Variable) -> tuple[int, float]:
        """Return the status and the sum of d unknown / d known; not a number if the FMU sets no result."""
        count, result = len(knowns), (c_double * 1)(math.nan)
        seed = (c_double * count)(*[2.0] * count)  # an FMU may take it for 1
        status = self.call(
            "GetDirectionalDerivative", _references([unknown]), 1, _references(knowns), count, seed, result,
            note=f" of {unknown.name} by {listed([known.name for known in knowns])}",
        )  # fmt: skip
        return status, 0.5 * result[0]

    def set_derivatives(self, variables: Sequence[Variable], slopes: Sequence[float]) -> int:
        """Set first derivatives of inputs."""
        count = len(variables)
        orders = (c_int * count)(*[1] * count)
        return self.call("SetRealInputDerivatives", _references(variables), count, orders, (c_double * count)(*slopes))

    def output_derivatives(self, variables: Sequence[Variable], order: int) -> tuple[int, list[float]]:
        """Return the status and the output derivatives of an order."""
        count = len(variables)
        values = (c_double * count)()
        orders = (c_int * count)(*[order] * count)
        note = f" of order {order}"
        status = self.call("GetRealOutputDerivatives", _references(variables), count, orders, values, note=note)
        return status, list(values)


#: Arrays of value references by the variables' references: each step needs those of inputs and outputs.
_ARRAYS: dict[tuple[str, ...], Any] = {}


def _references(variables: Sequence[Variable]) -> Any:
    key = tuple([variable.reference for variable in variables])
    if key not in _ARRAYS:
        _ARRAYS[key] = (c_uint * len(key))(*map(int, key))
    return _ARRAYS[key]


def status_name(status: int) -> str:
    """Return the name of a status."""
    return STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else f"the unknown status {status}"


# ==== Bench of a probe: FMU instances and the calls that a probe makes ===============================================

#: Amplitude of the sine on an input by its SI unit, typical of a race car.
_AMPLITUDES = {"m/s": 0.2, "m": 0.005, "N": 200.0, "N.m": 200.0, "rad": 0.01}
_STEPS, _WHOLE = 300, 1000  # steps of a run, and of the default experiment if the FMU states none
_MOST, _MOST_INTERNAL = 10_000, 100  # without a stated step: most steps of an experiment, and internal steps in a step
_TOLERANCE = 1e-9  # largest difference of two equal runs by rounding, relative to the outputs' size
_CYCLES = 2.7  # not a multiple of 0.5, so that the middle of a run differs from its end


@dataclass(frozen=True)
class Skip:
    """A part of a probe that is skipped, and the reason; `what` is empty if the whole probe is skipped."""

    reason: str
    what: str = ""


@dataclass(frozen=True)
class Measured:
    """A value that the parent process compares."""

    name: str
    value: str


#: Name of the value for the number of steps after which the FMU ends the simulation itself.
REACH = "steps"

Result = Fault | Skip | Measured
Results = Iterator[Result]
Values = list[float]


@dataclass(frozen=True)
class _Timing:
    """Communication points of a run: start [s], step [s], number of steps, steps of the whole default experiment."""

    start: float
    step: float
    count: int
    whole: int

    def at(self, point: int) -> float:
        """Return the time of a point [s]."""
        return self.start + point * self.step


#: Binaries of which there has been an instance in this process.
_USED: set[Path] = set()


class Bench:
    """An unpacked FMU with its binary loaded.

    Args:
        folder: Folder of the unpacked FMU.
        progress: File for the name of the current call.
        reach: Number of steps after which the FMU ends the simulation itself; None if it does not.
        process: State of the process before an FMU was loaded.

    Raises:
        OSError: There is no binary for this platform, or it cannot be loaded.
    """

    def __init__(
        self, folder: Path, progress: Path, reach: int | None = None, process: Mapping[str, str] | None = None
    ) -> None:
        self.folder, self.process = folder, process or {}
        self.description: Description = read_description(ET.parse(folder / "modelDescription.xml").getroot())
        binary = binary_path(folder, self.description.identifier, self.description.fmi)
        if binary is None:
            raise OSError(f"there is no binary {self.description.identifier!r} for this platform")
        self.library = library_of(self.description, binary, progress)
        self.inputs = self.description.of("input")
        self.outputs = self.description.of("output")
        #: Start value, amplitude and limits of the sine on each input; computed once, because every step uses them.
        self._sines = [(v.number("start") or 0.0, amplitude(v), *_limits(v)) for v in self.inputs]
        timing = _timing(self.description)
        self.timing = timing if reach is None else replace(timing, count=max(1, min(timing.count, reach)))

    @property
    def birth(self) -> _Birth:
        """Arguments of fmi2Instantiate."""
        return _Birth(self.description.guid, (self.folder.resolve() / "resources").as_uri())

    @contextmanager
    def instance(self, birth: _Birth | None = None) -> Iterator[Instance]:
        """Provide an instance that is freed at the end.

        Raises:
            CallError: fmi2Instantiate returned NULL.
        """
        if self.library.path in _USED and self.description.can("canBeInstantiatedOnlyOncePerProcess"):
            self.library = self.library.again()  # with new static memory, as in another process
        _USED.add(self.library.path)
        created = Instance(self.library, birth or self.birth)
        if created.address is None:
            raise CallError(f"fmi2Instantiate returned NULL{created.last_message()}")
        try:
            yield created
        finally:
            created.free()

    @contextmanager
    def initializing(self, birth: _Birth | None = None, **times: float | None) -> Iterator[Instance]:
        """Provide an instance in initialization mode; `times` are those of `enter`."""
        with self.instance(birth) as created:
            self.enter(created, **times)
            yield created

    @contextmanager
    def running(
        self, inputs: Values | None = None, birth: _Birth | None = None, **times: float | None
    ) -> Iterator[Instance]:
        """Provide an initialized instance, with inputs that are set in initialization mode."""
        with self.initializing(birth, **times) as created:
            if inputs is not None:
                self.drive(created, inputs)
            created.need("ExitInitializationMode")
            yield created

    def enter(self, instance: Instance, *, start: float | None = None, stop: float | None = None) -> None:
        """Enter initialization mode from the state after fmi2Instantiate; `stop` is the stop time [s] or None."""
        begin = self.timing.start if start is None else start
        instance.need("SetupExperiment", 0, 0.0, begin, int(stop is not None), stop or 0.0)
        instance.need("EnterInitializationMode")

    def initialize(self, instance: Instance) -> None:
        """Initialize an instance from the state after fmi2Instantiate."""
        self.enter(instance)
        instance.need("ExitInitializationMode")

    def excitation(self, time: float, scale: float = 1.0) -> Values:
        """Return the inputs at a time [s]: a sine around each start value, between min and max."""
        phase = 2 * math.pi * _CYCLES * (time - self.timing.start) / (self.timing.step * self.timing.count)
        sines = (math.sin(phase + 0.7 * k) * scale for k in range(len(self._sines)))
        return [
            min(max(start + size * sine, low), high)
            for sine, (start, size, low, high) in zip(sines, self._sines, strict=True)
        ]

    def held(self, _time: float) -> Values:
        """Return the inputs at their start values."""
        return [v.number("start") or 0.0 for v in self.inputs]

    def run(self, instance: Instance, signal: Callable[[float], Values], points: range) -> list[Values]:
        """Step through points (first to last) with inputs set at the start of each step; return the outputs.

        Raises:
            CallError: A call was rejected.
        """
        rows = []
        for point in points:
            time = self.timing.at(point)
            self.drive(instance, signal(time))
            instance.advance(time, self.timing.step)
            rows.append(instance.reals(self.outputs))
        return rows

    def trace(self, instance: Instance, points: range) -> list[Values]:
        """Return the outputs now, and after each step through points with varying inputs."""
        return [instance.reals(self.outputs), *self.run(instance, self.excitation, points)]

    def drive(self, instance: Instance, values: Values) -> None:
        """Set all Real inputs, which must succeed.

        Raises:
            CallError: The call failed.
        """
        status = instance.set_reals(self.inputs, values)
        if refused(status):
            raise CallError(f"fmi2SetReal of inputs returned {status_name(status)}{instance.last_message()}")

    def all_points(self) -> range:
        """Return the points at which the steps of a whole run start."""
        return range(self.timing.count)


#: Sizes of parameters with the start value zero by unit, where 0.1 in SI units has no visible effect.
_FROM_ZERO = {"N/m": 1e3, "N/m2": 1e5}


def amplitude(variable: Variable) -> float:
    """Return the amplitude of an input around its start value, limited by its range."""
    start = variable.number("start") or 0.0
    size = _AMPLITUDES.get(variable.unit or "") or max(0.1 * abs(start), 0.1)
    return min([size, *(abs(end - start) for end in _limits(variable) if abs(end - start) > 0)])


def inside(variable: Variable, value: float) -> float:
    """Return a value clipped to a variable's min and max."""
    low, high = _limits(variable)
    return min(max(value, low), high)


def _limits(variable: Variable) -> tuple[float, float]:
    low, high = variable.number("min"), variable.number("max")
    return -math.inf if low is None else low, math.inf if high is None else high


def other_value(variable: Variable, draw: random.Random) -> float:
    """Return a random value in the range, within one amplitude (inputs) or 10 % (parameters) of the start value."""
    start = variable.number("start") or 0.0
    size = amplitude(variable) if variable.causality == "input" else (0.1 * abs(start) or _from_zero(variable))
    change = size * draw.uniform(-1.0, 1.0)
    if inside(variable, start + change) != start + change:
        change = -change  # at the end of the range, change in the other direction
    return inside(variable, start + change)


def set_other_parameters(bench: Bench, instance: Instance, draw: random.Random) -> None:
    """Set parameters to other values in initialization mode; a value that the FMU rejects is the start value again.

    Some FMUs accept a value and reject it when outputs are read, because it contradicts another parameter.
    """
    for variable in bench.description.of("parameter"):
        instance.set(variable, other_value(variable, draw))
        if refused(instance.get_reals(bench.outputs)[0]):
            instance.set(variable, variable.number("start") or 0.0)


def change_of(variable: Variable) -> float:
    """Return a change that is small compared with the variable and large compared with rounding errors."""
    start = abs(variable.number("start") or 0.0)
    return 1e-3 * (amplitude(variable) if variable.causality == "input" else start or _from_zero(variable))


def _from_zero(variable: Variable) -> float:
    return _FROM_ZERO.get(variable.unit or "", 0.1)


def differ(first: Sequence[Values], second: Sequence[Values]) -> float:
    """Return the largest difference of two runs, relative to the size of each output (0 if they are equal)."""
    sizes = [max((abs(v) for v in column), default=0.0) for column in zip(*first, strict=True)]
    worst = 0.0
    for one, other in zip(first, second, strict=True):
        for a, b, size in zip(one, other, sizes, strict=True):
            if a != b and not (math.isnan(a) and math.isnan(b)):
                worst = max(worst, abs(a - b) / (size or 1.0) if math.isfinite(a - b) else math.inf)
    return worst


def wrong_times(bench: Bench, instance: Instance, now: float) -> Iterator[Fault]:
    """Compare the time variables with the time [s] that the host has set."""
    for time in bench.description.of("independent"):
        (found,) = instance.reals([time])
        if abs(found - now) > _TOLERANCE * max(1.0, abs(now)):
            yield "time-variable", f"{time.name} is {found!r} s where the host is at {now!r} s"


def compare(pair: tuple[str, str], what: str, first: Sequence[Values], again: Sequence[Values]) -> Iterator[Fault]:
    """Compare two runs that must be equal: the first rule of the pair is for errors, the second one for rounding."""
    differs, rounds = pair
    worst = differ(first, again) if len(first) == len(again) else math.inf
    if worst > _TOLERANCE:
        yield differs, f"{what} by {worst:.1e} of the outputs' size"
    elif worst > 0.0:
        yield rounds, f"{what} by {worst:.1e}"


def _own_step(duration: float, description: Description) -> float:
    """Return a step for an FMU that states none: a thousandth of its experiment, or some of its internal steps."""
    size = duration / 1000 if duration > 0 else 1e-3
    try:
        internal = float((description.co_simulation or {}).get("fixedInternalStepSize", ""))
    except ValueError:
        return size
    return max(1, min(round(size / internal), _MOST_INTERNAL)) * internal if internal > 0.0 else size


def _timing(description: Description) -> _Timing:
    given = {}
    for name, text in (description.experiment or {}).items():
        try:
            given[name] = float(text)
        except ValueError:
            continue
    start = given.get("startTime", 0.0)
    duration = given.get("stopTime", start) - start
    size = given.get("stepSize") or _own_step(duration, description)
    whole = int(min(duration / size * (1 + 1e-9), 1e9)) if duration >= size > 0 else _WHOLE
    if "stepSize" not in given:
        whole = min(whole, _MOST)
    return _Timing(start, size, min(_STEPS, whole), whole)
