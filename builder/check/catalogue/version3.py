"""Rules that only FMI 3.0 has: arrays, clocks, intermediate updates, aliases, build descriptions, results of steps."""

from __future__ import annotations

from builder.check.rules import Level, Rule

_E = Level.ERROR
_D = Level.DROP_IN
_VARIABLES = "FMI 3.0 2.4.7"
_STRUCTURE = "FMI 3.0 2.4.8"
_ZIP = "FMI 3.0 2.5"
_FLAGS = "FMI 3.0 4.4"
_STEPS = "FMI 3.0 4.2"
_CALLS = "FMI 3.0 2.2"
_HONEST = "drop-in: honest capabilities"
_ROBUST = "drop-in: robust"

# Description
DIMENSION = Rule(
    "array-dimension", _E, "A dimension has a size, or names a structural parameter of type UInt64", _VARIABLES,
    "give each Dimension either start or the valueReference of a structural parameter",
)  # fmt: skip
START_COUNT = Rule(
    "array-start-count", _E, "An array has one start value, or one for each element", _VARIABLES,
    "write one start value, or as many as elements",
)  # fmt: skip
CLOCKS = Rule(
    "clock-reference", _E, "The attribute clocks lists variables of type Clock", _VARIABLES, "correct the references"
)
INTERVAL = Rule(
    "clock-interval", _E, "A clock has a valid intervalVariability, and an interval if it is constant or fixed",
    _VARIABLES, "name one of the six kinds; add intervalDecimal, or intervalCounter and resolution, to the first two",
)  # fmt: skip
CLOCKED_STATE = Rule(
    "clocked-state", _E, "Clocked states have the attributes previous and clocks", _STRUCTURE, "add them"
)
ALIAS_UNIT = Rule(
    "alias-display-unit", _E, "The display unit of an alias is one of the variable's unit", _VARIABLES,
    "define the display unit, or remove the attribute",
)  # fmt: skip
TIME_TYPE = Rule(
    "independent-type", _E, "The independent variable is a Float64 or a Float32", _VARIABLES, "change its type"
)
INTERMEDIATE_FLAG = Rule(
    "intermediate-flag", _E, "Variables only declare intermediateUpdate if the FMU declares providesIntermediateUpdate",
    _FLAGS, "declare providesIntermediateUpdate, or remove the attribute",
)  # fmt: skip
EARLY_FLAG = Rule(
    "early-return-flag", _E, "canReturnEarlyAfterIntermediateUpdate is only declared with providesIntermediateUpdate",
    _FLAGS, "declare providesIntermediateUpdate, or clear the flag",
)  # fmt: skip
EVENT_MODE = Rule(
    "event-mode", _D, "An FMU with input clocks offers event mode in co-simulation", _STEPS,
    "support event mode and declare hasEventMode: a host cannot activate the clocks otherwise",
)  # fmt: skip
BUILD = Rule(
    "build-description", _E, "Sources come with a valid sources/buildDescription.xml for each modelIdentifier", _ZIP,
    "list the source files there; FMI 3.0 has no other list",
)  # fmt: skip
SCHEMA = Rule(
    "schema", _E, "terminalsAndIcons.xml and buildDescription.xml follow their schemas", _ZIP, "see the message"
)

# Behaviour
VERSION = Rule("version-string", _E, "fmi3GetVersion returns the fmiVersion of the description", _CALLS, "correct it")
STEP_RESULTS = Rule(
    "step-results", _E, "A successful step reports its end, no early return and no event if the host allows neither",
    _STEPS, "set lastSuccessfulTime to the end of the step, earlyReturn and eventHandlingNeeded to false",
)  # fmt: skip
COUNTS = Rule(
    "value-count", _D, "A wrong number of values is rejected", _ROBUST, "compare nValues with the variables' sizes"
)
UPDATES = Rule(
    "intermediate-update", _E, "A step calls the intermediate update within its own time", _STEPS,
    "call it at times from the start to the end of the step, or clear providesIntermediateUpdate",
)  # fmt: skip
UPDATES_INPUTS = Rule(
    "intermediate-inputs", _D, "Intermediate updates request the inputs that declare intermediateUpdate", _HONEST,
    "call it with intermediateVariableSetRequested, or remove the attribute",
)  # fmt: skip
NUMBERS = Rule(
    "number-of-states", _E, "Numbers of states and event indicators in the binary are those of the description",
    _STRUCTURE, "generate both from one source",
)  # fmt: skip
ADJOINT = Rule(
    "adjoint-derivative", _E, "Adjoint derivatives are the transposed directional derivatives", "FMI 3.0 2.2.11",
    "correct them, or clear providesAdjointDerivatives",
)  # fmt: skip
ARRAY_START = Rule(
    "array-start", _E, "Start values of arrays in the XML and in the binary are equal", _VARIABLES,
    "generate both from one source",
)  # fmt: skip
UNDECLARED = Rule(
    "undeclared-type", _D, "An interface type that the description does not declare is not instantiated", _HONEST,
    "return NULL, or declare the interface type",
)  # fmt: skip
