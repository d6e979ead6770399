"""Functions that the binary of an FMU exports, by version of FMI, and those that its flags require."""

from __future__ import annotations

from dataclasses import dataclass

from eightpost.fmi.description import Description

_TYPES = "Float32 Float64 Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean String Binary Clock"


@dataclass(frozen=True)
class Functions:
    """Names of the functions of a version of FMI, separated by blanks and without the prefix.

    Attributes:
        prefix: Prefix of all names.
        always: Functions that every FMU for co-simulation exports.
        optional: Further functions of co-simulation.
        promised: Functions that a flag of CoSimulation requires, by its name in FMI 2.0.
        order: Function that an order of output derivatives requires.
        exchange: Functions that model exchange requires.
        other: Further functions that an FMU may export.
    """

    prefix: str
    always: str
    optional: str
    promised: dict[str, str]
    order: str
    exchange: str
    other: str

    def names(self, *words: str) -> frozenset[str]:
        """Return full names of functions."""
        return frozenset(f"{self.prefix}{word}" for word in " ".join(words).split())

    @property
    def co_simulation(self) -> frozenset[str]:
        """All functions of co-simulation."""
        return self.names(self.always, self.optional)

    @property
    def exportable(self) -> frozenset[str]:
        """All functions that a binary may export."""
        return self.co_simulation | self.names(self.exchange, self.other)

    def required(self, fmu: Description) -> frozenset[str]:
        """Return the functions that the binary must export: those of every FMU, and those of its flags and types."""
        words = [words for flag, words in self.promised.items() if fmu.can(flag)]
        words += [self.order] if fmu.output_derivative_order else []
        natives = {"Int64" if v.native == "Enumeration" else v.native for v in fmu.variables if v.native}
        return self.names(self.always, *words, *(f"Get{native} Set{native}" for native in natives))


_STATE_2 = "GetFMUstate SetFMUstate FreeFMUstate"
_SERIAL_2 = "SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate"
_ALWAYS_2 = """GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance SetupExperiment
EnterInitializationMode ExitInitializationMode Terminate Reset GetReal GetInteger GetBoolean GetString SetReal
SetInteger SetBoolean SetString"""

_STATE_3 = "GetFMUState SetFMUState FreeFMUState"
_SERIAL_3 = "SerializedFMUStateSize SerializeFMUState DeserializeFMUState"
_ALWAYS_3 = """GetVersion SetDebugLogging FreeInstance EnterInitializationMode ExitInitializationMode Terminate Reset
GetFloat64 SetFloat64"""
_PARTIAL_3 = "GetNumberOfVariableDependencies GetVariableDependencies"

FUNCTIONS = {
    2: Functions(
        prefix="fmi2",
        always=f"{_ALWAYS_2} DoStep",
        optional=f"""{_STATE_2} {_SERIAL_2} CancelStep GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus
        GetStringStatus GetDirectionalDerivative SetRealInputDerivatives GetRealOutputDerivatives""",
        promised={
            "canGetAndSetFMUstate": _STATE_2,
            "canSerializeFMUstate": _SERIAL_2,
            "providesDirectionalDerivative": "GetDirectionalDerivative",
            "canInterpolateInputs": "SetRealInputDerivatives",
            "canRunAsynchronuously": "CancelStep GetStatus",
        },
        order="GetRealOutputDerivatives",
        exchange=f"""{_ALWAYS_2} EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep
        SetTime SetContinuousStates GetDerivatives GetEventIndicators GetContinuousStates
        GetNominalsOfContinuousStates""",
        other="",
    ),
    3: Functions(
        prefix="fmi3",
        always=f"{_ALWAYS_3} InstantiateCoSimulation DoStep",
        optional=f"""{_STATE_3} {_SERIAL_3} {_PARTIAL_3} GetIntervalDecimal GetIntervalFraction GetShiftDecimal
        GetShiftFraction SetIntervalDecimal SetIntervalFraction SetShiftDecimal SetShiftFraction EvaluateDiscreteStates
        UpdateDiscreteStates EnterEventMode EnterStepMode EnterConfigurationMode ExitConfigurationMode
        GetDirectionalDerivative GetAdjointDerivative GetOutputDerivatives
        {" ".join(f"Get{kind} Set{kind}" for kind in _TYPES.split())}""",
        promised={
            "canGetAndSetFMUstate": _STATE_3,
            "canSerializeFMUstate": _SERIAL_3,
            "providesDirectionalDerivative": "GetDirectionalDerivative",
            "providesAdjointDerivatives": "GetAdjointDerivative",
            "hasEventMode": "EnterEventMode EnterStepMode UpdateDiscreteStates",
            "providesPerElementDependencies": _PARTIAL_3,
        },
        order="GetOutputDerivatives",
        exchange=f"""{_ALWAYS_3} InstantiateModelExchange EnterContinuousTimeMode CompletedIntegratorStep SetTime
        SetContinuousStates GetContinuousStateDerivatives GetEventIndicators GetContinuousStates
        GetNominalsOfContinuousStates GetNumberOfEventIndicators GetNumberOfContinuousStates EnterEventMode
        UpdateDiscreteStates""",
        other="InstantiateScheduledExecution ActivateModelPartition",
    ),
}  # fmt: skip
