"""Rules for modelDescription.xml except its variables: identity, model structure, capabilities."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import datetime

from builder.check.catalogue import static as rules
from builder.check.description import Description, Unknown, Variable
from builder.check.rules import Finding, Rule, listed

# ---- Identity -------------------------------------------------------------------------------------------------------

_VERSION_3 = re.compile(r"3\.0(\.\d+)?(-.+)?")
_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_PLAIN = re.compile(r"[A-Za-z0-9{}_-]+")
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_ABOUT = ("description", "author", "version", "license", "generationTool")


def _version(description: Description) -> Iterator[Finding]:
    """Check that fmiVersion is 2.0, or one of FMI 3.0."""
    stated = description.attributes.get("fmiVersion")
    if stated != "2.0" and not (description.fmi == 3 and _VERSION_3.fullmatch(stated or "")):
        yield rules.VERSION.finding(f"it is {stated!r}")


def _guid(description: Description) -> Iterator[Finding]:
    """Check that there is a GUID of plain characters."""
    if not description.guid.strip():
        yield rules.GUID.finding("the attribute guid is missing or empty")
    elif not _PLAIN.fullmatch(description.guid):
        yield rules.GUID_PLAIN.finding(f"it is {description.guid!r}")


def _identifier(description: Description) -> Iterator[Finding]:
    """Check that co-simulation is supported and that its modelIdentifier is a C name."""
    if description.co_simulation is None:
        yield rules.CO_SIMULATION.finding("there is no element CoSimulation")
    elif not _C_NAME.fullmatch(description.identifier):
        yield rules.IDENTIFIER.finding(f"it is {description.identifier!r}")


def _date(description: Description) -> Iterator[Finding]:
    """Check that generationDateAndTime is a date in UTC."""
    stated = description.attributes.get("generationDateAndTime")
    if stated is not None and not _is_date(stated):
        yield rules.DATE.finding(f"it is {stated!r}")


def _is_date(text: str) -> bool:
    if not _DATE.fullmatch(text):
        return False
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True


def _about(description: Description) -> Iterator[Finding]:
    """Check that description, author, version, license and generationTool are present."""
    missing = [name for name in _ABOUT if not description.attributes.get(name, "").strip()]
    if missing:
        yield rules.ABOUT.finding(f"missing: {listed(missing)}")


def _experiment(description: Description) -> Iterator[Finding]:
    """Check that there is a valid default experiment."""
    given = description.experiment
    if given is None or not given.keys() & {"startTime", "stopTime", "stepSize"}:
        yield rules.EXPERIMENT.finding("it is missing")
        return
    missing = sorted({"startTime", "stopTime", "stepSize"} - given.keys())
    if missing:
        yield rules.EXPERIMENT.finding(f"missing: {listed(missing)}")
    if wrong := list(_invalid_values(given)):
        yield rules.EXPERIMENT_SENSE.finding("; ".join(wrong))


def _invalid_values(given: Mapping[str, str]) -> Iterator[str]:
    values = {}
    for name, text in given.items():
        try:
            values[name] = float(text)
        except ValueError:
            yield f"{name} is {text!r}"
    for name in ("stepSize", "tolerance"):
        if values.get(name, 1.0) <= 0.0:
            yield f"{name} is {given[name]}"
    if "stopTime" in values and values["stopTime"] <= values.get("startTime", 0.0):
        yield f"it stops at {given['stopTime']} s and starts at {given.get('startTime', '0')} s"


def _categories(description: Description) -> Iterator[Finding]:
    """Check that names of log categories are unique."""
    doubled = [name for name, count in Counter(description.categories).items() if count > 1]
    if doubled:
        yield rules.CATEGORIES.finding(f"duplicate names: {listed(doubled)}")


IDENTITY_RULES = (_version, _guid, _identifier, _date, _about, _experiment, _categories)


# ---- Model structure ------------------------------------------------------------------------------------------------

_KINDS = {"dependent", "constant", "fixed", "tunable", "discrete"}


def _indices(description: Description) -> Iterator[Finding]:
    """Check that indices refer to variables."""
    for unknown in description.unknowns:
        wrong = [i for i in (unknown.index, *(unknown.dependencies or ())) if description.variable(i) is None]
        valid = f"between 1 and {len(description.variables)}" if description.fmi == 2 else "the reference of a variable"
        if wrong:
            yield rules.INDEX.finding(f"{unknown.section}, unknown {unknown.index!r}: {listed(wrong)} is not {valid}")


def _outputs(description: Description) -> Iterator[Finding]:
    """Check that Outputs lists all outputs."""
    expected = [v for v in description.variables if v.causality == "output"]
    if expected or "Outputs" in description.sections:
        yield from _compare(rules.OUTPUTS, _named(description, "Outputs"), _distinct(expected))


def _initial_unknowns(description: Description) -> Iterator[Finding]:
    """Check that InitialUnknowns lists all variables that initialization computes."""
    expected = [v for v in description.variables if _is_initial_unknown(v)] + list(_initial_states(description))
    yield from _compare(rules.INITIAL_UNKNOWNS, _named(description, "InitialUnknowns"), _distinct(expected))


def _is_initial_unknown(variable: Variable) -> bool:
    if variable.type == "Clock" or "clocks" in variable.attributes:  # of FMI 3.0: they have no value at the start
        return False
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


def _order(description: Description) -> Iterator[Finding]:
    """Check that InitialUnknowns are ordered, which FMI 3.0 does not demand."""
    if description.fmi == 3:
        return
    found = [v.index for v in _named(description, "InitialUnknowns")]
    for before, after in itertools.pairwise(found):
        if after < before:
            yield rules.INITIAL_ORDER.finding(f"index {after} comes after {before}")
            return


def _kinds(description: Description) -> Iterator[Finding]:
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


def _twice(description: Description) -> Iterator[Finding]:
    """Check that each dependency is listed once."""
    for unknown in description.unknowns:
        doubled = [index for index, count in Counter(unknown.dependencies or ()).items() if count > 1]
        if doubled:
            yield rules.DEPENDENCY_TWICE.finding(f"{unknown.section}, unknown {unknown.index}: {listed(doubled)}")


def _derivatives(description: Description) -> Iterator[Finding]:
    """Check that Derivatives lists derivatives."""
    for variable in _named(description, "Derivatives"):
        if description.variable(variable.attributes.get("derivative", "")) is None:
            yield rules.DERIVATIVES.finding(f"{variable.name} has no valid attribute derivative")


def _declared(description: Description) -> Iterator[Finding]:
    """Check that dependencies are declared."""
    for section in ("Outputs", "Derivatives", "InitialUnknowns"):
        bare = [_name(description, u) for u in description.in_section(section) if u.dependencies is None]
        if bare:
            yield rules.DEPENDENCIES.finding(f"{section}: not declared for {listed(bare)}")


def _knowns(description: Description) -> Iterator[Finding]:
    """Check that outputs only depend on inputs, states and time."""
    states = {v.attributes.get("derivative") for v in description.variables}
    for unknown in description.in_section("Outputs"):
        found = [v for v in (description.variable(i) for i in unknown.dependencies or ()) if v is not None]
        wrong = [v.name for v in found if v.causality not in _KNOWN_CAUSALITIES and str(v.index) not in states]
        if wrong:
            yield rules.KNOWNS.finding(f"{_name(description, unknown)} lists {listed(wrong)}")


def _name(description: Description, unknown: Unknown) -> str:
    variable = description.variable(unknown.index)
    return variable.name if variable else unknown.index


#: FMI 3.0 lets outputs also depend on structural parameters and on clocks, which are inputs or local.
_KNOWN_CAUSALITIES = ("input", "independent", "structuralParameter")

STRUCTURE_RULES = (_indices, _outputs, _initial_unknowns, _order, _kinds, _twice, _derivatives, _declared, _knowns)


# ---- Capabilities ---------------------------------------------------------------------------------------------------

_OFFERS = {
    "canGetAndSetFMUstate": "FMU state",
    "canInterpolateInputs": "input derivatives",
    "providesDirectionalDerivative": "directional derivatives",
}


def _serialize(description: Description) -> Iterator[Finding]:
    """Check that canSerializeFMUstate is only declared with canGetAndSetFMUstate."""
    if description.can("canSerializeFMUstate") and not description.can("canGetAndSetFMUstate"):
        yield rules.SERIALIZE.finding("canSerializeFMUstate is true, canGetAndSetFMUstate is not")


def _runs_alone(description: Description) -> Iterator[Finding]:
    """Check that no execution tool is needed."""
    if description.can("needsExecutionTool"):
        yield rules.RUNS_ALONE.finding("needsExecutionTool is true")


def _variable_step(description: Description) -> Iterator[Finding]:
    """Check that any communication step size is accepted."""
    if description.co_simulation is not None and not description.can("canHandleVariableCommunicationStepSize"):
        yield rules.VARIABLE_STEP.finding("canHandleVariableCommunicationStepSize is not true")


def _many(description: Description) -> Iterator[Finding]:
    """Check that several instances per process are allowed."""
    if description.can("canBeInstantiatedOnlyOncePerProcess"):
        yield rules.MANY.finding("canBeInstantiatedOnlyOncePerProcess is true")


def _offered(description: Description) -> Iterator[Finding]:
    """Check that the optional features for coupling stiff systems are supported."""
    missing = [what for flag, what in _OFFERS.items() if not description.can(flag)]
    if description.co_simulation is not None and missing:
        yield rules.OFFERED.finding(f"not supported: {listed(missing)}")


CAPABILITY_RULES = (_serialize, _runs_alone, _variable_step, _many, _offered)
