"""Rules for the description of model exchange: states, derivatives, event indicators, binaries."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

from builder.check.catalogue import exchange as rules
from builder.check.description import Description, Variable
from builder.check.rules import Finding, listed
from builder.check.subject import Subject


def states(description: Description) -> Iterator[Finding]:
    """Check that every listed derivative has one state of its own, and that both are continuous Reals."""
    wrong, pairs = [], list(description.state_pairs())
    for derivative, state in pairs:
        if derivative is state:
            wrong.append(f"{state.name} is its own derivative")
        wrong += [f"{v.name} is not a continuous Real" for v in (derivative, state) if not _is_continuous(v)]
    doubled = [name for name, count in Counter(state.name for _, state in pairs).items() if count > 1]
    wrong += [f"{name} has several derivatives" for name in doubled]
    if wrong:
        yield rules.STATES.finding(listed(wrong))


def _is_continuous(variable: Variable) -> bool:
    return variable.type == "Real" and variable.variability == "continuous"


def unlisted(description: Description) -> Iterator[Finding]:
    """Check that Derivatives contains the local derivatives, if the FMU offers model exchange."""
    named = {derivative.index for derivative, _ in description.state_pairs()}
    missing = [
        v.name
        for v in description.variables
        if "derivative" in v.attributes and v.causality == "local" and v.index not in named and _is_continuous(v)
    ]
    if description.model_exchange is not None and missing:
        yield rules.UNLISTED.finding(f"not listed: {listed(missing)}")


def reinit(description: Description) -> Iterator[Finding]:
    """Check that only states have the attribute reinit."""
    known = {state.index for _, state in description.state_pairs()}
    wrong = [v.name for v in description.variables if "reinit" in v.attributes and v.index not in known]
    if wrong:
        yield rules.REINIT.finding(f"present on {listed(wrong)}")


def indicators(description: Description) -> Iterator[Finding]:
    """Check the number of event indicators."""
    text = description.attributes.get("numberOfEventIndicators", "0").strip()
    if description.model_exchange is not None and not re.fullmatch(r"\d+", text, flags=re.ASCII):
        yield rules.INDICATORS.finding(f"it is {text!r}")


def knowns(description: Description) -> Iterator[Finding]:
    """Check that derivatives only depend on inputs, states and time."""
    known = {state.index for _, state in description.state_pairs()}
    for unknown in description.in_section("Derivatives"):
        found = [v for v in (description.variable(i) for i in unknown.dependencies or ()) if v is not None]
        wrong = [v.name for v in found if v.causality not in ("input", "independent") and v.index not in known]
        name = description.variable(unknown.index)
        if wrong:
            yield rules.KNOWNS.finding(f"{name.name if name else unknown.index} lists {listed(wrong)}")


def serialize(description: Description) -> Iterator[Finding]:
    """Check that canSerializeFMUstate is only declared with canGetAndSetFMUstate."""
    if description.can_exchange("canSerializeFMUstate") and not description.can_exchange("canGetAndSetFMUstate"):
        yield rules.SERIALIZE.finding("canSerializeFMUstate is true, canGetAndSetFMUstate is not")


def nominals(description: Description) -> Iterator[Finding]:
    """Check that states have nominal values."""
    bare = [state.name for _, state in description.state_pairs() if "nominal" not in state.attributes]
    if description.model_exchange is not None and bare:
        yield rules.NOMINAL.finding(f"without a nominal value: {listed(bare)}")


EXCHANGE_RULES = (states, unlisted, reinit, indicators, knowns, serialize, nominals)


def identifier(subject: Subject) -> Iterator[Finding]:
    """Check the identifier of ModelExchange, and that every platform has its binary."""
    description = subject.description
    if description is None or description.model_exchange is None:
        return
    name = description.model_exchange.get("modelIdentifier", "")
    if not re.fullmatch(r"[A-Za-z_]\w*", name, flags=re.ASCII):
        yield rules.IDENTIFIER.finding(f"it is {name!r}")
        return
    platforms = {binary.platform: set[str]() for binary in subject.binaries}
    for binary in subject.binaries:
        platforms[binary.platform].add(PurePosixPath(binary.name).stem)
    missing = sorted(platform for platform, names in platforms.items() if name not in names)
    if missing:
        yield rules.IDENTIFIER.finding(f"there is no binary {name!r} for {listed(missing)}")


def source_files(subject: Subject) -> Iterator[Finding]:
    """Check that the listed source files of ModelExchange exist."""
    description = subject.description
    names = description.exchange_source_files if description else ()
    if description and description.fmi == 3 and names == description.source_files:
        return  # one list for both, which the rule for co-simulation covers
    missing = [name for name in names if f"sources/{name}" not in subject.members]
    if missing:
        yield rules.SOURCE_FILES.finding(f"missing in sources/: {listed(missing)}")


EXCHANGE_ARCHIVE_RULES = (identifier, source_files)
