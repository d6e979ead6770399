"""Library of an FMI 3.0 FMU with the functions of FMI 2.0, so that the rest of the program calls both alike."""

from __future__ import annotations

import ctypes
import logging
import os
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any
from urllib.parse import urlparse
from urllib.request import url2pathname

from cosim.components.fmi2_library import MissingFunction
from cosim.components.fmi3_functions import ERROR, INT, B, Fmi3Functions, N, P, R, T
from cosim.components.fmi3_instance import Fmi3Instance
from cosim.components.fmi3_variables import Fmi3Table
from cosim.engine import fmi3_calls as calls
from cosim.engine.blocks import INTEGERS, REALS, Block

_LOG = logging.getLogger(__name__)
_KINDS = {"pointer": P, "size": N, "real": R, "int": INT, "byte": B}
#: fmi2CallbackLogger, without the arguments of the format; fmi3LogMessageCallback.
_LOGGER = ctypes.CFUNCTYPE(None, P, T, INT, T, T)
_LOG_MESSAGE = ctypes.CFUNCTYPE(None, P, INT, T, T)

#: Functions of FMI 2.0 outside the loop: the method of an instance, the arguments, and the function of FMI 3.0.
_OUTSIDE: dict[str, tuple[str, tuple[Any, ...], str]] = {
    "SetDebugLogging": ("set_debug_logging", (P, INT, N, P), "SetDebugLogging"),
    "SetupExperiment": ("setup_experiment", (P, INT, R, R, INT, R), "EnterInitializationMode"),
    "EnterInitializationMode": ("enter_initialization", (P,), "EnterInitializationMode"),
    "ExitInitializationMode": ("exit_initialization", (P,), "ExitInitializationMode"),
    "Terminate": ("terminate", (P,), "Terminate"),
    "Reset": ("reset", (P,), "Reset"),
    "FreeFMUstate": ("free_state", (P, P), "FreeFMUState"),
    "SerializedFMUstateSize": ("serialized_size", (P, P, P), "SerializedFMUStateSize"),
    "SerializeFMUstate": ("serialize", (P, P, P, N), "SerializeFMUState"),
    "DeSerializeFMUstate": ("deserialize", (P, P, N, P), "DeserializeFMUState"),
    "GetRealStatus": ("real_status", (P, INT, P), "DoStep"),
    "GetBooleanStatus": ("boolean_status", (P, INT, P), "DoStep"),
    "SetInteger": ("set_integer", (P, P, N, P), ""),
    "SetBoolean": ("set_boolean", (P, P, N, P), ""),
    "SetString": ("set_string", (P, P, N, P), ""),
    "GetInteger": ("get_integer", (P, P, N, P), ""),
    "GetBoolean": ("get_boolean", (P, P, N, P), ""),
    "GetString": ("get_string", (P, P, N, P), ""),
}
#: Functions of the loop that a library may lack.
_OPTIONAL = {
    "fmi2GetFMUstate": "GetFMUState",
    "fmi2SetFMUstate": "SetFMUState",
    "fmi2GetDirectionalDerivative": "GetDirectionalDerivative",
}


class Fmi3Library:
    """Library of an FMI 3.0 FMU for co-simulation, with attributes fmi2Instantiate, fmi2SetReal, fmi2DoStep ...

    Each attribute is a C function for ctypes, with an address that compiled code may call. Value references are those
    of `Fmi3Table.references`. Functions that do not exist in FMI 3.0, or that the library lacks, return fmi2Error.

    Args:
        dll: Library as ctypes loads it.
        identifier: Name of the library (modelIdentifier).
        table: Variables of the FMU.
        slack: Internal step that the FMU declares (fixedInternalStepSize) [s]; 0 if it declares none.
        compile_calls: Whether the calls that the loop makes are machine code, so that they need no Python; otherwise
            they are interpreted, with equal results.
    """

    def __init__(
        self, dll: Any, identifier: str, table: Fmi3Table, *, slack: float = 0.0, compile_calls: bool = True
    ) -> None:
        self._dll, self._table, self._slack = dll, table, slack
        self._raw = Fmi3Functions(dll, identifier)
        self._instances: dict[int, Fmi3Instance] = {}
        self._callbacks: dict[int, Any] = {}
        self._functions = self._of_the_loop(compile_calls) | self._outside()

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("fmi2"):
            return getattr(self._dll, name)
        return self._functions.get(name) or MissingFunction()

    @property
    def called(self) -> str:
        """Name of the FMI 3.0 function that was called last, outside the loop."""
        return self._raw.called

    def missing(self, functions: Sequence[str]) -> list[str]:
        """Return the names in C of those functions that the library lacks.

        Args:
            functions: Names in FMI 2.0 without prefix: "DoStep".
        """
        return self._raw.missing(functions, self._table)

    def _of_the_loop(self, compile_calls: bool) -> dict[str, Any]:
        """Return the functions that the loop calls, and the callback for intermediate updates."""
        addresses = _machine_code() if compile_calls else {}
        found = {}
        for number, (name, kinds) in enumerate(calls.ENTRIES.items()):
            prototype = ctypes.CFUNCTYPE(INT, *(_KINDS[kind] for kind in kinds))
            interpreted = partial(self._interpret, number, kinds)
            if name not in _OPTIONAL or self._raw.has(_OPTIONAL[name]):
                found[name] = prototype(addresses[name] if addresses else interpreted)
        return found

    def _interpret(self, number: int, kinds: Sequence[str], instance: int, *arguments: Any) -> int:
        pairs = list(zip(kinds[1:], arguments, strict=True))
        integers = [int(value or 0) for kind, value in pairs if kind != "real"]
        reals = [value for kind, value in pairs if kind == "real"]
        integers += [0] * (INTEGERS - len(integers))
        reals += [0.0] * (REALS - len(reals))
        return int(calls.call(self._instances[instance].content, number, *integers, *reals))

    def _outside(self) -> dict[str, Any]:
        """Return all functions that the loop does not call."""
        found: dict[str, Any] = {
            "fmi2Instantiate": ctypes.CFUNCTYPE(P, T, INT, T, T, P, INT, INT)(self._instantiate),
            "fmi2FreeInstance": ctypes.CFUNCTYPE(None, P)(self._free),
            "fmi2GetVersion": ctypes.CFUNCTYPE(P)(lambda: _address_of(_VERSION)),
            "fmi2GetTypesPlatform": ctypes.CFUNCTYPE(P)(lambda: _address_of(_PLATFORM)),
        }
        for name, (method, types, needed) in _OUTSIDE.items():
            if not needed or self._raw.has(needed):
                found[f"fmi2{name}"] = ctypes.CFUNCTYPE(INT, *types)(partial(self._guarded, method))
        return found

    def _guarded(self, method: str, instance: int, *arguments: Any) -> int:
        """Call a method of an instance; a fault in Python is logged, because no exception may reach C."""
        try:
            return int(getattr(self._instances[instance], method)(*arguments))
        except Exception:
            _LOG.exception("a call of an FMI 3.0 FMU failed: %s", method)
            return ERROR

    def _instantiate(
        self,
        name: bytes,
        _kind: int,
        token: bytes,
        resources: bytes | None,
        callbacks: int,
        visible: int,
        log_on: int,
    ) -> int:
        """Instantiate for co-simulation; events are left to the FMU, and no step may end early."""
        forward, log = _forwards(callbacks or 0, name)
        instance = Fmi3Instance(self._raw, self._table, self._slack, forward)
        update = self._functions["intermediateUpdate"]
        ramped = [v.reference for v in self._table.ramped]
        required = (ctypes.c_uint32 * len(ramped))(*ramped)
        address = instance.block.address
        self._instances[address], self._callbacks[address] = instance, (log, required)
        found = self._raw.call(
            "InstantiateCoSimulation", name, token, _path(resources), bool(visible), bool(log_on), False, False,
            required, len(ramped), address, ctypes.cast(log, P), ctypes.cast(update, P),
        )  # fmt: skip
        if not found:
            del self._instances[address], self._callbacks[address]
            return 0
        instance.pointer = found
        return address

    def _free(self, instance: int) -> None:
        found = self._instances.pop(instance, None)
        if found is not None:
            self._raw.call("FreeInstance", found.pointer)
        self._callbacks.pop(instance, None)


@cache
def _machine_code() -> dict[str, int]:
    """Return the addresses of the compiled calls of the loop; empty if they cannot be compiled."""
    from cosim.engine.machine_code import c_functions  # noqa: PLC0415 -- LLVM, which FMI 2.0 does not need here

    empty = Fmi3Instance(Fmi3Functions(None, ""), Fmi3Table((), {}), 0.0, lambda *_: None)
    try:
        return c_functions(calls.call, Block(empty.content).kind, calls.ENTRIES)
    except (RuntimeError, OSError) as error:
        _LOG.warning("calls of FMI 3.0 FMUs are interpreted, because they cannot be compiled: %s", error)
        return {}


def _forwards(callbacks: int, name: bytes) -> tuple[Callable[[int, str], None], Any]:
    """Return a function that logs a text, and the FMU's log callback; both call the logger of FMI 2.0.

    Args:
        callbacks: Address of fmi2CallbackFunctions, whose first member is the logger and whose fifth is its first
            argument; 0 if there is no log.
        name: Name of the instance.
    """
    logger, environment = 0, None
    if callbacks:
        members = (ctypes.c_void_p * 5).from_address(callbacks)
        logger, environment = members[0] or 0, members[4]
    write = _LOGGER(logger) if logger else lambda *_: None

    def forward(_environment: Any, status: int, category: bytes | None, message: bytes | None) -> None:
        # The logger of FMI 2.0 takes a format.
        write(environment, name, status, category or b"", (message or b"").replace(b"%", b"%%"))

    return lambda status, text: forward(None, status, b"", text.encode()), _LOG_MESSAGE(forward)


def _path(resources: bytes | None) -> bytes | None:
    """Return the path of a folder from its URI, with a separator at its end as FMI 3.0 demands."""
    if resources is None:
        return None
    path = url2pathname(urlparse(resources.decode()).path)
    return (path.rstrip(os.sep) + os.sep).encode()


_VERSION, _PLATFORM = ctypes.create_string_buffer(b"2.0"), ctypes.create_string_buffer(b"default")


def _address_of(text: Any) -> int:
    return ctypes.addressof(text)
