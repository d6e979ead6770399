"""Functions of FMI 2.0 and 3.0, which functions.txt lists, their statuses, and names that differ between versions."""

from __future__ import annotations

from collections.abc import Iterator
from ctypes import c_bool, c_char_p, c_double, c_int, c_size_t, c_void_p
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_ARGUMENTS = {"p": c_void_p, "n": c_size_t, "d": c_double, "i": c_int, "b": c_bool}
_RESULTS = {"Instantiate": c_void_p, "FreeInstance": None, "GetVersion": c_char_p, "GetTypesPlatform": c_char_p}
_KINDS = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_RESULTS |= {f"Instantiate{kind}": c_void_p for kind in _KINDS}


@dataclass(frozen=True)
class Function:
    """One function; see functions.txt."""

    needed_by: tuple[str, ...]  #: all, cs, me, optional, other.
    arguments: tuple[Any, ...]  #: Types of its arguments; not stated for functions that nothing calls.
    result: Any  #: Type of its result.


def _lines() -> Iterator[tuple[int, str, Function]]:
    for line in Path(__file__).with_name("functions.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            version, needed_by, arguments, names = (part.strip() for part in line.split("|"))
            types = tuple(_ARGUMENTS[letter] for letter in arguments if letter != "?")
            for name in names.split():
                yield int(version), name, Function(tuple(needed_by.split()), types, _RESULTS.get(name, c_int))


#: Functions by version of FMI (2 or 3) and name without prefix.
FUNCTIONS: dict[int, dict[str, Function]] = {2: {}, 3: {}}
for _version, _name, _function in _lines():
    FUNCTIONS[_version][_name] = _function


def names(version: int, *needed_by: str) -> frozenset[str]:
    """Return the names in C of the functions that some need: all, cs, me, optional, other; of all without any."""
    functions = FUNCTIONS[version].items()
    return frozenset(f"fmi{version}{n}" for n, f in functions if not needed_by or set(needed_by) & set(f.needed_by))


# ---- Statuses, and names that differ between the versions -----------------------------------------------------------

#: fmi2Status, fmi3Status; pending in FMI 2.0 only.
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)

#: Functions with another name in FMI 3.0, both without fmi2 or fmi3. Values have one function for each type.
RENAMED = {
    "SetReal": "SetFloat64",
    "GetReal": "GetFloat64",
    "SetInteger": "SetInt32",
    "GetInteger": "GetInt32",
    "Instantiate": "InstantiateCoSimulation",
    "SetupExperiment": "EnterInitializationMode",
    "GetFMUstate": "GetFMUState",
    "SetFMUstate": "SetFMUState",
    "FreeFMUstate": "FreeFMUState",
    "SerializedFMUstateSize": "SerializedFMUStateSize",
    "SerializeFMUstate": "SerializeFMUState",
    "DeSerializeFMUstate": "DeserializeFMUState",
    "NewDiscreteStates": "UpdateDiscreteStates",
    "GetDerivatives": "GetContinuousStateDerivatives",
    "GetRealOutputDerivatives": "GetOutputDerivatives",
    "SetRealInputDerivatives": "IntermediateUpdateCallback",
    "GetBooleanStatus": "DoStep",
}

#: Attributes of CoSimulation and ModelExchange in FMI 2.0, by their names in FMI 3.0.
FLAGS = {
    "canGetAndSetFMUState": "canGetAndSetFMUstate",
    "canSerializeFMUState": "canSerializeFMUstate",
    "providesDirectionalDerivatives": "providesDirectionalDerivative",
    "providesIntermediateUpdate": "canInterpolateInputs",
}


def function_name(name: str) -> str:
    """Return the name in FMI 3.0 of a function of FMI 2.0, both without fmi2 or fmi3."""
    return RENAMED.get(name, name)
