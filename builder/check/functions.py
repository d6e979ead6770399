"""The functions of FMI 2.0 that a co-simulation FMU exports, and those that its flags require."""

from __future__ import annotations

from builder.check.description import Description

_COMMON = """GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment
EnterInitializationMode ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal
SetInteger SetBoolean SetString DoStep"""
_STATE = "GetFMUstate SetFMUstate FreeFMUstate"
_SERIAL = "SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate"
_STATUS = "CancelStep GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus"
_OPTIONAL = f"{_STATE} {_SERIAL} {_STATUS} GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives"
_MODEL_EXCHANGE = """EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime
SetContinuousStates GetDerivatives GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates"""


def _full_names(words: str) -> frozenset[str]:
    return frozenset(f"fmi2{word}" for word in words.split())


#: All functions of co-simulation, and all functions that an FMU may export.
CO_SIMULATION = _full_names(f"{_COMMON} {_OPTIONAL}")
EXPORTABLE = CO_SIMULATION | _full_names(_MODEL_EXCHANGE)


def required(description: Description) -> frozenset[str]:
    """Return the functions that the binary must export: those of every FMU, and those that the flags require."""
    promised = {
        "canGetAndSetFMUstate": _STATE,
        "canSerializeFMUstate": _SERIAL,
        "providesDirectionalDerivative": "GetDirectionalDerivative",
        "canInterpolateInputs": "SetRealInputDerivatives",
        "canRunAsynchronuously": "CancelStep GetStatus",
    }
    words = [words for flag, words in promised.items() if description.can(flag)]
    if description.output_derivative_order:
        words.append("GetRealOutputDerivatives")
    return _full_names(" ".join([_COMMON, *words]))


def required_by_model_exchange() -> frozenset[str]:
    """Return the functions that the binary of an FMU with ModelExchange must export."""
    return _full_names(f"{_COMMON} {_MODEL_EXCHANGE}") - {"fmi2DoStep"}
