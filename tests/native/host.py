"""Access to an FMU's C functions: every call returns its status, and all messages are kept."""

import ctypes

import numpy as np
from fmpy import fmi2, read_model_description

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
MODEL_EXCHANGE, CO_SIMULATION = fmi2.fmi2ModelExchange, fmi2.fmi2CoSimulation


class Host:
    """An instance whose C functions are called directly: statuses are returned, messages are kept."""

    #: Names that differ between FMI 2.0 and 3.0.
    DERIVATIVES, STATE, DESERIALIZE = "GetDerivatives", "FMUstate", "DeSerializeFMUstate"

    def __init__(self, folder, *, logging=False, guid=None, name="instance", kind=fmi2.fmi2CoSimulation):
        self.description = read_model_description(str(folder))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.messages = []
        identifier = self.description.coSimulation.modelIdentifier
        self.slave = fmi2.FMU2Slave(
            guid=self.description.guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName=name
        )
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda _e, _n, status, category, message: self.messages.append(
                (status, category.decode(), message.decode())
            )
        )
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self.component = self.slave.dll.fmi2Instantiate
        self.component.restype = ctypes.c_void_p
        guid = self.description.guid if guid is None else guid
        self.c = self.component(
            name.encode(), kind, guid.encode(), b"file:///nowhere", ctypes.byref(self.callbacks), 0, int(logging)
        )

    def call(self, function, *arguments):
        """Return the status of fmi2<function>."""
        address = getattr(self.slave.dll, f"fmi2{function}")
        address.argtypes, address.restype = None, ctypes.c_int
        return address(ctypes.c_void_p(self.c), *arguments)

    def start(self, time=0.0, stop=None):
        assert self.call("SetupExperiment", 0, ctypes.c_double(0.0), ctypes.c_double(time), int(stop is not None),
                         ctypes.c_double(stop or 0.0)) == OK  # fmt: skip
        assert self.call("EnterInitializationMode") == OK
        assert self.call("ExitInitializationMode") == OK
        return self

    def set(self, **values):
        return self.set_named({name.replace("__", "."): value for name, value in values.items()})

    def of(self, names):
        """Return the value references of variables."""
        return (ctypes.c_uint * max(1, len(names)))(*(self.references[n] for n in names))

    def set_named(self, values):
        count, numbers = len(values), (ctypes.c_double * len(values))(*values.values())
        return self.call("SetReal", self.of(values), ctypes.c_size_t(count), numbers)

    def set_slopes(self, values, order=1):
        orders = (ctypes.c_int * len(values))(*[order] * len(values))
        slopes = (ctypes.c_double * len(values))(*values.values())
        return self.call("SetRealInputDerivatives", self.of(values), ctypes.c_size_t(len(values)), orders, slopes)

    def get(self, *names):
        values = (ctypes.c_double * len(names))()
        assert self.call("GetReal", self.of(names), ctypes.c_size_t(len(names)), values) == OK
        return list(values)

    def step(self, time, step=1e-3):
        return self.call("DoStep", ctypes.c_double(time), ctypes.c_double(step), 1)

    def all(self):
        return self.get(*(v.name for v in self.description.modelVariables if v.type == "Real"))

    def inputs(self):
        return [v.name for v in self.description.modelVariables if v.causality == "input"]

    def run(self, steps=20, time=0.0, seed=1):
        """Make steps of 1 ms with random inputs; return all variables after each."""
        rng, rows = np.random.default_rng(seed), []
        for k in range(steps):
            values = dict(zip(self.inputs(), rng.uniform(-0.3, 0.3, len(self.inputs())), strict=True))
            assert self.set_named(values) == OK
            assert self.step(time + k * 1e-3) == OK
            rows.append(self.all())
        return rows

    def exchange(self, time=0.0):
        """Start an instance for model exchange, up to continuous-time mode."""
        info = fmi2.fmi2EventInfo()
        self.start(time)
        assert self.call("NewDiscreteStates", ctypes.byref(info)) == OK
        assert self.call("EnterContinuousTimeMode") == OK
        return self

    @property
    def state_names(self):
        return [unknown.variable.derivative.name for unknown in self.description.derivatives]

    @property
    def derivative_names(self):
        return [unknown.variable.name for unknown in self.description.derivatives]

    def set_states(self, values):
        count = len(values)
        return self.call("SetContinuousStates", (ctypes.c_double * max(1, count))(*values), ctypes.c_size_t(count))

    def _numbers(self, function):
        count = len(self.state_names)
        values = (ctypes.c_double * max(1, count))()
        assert self.call(function, values, ctypes.c_size_t(count)) == OK
        return np.array(values[:count])

    def states(self):
        return self._numbers("GetContinuousStates")

    def derivatives(self):
        return self._numbers(self.DERIVATIVES)

    def nominals(self):
        return self._numbers("GetNominalsOfContinuousStates")

    def tangent(self, unknowns, knowns, direction):
        """Return the status and the results of fmi2GetDirectionalDerivative."""
        results = (ctypes.c_double * max(1, len(unknowns)))(*[np.nan] * len(unknowns))
        seed, size = (ctypes.c_double * max(1, len(knowns)))(*direction), ctypes.c_size_t
        status = self.call("GetDirectionalDerivative", self.of(unknowns), size(len(unknowns)), self.of(knowns),
                           size(len(knowns)), seed, results)  # fmt: skip
        return status, np.array(results[: len(unknowns)])

    def outputs(self):
        return [v.name for v in self.description.modelVariables if v.causality == "output"]

    def messages_text(self):
        return " ".join(message for _, _, message in self.messages)

    def free(self):
        if self.c:
            free = self.slave.dll.fmi2FreeInstance
            free.argtypes, free.restype = None, None
            free(ctypes.c_void_p(self.c))
            self.c = None


def saved(fmu):
    state = ctypes.c_void_p()
    assert fmu.call(f"Get{fmu.STATE}", ctypes.byref(state)) == OK
    return state


def packed(fmu, state):
    size = ctypes.c_size_t()
    assert fmu.call(f"Serialized{fmu.STATE}Size", state, ctypes.byref(size)) == OK
    content = (ctypes.c_char * size.value)()
    assert fmu.call(f"Serialize{fmu.STATE}", state, content, size) == OK
    return content.raw


def unpacked(fmu, content):
    state, data = ctypes.c_void_p(), (ctypes.c_char * len(content))(*content)
    return fmu.call(fmu.DESERIALIZE, data, ctypes.c_size_t(len(content)), ctypes.byref(state)), state
