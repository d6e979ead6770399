"""Access to the C functions of FMI 3.0 with the methods of host.py: statuses are returned, messages are kept."""

import ctypes
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p

import numpy as np
from fmpy import fmi3, read_model_description

from builder.toolchain import this_platform

from .host import OK, Host, packed, saved, unpacked

__all__ = ["CO_SIMULATION", "MODEL_EXCHANGE", "Host3", "packed", "saved", "unpacked"]

#: Types of which an FMU has no variables.
OTHER_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "String")

#: Functions of clocks, and the number of arrays that follow the value references.
CLOCKS = {"GetClock": 1, "SetClock": 1, "GetIntervalDecimal": 2, "GetIntervalFraction": 3, "GetShiftDecimal": 1,
          "GetShiftFraction": 2, "SetIntervalDecimal": 1, "SetIntervalFraction": 2, "SetShiftDecimal": 1,
          "SetShiftFraction": 2}  # fmt: skip

CO_SIMULATION, MODEL_EXCHANGE, SCHEDULED_EXECUTION = "CoSimulation", "ModelExchange", "ScheduledExecution"


class Host3(Host):
    """An instance whose C functions are called directly.

    `update` is called as update(host, time) in every intermediate update, and `updates` keeps all arguments of each.
    """

    DERIVATIVES, STATE, DESERIALIZE = "GetContinuousStateDerivatives", "FMUState", "DeserializeFMUState"

    def __init__(self, folder, *, logging=False, token=None, name="instance", kind=CO_SIMULATION, update=None,
                 required=(), event_mode=False, has_log=True):  # fmt: skip
        self.description = read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.messages, self.updates, self.update = [], [], update
        identifier = self.description.coSimulation.modelIdentifier
        self.dll = ctypes.CDLL(str(folder / this_platform().member(identifier, 3)))
        self.log = fmi3.fmi3LogMessageCallback(
            lambda _environment, status, category, message: self.messages.append(
                (status, category.decode(), message.decode())
            )
        )
        self.callback = fmi3.fmi3IntermediateUpdateCallback(self._updated)
        token = self.description.instantiationToken if token is None else token
        first = [name.encode(), token.encode(), b"/nowhere/", c_bool(False), c_bool(logging)]
        log = self.log if has_log else None
        if kind == CO_SIMULATION:
            wanted = (c_uint * max(1, len(required)))(*required)
            first += [c_bool(event_mode), c_bool(True), wanted, c_size_t(len(required)), None, log]
            first += [None if update is None else self.callback]
        else:
            first += [None, log] + ([None] * 3 if kind == SCHEDULED_EXECUTION else [])
        make = getattr(self.dll, f"fmi3Instantiate{kind}")
        make.argtypes, make.restype = None, c_void_p
        self.c = make(*first)

    def _updated(self, _environment, time, *flags):
        *values, early, early_time = flags
        self.updates.append((time, *map(bool, values)))
        early[0], early_time[0] = True, time  # a request that the FMU may ignore, because it cannot return early
        self.update(self, time)

    def call(self, function, *arguments):
        """Return the status of fmi3<function>."""
        address = getattr(self.dll, f"fmi3{function}")
        address.argtypes, address.restype = None, c_int
        return address(c_void_p(self.c), *arguments)

    def enter(self, time=0.0, stop=None):
        return self.call("EnterInitializationMode", c_bool(False), c_double(0.0), c_double(time),
                         c_bool(stop is not None), c_double(stop or 0.0))  # fmt: skip

    def start(self, time=0.0, stop=None):
        assert self.enter(time, stop) == OK
        assert self.call("ExitInitializationMode") == OK
        return self

    def set_named(self, values):
        count = c_size_t(len(values))
        numbers = (c_double * len(values))(*values.values())
        return self.call("SetFloat64", self.of(values), count, numbers, count)

    def read(self, *names):
        """Return the status and the values."""
        count, values = c_size_t(len(names)), (c_double * max(1, len(names)))(*[np.nan] * len(names))
        return self.call("GetFloat64", self.of(names), count, values, count), list(values[: len(names)])

    def get(self, *names):
        status, values = self.read(*names)
        assert status == OK
        return values

    def step(self, time, step=1e-3):
        self.results = [c_bool(True), c_bool(True), c_bool(True), c_double(np.nan)]
        return self.call("DoStep", c_double(time), c_double(step), c_bool(True), *map(byref, self.results))

    def all(self):
        """Return all variables that FMI 2.0 has, too."""
        return self.get(*(v.name for v in self.description.modelVariables if v.type == "Float64" and v.name != "time"))

    def exchange(self, time=0.0):
        """Start an instance for model exchange, up to continuous-time mode."""
        self.start(time)
        assert self.discrete() == (OK, [False] * 5, 0.0)
        assert self.call("EnterContinuousTimeMode") == OK
        return self

    def discrete(self):
        """Return status, flags and time of fmi3UpdateDiscreteStates."""
        flags, time = [c_bool(True) for _ in range(5)], c_double(np.nan)
        status = self.call("UpdateDiscreteStates", *map(byref, flags), byref(time))
        return status, [flag.value for flag in flags], time.value

    def tangent(self, unknowns, knowns, seed, *, function="GetDirectionalDerivative"):
        """Return the status and the results of fmi3GetDirectionalDerivative, or of fmi3GetAdjointDerivative."""
        known_seed = function == "GetDirectionalDerivative"
        count = len(unknowns if known_seed else knowns)
        results = (c_double * max(1, count))(*[np.nan] * count)
        given = (c_double * max(1, len(seed)))(*seed)
        status = self.call(function, self.of(unknowns), c_size_t(len(unknowns)), self.of(knowns),
                           c_size_t(len(knowns)), given, c_size_t(len(seed)), results, c_size_t(count))  # fmt: skip
        return status, np.array(results[:count])

    def categories(self, on, *names):
        texts = (c_char_p * len(names))(*(name.encode() for name in names)) if names else None
        return self.call("SetDebugLogging", c_bool(on), c_size_t(len(names)), texts)

    def free(self):
        if self.c:
            free = self.dll.fmi3FreeInstance
            free.argtypes, free.restype = None, None
            free(c_void_p(self.c))
            self.c = None
