"""Names of functions and attributes of FMI 3.0 and of FMI 2.0."""

from __future__ import annotations

#: Functions with another name in FMI 3.0, both without fmi2 or fmi3. Values have one function for each type.
FUNCTIONS = {
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
    return FUNCTIONS.get(name, name)
