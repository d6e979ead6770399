"""Functions of FMI 3.0 that an FMU exports, and those that its flags require."""

from __future__ import annotations

from builder.check.description import Description

_LIFE = """GetVersion SetDebugLogging FreeInstance EnterInitializationMode ExitInitializationMode Terminate Reset
GetFloat64 SetFloat64"""
_TYPES = (
    "Float32 Float64 Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean String Binary Clock".split()  # noqa: SIM905
)
_STATE = "GetFMUState SetFMUState FreeFMUState"
_SERIAL = "SerializedFMUStateSize SerializeFMUState DeserializeFMUState"
_CLOCKS = """GetIntervalDecimal GetIntervalFraction GetShiftDecimal GetShiftFraction SetIntervalDecimal
SetIntervalFraction SetShiftDecimal SetShiftFraction EvaluateDiscreteStates UpdateDiscreteStates"""
_COMMON = f"""{_LIFE} {_STATE} {_SERIAL} {_CLOCKS} EnterEventMode EnterConfigurationMode ExitConfigurationMode
GetNumberOfVariableDependencies GetVariableDependencies GetDirectionalDerivative GetAdjointDerivative
{" ".join(f"Get{kind} Set{kind}" for kind in _TYPES)}"""
_EXCHANGE = """InstantiateModelExchange EnterContinuousTimeMode CompletedIntegratorStep SetTime SetContinuousStates
GetContinuousStateDerivatives GetEventIndicators GetContinuousStates GetNominalsOfContinuousStates
GetNumberOfEventIndicators GetNumberOfContinuousStates"""
_STEPS = "InstantiateCoSimulation EnterStepMode GetOutputDerivatives DoStep"
_SCHEDULED = "InstantiateScheduledExecution ActivateModelPartition"

#: Functions that a flag of CoSimulation requires; flags that FMI 2.0 has under the names that it has there.
_PROMISED = {
    "canGetAndSetFMUstate": _STATE,
    "canSerializeFMUstate": _SERIAL,
    "providesDirectionalDerivative": "GetDirectionalDerivative",
    "providesAdjointDerivatives": "GetAdjointDerivative",
    "hasEventMode": "EnterEventMode EnterStepMode UpdateDiscreteStates",
    "providesPerElementDependencies": "GetNumberOfVariableDependencies GetVariableDependencies",
}


def _full_names(words: str) -> frozenset[str]:
    return frozenset(f"fmi3{word}" for word in words.split())


#: All functions of co-simulation, those that model exchange needs, and all functions that an FMU may export.
CO_SIMULATION = _full_names(f"{_COMMON} {_STEPS}")
MODEL_EXCHANGE = _full_names(f"{_LIFE} {_EXCHANGE} EnterEventMode UpdateDiscreteStates")
EXPORTABLE = _full_names(f"{_COMMON} {_STEPS} {_EXCHANGE} {_SCHEDULED}")


def required(description: Description) -> frozenset[str]:
    """Return the functions that the binary must export: those of every FMU, of its types, and of its flags."""
    words = [words for flag, words in _PROMISED.items() if description.can(flag)]
    natives = {"Int64" if v.native == "Enumeration" else v.native for v in description.variables}
    words += [f"Get{native} Set{native}" for native in sorted(natives)]
    if description.output_derivative_order:
        words.append("GetOutputDerivatives")
    return _full_names(" ".join([_LIFE, "InstantiateCoSimulation DoStep", *words]))
