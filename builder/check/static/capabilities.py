"""Rules for the capability flags; binaries.py compares the flags with the binaries."""

from __future__ import annotations

from collections.abc import Iterator

from builder.check.catalogue import description as rules
from builder.check.description import Description
from builder.check.rules import Finding, listed

_OFFERS = {
    "canGetAndSetFMUstate": "FMU state",
    "canInterpolateInputs": "input derivatives",
    "providesDirectionalDerivative": "directional derivatives",
}


def serialize(description: Description) -> Iterator[Finding]:
    """Check that canSerializeFMUstate is only declared with canGetAndSetFMUstate."""
    if description.can("canSerializeFMUstate") and not description.can("canGetAndSetFMUstate"):
        yield rules.SERIALIZE.finding("canSerializeFMUstate is true, canGetAndSetFMUstate is not")


def runs_alone(description: Description) -> Iterator[Finding]:
    """Check that no execution tool is needed."""
    if description.can("needsExecutionTool"):
        yield rules.RUNS_ALONE.finding("needsExecutionTool is true")


def variable_step(description: Description) -> Iterator[Finding]:
    """Check that any communication step size is accepted."""
    if description.co_simulation is not None and not description.can("canHandleVariableCommunicationStepSize"):
        yield rules.VARIABLE_STEP.finding("canHandleVariableCommunicationStepSize is not true")


def many(description: Description) -> Iterator[Finding]:
    """Check that several instances per process are allowed."""
    if description.can("canBeInstantiatedOnlyOncePerProcess"):
        yield rules.MANY.finding("canBeInstantiatedOnlyOncePerProcess is true")


def offered(description: Description) -> Iterator[Finding]:
    """Check that the optional features for coupling stiff systems are supported."""
    missing = [what for flag, what in _OFFERS.items() if not description.can(flag)]
    if description.co_simulation is not None and missing:
        yield rules.OFFERED.finding(f"not supported: {listed(missing)}")


RULES = (serialize, runs_alone, variable_step, many, offered)
