"""Capability flags among themselves; what the binaries say to them is in binaries.py."""

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
    """What is serialized must be gettable."""
    if description.can("canSerializeFMUstate") and not description.can("canGetAndSetFMUstate"):
        yield rules.SERIALIZE.finding("canSerializeFMUstate is true, canGetAndSetFMUstate is not")


def runs_alone(description: Description) -> Iterator[Finding]:
    """No execution tool."""
    if description.can("needsExecutionTool"):
        yield rules.RUNS_ALONE.finding("needsExecutionTool is true")


def variable_step(description: Description) -> Iterator[Finding]:
    """Any step."""
    if description.co_simulation is not None and not description.can("canHandleVariableCommunicationStepSize"):
        yield rules.VARIABLE_STEP.finding("canHandleVariableCommunicationStepSize is not true")


def many(description: Description) -> Iterator[Finding]:
    """Many instances."""
    if description.can("canBeInstantiatedOnlyOncePerProcess"):
        yield rules.MANY.finding("canBeInstantiatedOnlyOncePerProcess is true")


def offered(description: Description) -> Iterator[Finding]:
    """What a good master uses."""
    missing = [what for flag, what in _OFFERS.items() if not description.can(flag)]
    if description.co_simulation is not None and missing:
        yield rules.OFFERED.finding(f"not offered: {listed(missing)}")


RULES = (serialize, runs_alone, variable_step, many, offered)
