"""Rules for ModelVariables: names, value references, causalities, start values."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator

from builder.check.catalogue import description as rules
from builder.check.description import Description, Variable
from builder.check.rules import Finding, listed

_VARIABILITIES = {
    "parameter": ("fixed", "tunable"),
    "calculatedParameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
_CALCULATED = ("calculated", "approx")
_BOOLEANS = ("true", "false", "0", "1")


def _initials(variable: Variable) -> tuple[str, ...]:
    """Return the allowed values of `initial`."""
    if variable.causality == "parameter" or variable.variability == "constant":
        return ("exact",)
    if variable.causality == "calculatedParameter" or variable.variability in ("fixed", "tunable"):
        return _CALCULATED
    return ("exact", *_CALCULATED)


def names(description: Description) -> Iterator[Finding]:
    """Check that names are unique."""
    doubled = [name for name, count in Counter(v.name for v in description.variables).items() if count > 1]
    if doubled:
        yield rules.NAMES.finding(f"several variables are named {listed(doubled)}")


def aliases(description: Description) -> Iterator[Finding]:
    """Check that variables with the same value reference are consistent."""
    sets: dict[tuple[str, str], list[Variable]] = defaultdict(list)
    for variable in description.variables:
        kind = "Integer" if variable.type == "Enumeration" else variable.type
        sets[kind, variable.reference].append(variable)
    for (kind, reference), same in sets.items():
        if len(same) > 1 and (why := _disagreement(same)):
            yield rules.ALIASES.finding(f"{kind} {reference}: {listed([v.name for v in same])} {why}")


def _disagreement(same: list[Variable]) -> str:
    if len({v.unit for v in same}) > 1:
        return "have different units"
    if sum(v.is_settable_at_start for v in same) > 1:
        return "can all be set"
    starts = [v for v in same if v.start is not None and v.variability != "constant"]
    return "have several start values" if len(starts) > 1 else ""


def combinations(description: Description) -> Iterator[Finding]:
    """Check that causality, variability and initial are a valid combination."""
    for v in description.variables:
        if v.variability not in _VARIABILITIES.get(v.causality, ()):
            yield rules.COMBINATION.finding(f"{v.name}: causality {v.causality} with variability {v.variability}")
        elif v.causality not in ("input", "independent") and v.initial is not None and v.initial not in _initials(v):
            yield rules.COMBINATION.finding(f"{v.name}: initial {v.initial} on a {v.variability} {v.causality}")


def initial_on_inputs(description: Description) -> Iterator[Finding]:
    """Check that inputs and time have no `initial`."""
    wrong = [v.name for v in description.variables if v.causality in ("input", "independent") and v.initial]
    if wrong:
        yield rules.INITIAL_INPUT.finding(f"present on {listed(wrong)}")


def continuous(description: Description) -> Iterator[Finding]:
    """Check that only Reals are continuous."""
    wrong = [v.name for v in description.variables if v.type != "Real" and v.variability == "continuous"]
    if wrong:
        yield rules.CONTINUOUS.finding(f"continuous but not Real: {listed(wrong)}")


def start_presence(description: Description) -> Iterator[Finding]:
    """Check that start values are present exactly if they are required or allowed."""
    missing, surplus = [], []
    for v in description.variables:
        if v.causality == "independent" or v.effective_initial == "calculated":
            surplus += [v.name] if v.start is not None else []
        elif v.start is None and (v.causality == "input" or v.effective_initial in ("exact", "approx")):
            missing.append(v.name)
    if missing:
        yield rules.START_MISSING.finding(f"missing on {listed(missing)}")
    if surplus:
        yield rules.START_FORBIDDEN.finding(f"present on {listed(surplus)}")


def values(description: Description) -> Iterator[Finding]:
    """Check that start, min, max and nominal are valid values of their type."""
    for v in description.variables:
        for attribute in ("start", "min", "max", "nominal"):
            if attribute in v.attributes and not _is_value(v, v.attributes[attribute]):
                yield rules.START_VALUE.finding(f"{v.name}: {attribute} is {v.attributes[attribute]!r}")


def _is_value(variable: Variable, text: str) -> bool:
    if variable.type == "Boolean":
        return text.strip() in _BOOLEANS
    try:
        if variable.type == "Real":
            return math.isfinite(float(text))
        if variable.type in ("Integer", "Enumeration"):
            return -(2**31) <= int(text) < 2**31
    except ValueError:
        return False
    return True


def nominals(description: Description) -> Iterator[Finding]:
    """Check that nominal values are positive."""
    stated = ((v, v.number("nominal")) for v in description.variables)
    wrong = [f"{v.name} has {value:g}" for v, value in stated if value is not None and value <= 0.0]
    if wrong:
        yield rules.NOMINAL.finding(listed(wrong))


def ranges(description: Description) -> Iterator[Finding]:
    """Check that min <= start <= max."""
    for v in description.variables:
        low, start, high = (v.number(name) for name in ("min", "start", "max"))
        known = [value for value in (low, start, high) if value is not None]
        if known != sorted(known):
            yield rules.START_RANGE.finding(f"{v.name}: min {low}, start {start}, max {high}")


def declared_types(description: Description) -> Iterator[Finding]:
    """Check that declared types exist and match the variable's type."""
    for name, declared in description.declared_types.items():
        kind = description.types.get(declared)
        if kind is None:
            yield rules.DECLARED_TYPE.finding(f"{name} is of type {declared!r}, which is not declared")
        elif kind[0] != description.by_name[name].type:
            yield rules.DECLARED_TYPE.finding(
                f"{name} is {description.by_name[name].type}, but its declared type {declared!r} is {kind[0]}"
            )


def independent(description: Description) -> Iterator[Finding]:
    """Check that at most one variable is independent."""
    times = [v.name for v in description.variables if v.causality == "independent"]
    if len(times) > 1:
        yield rules.INDEPENDENT.finding(f"independent variables: {listed(times)}")


def descriptions(description: Description) -> Iterator[Finding]:
    """Check that inputs, outputs and parameters have descriptions."""
    seen = ("input", "output", "parameter")
    bare = [v.name for v in description.variables if v.causality in seen and not v.description.strip()]
    if bare:
        yield rules.DESCRIPTIONS.finding(f"without a description: {listed(bare)}")


RULES = (
    names, aliases, combinations, initial_on_inputs, continuous, start_presence, values, nominals, ranges,
    declared_types, independent, descriptions,
)  # fmt: skip
