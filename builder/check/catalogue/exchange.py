"""Rules for model exchange: the description of states, and the behaviour of an instance that a host integrates."""

from __future__ import annotations

from builder.check.rules import Level, Rule

_E = Level.ERROR
_D = Level.DROP_IN
_H = Level.HINT
_VARIABLES = "FMI 2.2.7"
_STRUCTURE = "FMI 2.2.8"
_ELEMENT = "FMI 3.3.1"
_CALLS = "FMI 3.2.3"
_COUPLING = "drop-in: couples correctly"
_ROBUST = "drop-in: robust"

# Description
IDENTIFIER = Rule(
    "exchange-identifier", _E, "modelIdentifier of ModelExchange is a C name with a binary wherever there is one",
    _ELEMENT, "use the same modelIdentifier for both kinds, or add the binaries",
)  # fmt: skip
SOURCE_FILES = Rule(
    "exchange-sources", _E, "The files listed in SourceFiles of ModelExchange exist", _ELEMENT,
    "add the files or correct the list",
)  # fmt: skip
STATES = Rule(
    "state-continuous", _E, "A state and its derivative are two continuous Reals, and no state has two derivatives",
    _VARIABLES, "correct the attribute derivative, or the variability",
)  # fmt: skip
UNLISTED = Rule(
    "derivative-unlisted", _D, "A local derivative of a continuous variable is listed in Derivatives", _STRUCTURE,
    "list it there: otherwise a host does not integrate the state; or remove the attribute derivative",
)  # fmt: skip
REINIT = Rule(
    "reinit", _E, "Only continuous states have the attribute reinit", _VARIABLES, "remove it from other variables"
)
INDICATORS = Rule(
    "event-indicators", _E, "numberOfEventIndicators is a whole number", "FMI 2.2.1", "write the number of indicators"
)
KNOWNS = Rule(
    "derivative-known", _D, "Derivatives depend on inputs, states and time, not on parameters or outputs", _STRUCTURE,
    "list inputs and states only",
)  # fmt: skip
SERIALIZE = Rule(
    "exchange-serialize", _E, "ModelExchange declares canSerializeFMUstate only with canGetAndSetFMUstate", _ELEMENT,
    "declare both or neither",
)  # fmt: skip
NOMINAL = Rule(
    "state-nominal", _H, "Continuous states have a nominal value", _COUPLING,
    "state a typical magnitude: integrators scale their absolute tolerance with it",
)  # fmt: skip

# Behaviour
MODES = Rule(
    "exchange-order", _D, "Calls of model exchange in the wrong mode are rejected", _CALLS,
    "track the mode of the instance and return fmi2Error",
)  # fmt: skip
INPUTS = Rule(
    "exchange-inputs", _E, "Inputs can be set in continuous-time mode, tunable parameters in event mode", _CALLS,
    "accept them",
)  # fmt: skip
ARRAYS = Rule(
    "states-set", _E, "fmi2GetContinuousStates returns the states that were set", "FMI 3.2.2",
    "store the states, and return them unchanged",
)  # fmt: skip
NAMED = Rule(
    "states-variables", _E, "States and derivatives read as variables equal those of the arrays", _STRUCTURE,
    "use the order of ModelStructure/Derivatives in the arrays",
)  # fmt: skip
FINITE = Rule(
    "derivatives-finite", _D, "Derivatives are finite", _COUPLING, "return fmi2Discard where they have no value"
)
REPEATABLE = Rule(
    "derivatives-repeatable", _E, "Derivatives follow from time, inputs and states alone", "FMI 3.1",
    "calculate them without memory of earlier evaluations: integrators reject and repeat steps",
)  # fmt: skip
HIDDEN = Rule(
    "derivative-hidden", _E, "Every observed dependency on inputs and states is declared", _STRUCTURE, "declare it"
)
DIRECTIONAL = Rule(
    "exchange-directional", _E, "Directional derivatives by inputs and states match finite differences", "FMI 2.1.9",
    "correct them, or clear providesDirectionalDerivative of ModelExchange",
)  # fmt: skip
NOMINALS = Rule(
    "nominals-agree", _D, "Nominal values of the binary are positive and those of the description", "FMI 3.2.2",
    "generate both from one source",
)  # fmt: skip
STATE = Rule(
    "exchange-state", _E, "An FMU state restores states, derivatives and outputs in model exchange", "FMI 2.1.8",
    "save everything that derivatives and outputs depend on",
)  # fmt: skip
ACCURATE = Rule(
    "exchange-accuracy", _H, "The solver of co-simulation follows model exchange within 2 % at the default step size",
    _COUPLING, "take smaller steps inside: the difference falls with the step size, so the equations are the same",
)  # fmt: skip
AGREES = Rule(
    "exchange-agrees", _D, "Model exchange and co-simulation give the same results", _COUPLING,
    "use the same equations, start values and inputs for both",
)  # fmt: skip
