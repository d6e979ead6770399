"""Rules for ModelStructure: completeness of its lists, and dependencies."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator

from builder.check.catalogue import description as rules
from builder.check.description import Description, Unknown, Variable
from builder.check.rules import Finding, Rule, listed

_KINDS = {"dependent", "constant", "fixed", "tunable", "discrete"}


def indices(description: Description) -> Iterator[Finding]:
    """Check that indices refer to variables."""
    for unknown in description.unknowns:
        wrong = [i for i in (unknown.index, *(unknown.dependencies or ())) if description.variable(i) is None]
        if wrong:
            yield rules.INDEX.finding(
                f"{unknown.section}, unknown {unknown.index!r}: {listed(wrong)} is not between 1 and "
                f"{len(description.variables)}"
            )


def outputs(description: Description) -> Iterator[Finding]:
    """Check that Outputs lists all outputs."""
    expected = [v for v in description.variables if v.causality == "output"]
    if expected or "Outputs" in description.sections:
        yield from _compare(rules.OUTPUTS, _named(description, "Outputs"), _distinct(expected))


def initial_unknowns(description: Description) -> Iterator[Finding]:
    """Check that InitialUnknowns lists all variables that initialization computes."""
    expected = [v for v in description.variables if _is_initial_unknown(v)] + list(_initial_states(description))
    yield from _compare(rules.INITIAL_UNKNOWNS, _named(description, "InitialUnknowns"), _distinct(expected))


def _is_initial_unknown(variable: Variable) -> bool:
    if variable.causality == "output":
        return variable.effective_initial in ("calculated", "approx")
    return variable.causality == "calculatedParameter"


def _initial_states(description: Description) -> Iterator[Variable]:
    for unknown in description.in_section("Derivatives"):
        derivative = description.variable(unknown.index)
        state = description.variable(derivative.attributes.get("derivative", "")) if derivative else None
        for variable in (state, derivative):
            if variable is not None and variable.effective_initial in ("calculated", "approx"):
                yield variable


def _distinct(variables: list[Variable]) -> dict[tuple[str, str], list[Variable]]:
    """Return the variables grouped by type and value reference, so that aliases are in one group."""
    found: dict[tuple[str, str], list[Variable]] = {}
    for variable in variables:
        found.setdefault((variable.type, variable.reference or variable.name), []).append(variable)
    return found


def _named(description: Description, section: str) -> list[Variable]:
    found = (description.variable(unknown.index) for unknown in description.in_section(section))
    return [variable for variable in found if variable is not None]


def _compare(rule: Rule, named: list[Variable], expected: dict[tuple[str, str], list[Variable]]) -> Iterator[Finding]:
    present = _distinct(named)
    missing = [group[0].name for key, group in expected.items() if key not in present]
    surplus = [group[0].name for key, group in present.items() if key not in expected]
    doubled = [name for name, count in Counter(v.name for v in named).items() if count > 1]
    for what, found in (("missing", missing), ("not allowed", surplus), ("listed twice", doubled)):
        if found:
            yield rule.finding(f"{what}: {listed(found)}")


def order(description: Description) -> Iterator[Finding]:
    """Check that InitialUnknowns are ordered."""
    found = [v.index for v in _named(description, "InitialUnknowns")]
    for before, after in itertools.pairwise(found):
        if after < before:
            yield rules.INITIAL_ORDER.finding(f"index {after} comes after {before}")
            return


def kinds(description: Description) -> Iterator[Finding]:
    """Check that dependenciesKind has one valid keyword per dependency."""
    for unknown in description.unknowns:
        given = unknown.kinds
        if given is None:
            continue
        where = f"{unknown.section}, unknown {unknown.index}"
        if unknown.dependencies is None or len(given) != len(unknown.dependencies):
            yield rules.KINDS.finding(f"{where}: {len(unknown.dependencies or ())} dependencies, {len(given)} kinds")
        if strange := sorted(set(given) - _KINDS):
            yield rules.KINDS.finding(f"{where}: {listed(strange)}")


def twice(description: Description) -> Iterator[Finding]:
    """Check that each dependency is listed once."""
    for unknown in description.unknowns:
        doubled = [index for index, count in Counter(unknown.dependencies or ()).items() if count > 1]
        if doubled:
            yield rules.DEPENDENCY_TWICE.finding(f"{unknown.section}, unknown {unknown.index}: {listed(doubled)}")


def derivatives(description: Description) -> Iterator[Finding]:
    """Check that Derivatives lists derivatives."""
    for variable in _named(description, "Derivatives"):
        if description.variable(variable.attributes.get("derivative", "")) is None:
            yield rules.DERIVATIVES.finding(f"{variable.name} has no valid attribute derivative")


def declared(description: Description) -> Iterator[Finding]:
    """Check that dependencies are declared."""
    for section in ("Outputs", "Derivatives", "InitialUnknowns"):
        bare = [_name(description, u) for u in description.in_section(section) if u.dependencies is None]
        if bare:
            yield rules.DEPENDENCIES.finding(f"{section}: not declared for {listed(bare)}")


def knowns(description: Description) -> Iterator[Finding]:
    """Check that outputs only depend on inputs, states and time."""
    states = {v.attributes.get("derivative") for v in description.variables}
    for unknown in description.in_section("Outputs"):
        found = [v for v in (description.variable(i) for i in unknown.dependencies or ()) if v is not None]
        wrong = [v.name for v in found if v.causality not in ("input", "independent") and str(v.index) not in states]
        if wrong:
            yield rules.KNOWNS.finding(f"{_name(description, unknown)} lists {listed(wrong)}")


def _name(description: Description, unknown: Unknown) -> str:
    variable = description.variable(unknown.index)
    return variable.name if variable else unknown.index


RULES = (indices, outputs, initial_unknowns, order, kinds, twice, derivatives, declared, knowns)
