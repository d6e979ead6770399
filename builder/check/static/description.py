"""Rules for modelDescription.xml except its variables: identity, model structure, capabilities, model exchange."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import pairwise

from builder.check.rules import Faults, some
from eightpost.fmi.description import Description, Variable

# ---- Identity -------------------------------------------------------------------------------------------------------

_VERSION_3 = re.compile(r"3\.0(\.\d+)?(-.+)?")
_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_PLAIN = re.compile(r"[A-Za-z0-9{}_-]+")
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_ABOUT = ("description", "author", "version", "license", "generationTool")
_TIMES = {"startTime", "stopTime", "stepSize"}


def doubled(names: Iterable[str]) -> list[str]:
    """Return the names that occur more than once."""
    return [name for name, count in Counter(names).items() if count > 1]


def identity(fmu: Description) -> Faults:
    """Yield faults of version, GUID, identifier, date, authorship, default experiment and log categories."""
    stated = fmu.attributes.get("fmiVersion")
    if stated != "2.0" and not (fmu.fmi == 3 and _VERSION_3.fullmatch(stated or "")):
        yield "fmi-version", f"it is {stated!r}"
    if not fmu.guid.strip():
        yield "guid-present", "the attribute guid is missing or empty"
    elif not _PLAIN.fullmatch(fmu.guid):
        yield "guid-plain", f"it is {fmu.guid!r}"
    if fmu.co_simulation is None:
        yield "co-simulation", "there is no element CoSimulation"
    elif not _C_NAME.fullmatch(fmu.identifier):
        yield "model-identifier", f"it is {fmu.identifier!r}"
    date = fmu.attributes.get("generationDateAndTime")
    if date is not None and not _is_date(date):
        yield "date-format", f"it is {date!r}"
    yield "about", some((name for name in _ABOUT if not fmu.attributes.get(name, "").strip()), "missing: ")
    given = fmu.experiment or {}
    if given.keys() & _TIMES:
        yield "default-experiment", some(sorted(_TIMES - given.keys()), "missing: ")
        yield "experiment-sense", "; ".join(_invalid_values(given))
    else:
        yield "default-experiment", "it is missing"
    yield "log-categories", some(doubled(fmu.categories), "duplicate names: ")


def _is_date(text: str) -> bool:
    try:
        return bool(_DATE.fullmatch(text) and datetime.fromisoformat(text))
    except ValueError:
        return False


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


# ---- Model structure ------------------------------------------------------------------------------------------------

_KINDS = {"dependent", "constant", "fixed", "tunable", "discrete"}

#: FMI 3.0 lets outputs also depend on structural parameters and on clocks, which are inputs or local.
_KNOWN_CAUSALITIES = ("input", "independent", "structuralParameter")


def structure(fmu: Description) -> Faults:
    """Yield faults of the lists of unknowns and of their dependencies."""
    valid = f"between 1 and {len(fmu.variables)}" if fmu.fmi == 2 else "the reference of a variable"
    for unknown in fmu.unknowns:
        wrong = [i for i in (unknown.index, *(unknown.dependencies or ())) if fmu.variable(i) is None]
        yield "unknown-index", some(wrong, f"{unknown.section}, unknown {unknown.index!r}: ", f" is not {valid}")
    outputs = [v for v in fmu.variables if v.causality == "output"]
    if outputs or "Outputs" in fmu.sections:
        yield from _compared("outputs-complete", fmu.listed_in("Outputs"), outputs)
    initial = [v for v in fmu.variables if _is_initial_unknown(v)] + list(_initial_states(fmu))
    yield from _compared("initial-unknowns", fmu.listed_in("InitialUnknowns"), initial)
    if fmu.fmi == 2:  # FMI 3.0 does not demand an order
        indices = pairwise(v.index for v in fmu.listed_in("InitialUnknowns"))
        falls = (f"index {after} comes after {before}" for before, after in indices if after < before)
        yield "initial-unknowns-order", next(falls, "")
    places = [(unknown, f"{unknown.section}, unknown {unknown.index}: ") for unknown in fmu.unknowns]
    for unknown, place in places:
        kinds, count = unknown.kinds, len(unknown.dependencies or ())
        if kinds is not None and (unknown.dependencies is None or len(kinds) != count):
            yield "dependencies-kind", f"{place}{count} dependencies, {len(kinds)} kinds"
        yield "dependencies-kind", some(sorted(set(kinds or ()) - _KINDS), place)
    for unknown, place in places:
        yield "dependency-unique", some(doubled(unknown.dependencies or ()), place)
    for variable in fmu.listed_in("Derivatives"):
        if fmu.variable(variable.attributes.get("derivative", "")) is None:
            yield "derivatives-complete", f"{variable.name} has no valid attribute derivative"
    for section in ("Outputs", "Derivatives", "InitialUnknowns"):
        bare = (fmu.name_of(u) for u in fmu.in_section(section) if u.dependencies is None)
        yield "dependencies-declared", some(bare, f"{section}: not declared for ")
    states = {v.attributes.get("derivative") for v in fmu.variables}
    for unknown in fmu.in_section("Outputs"):
        known = [v for v in fmu.named(unknown.dependencies or ()) if v.causality not in _KNOWN_CAUSALITIES]
        wrong = [v.name for v in known if str(v.index) not in states]
        yield "dependency-known", some(wrong, f"{fmu.name_of(unknown)} lists ")


def _is_initial_unknown(variable: Variable) -> bool:
    if variable.type == "Clock" or "clocks" in variable.attributes:  # of FMI 3.0: they have no value at the start
        return False
    if variable.causality == "output":
        return variable.effective_initial in ("calculated", "approx")
    return variable.causality == "calculatedParameter"


def _initial_states(fmu: Description) -> Iterator[Variable]:
    for derivative in fmu.listed_in("Derivatives"):
        for variable in (fmu.variable(derivative.attributes.get("derivative", "")), derivative):
            if variable is not None and variable.effective_initial in ("calculated", "approx"):
                yield variable


def _compared(rule: str, found: list[Variable], expected: list[Variable]) -> Faults:
    present, needed = _by_reference(found), _by_reference(expected)
    yield rule, some((name for key, name in needed.items() if key not in present), "missing: ")
    yield rule, some((name for key, name in present.items() if key not in needed), "not allowed: ")
    yield rule, some(doubled(v.name for v in found), "listed twice: ")


def _by_reference(variables: list[Variable]) -> dict[tuple[str, str], str]:
    """Return the name of the first variable of each type and value reference, so that aliases count as one."""
    names: dict[tuple[str, str], str] = {}
    for variable in variables:
        names.setdefault((variable.type, variable.reference or variable.name), variable.name)
    return names


# ---- Capabilities ---------------------------------------------------------------------------------------------------

_OFFERS = {
    "canGetAndSetFMUstate": "FMU state",
    "canInterpolateInputs": "input derivatives",
    "providesDirectionalDerivative": "directional derivatives",
}
_SERIALIZE = "canSerializeFMUstate is true, canGetAndSetFMUstate is not"


def capabilities(fmu: Description) -> Faults:
    """Yield faults of the capability flags."""
    if fmu.can("canSerializeFMUstate") and not fmu.can("canGetAndSetFMUstate"):
        yield "serialize-needs-state", _SERIALIZE
    if fmu.can("needsExecutionTool"):
        yield "execution-tool", "needsExecutionTool is true"
    if fmu.co_simulation is not None and not fmu.can("canHandleVariableCommunicationStepSize"):
        yield "variable-step", "canHandleVariableCommunicationStepSize is not true"
    if fmu.can("canBeInstantiatedOnlyOncePerProcess"):
        yield "instantiate-many", "canBeInstantiatedOnlyOncePerProcess is true"
    if fmu.co_simulation is not None:
        yield "capabilities-offered", some((o for flag, o in _OFFERS.items() if not fmu.can(flag)), "not supported: ")


# ---- Model exchange -------------------------------------------------------------------------------------------------


def exchange(fmu: Description) -> Faults:
    """Yield faults of states, derivatives and event indicators."""
    pairs, offered = list(fmu.state_pairs()), fmu.model_exchange is not None
    wrong = []
    for derivative, state in pairs:
        wrong += [f"{state.name} is its own derivative"] if derivative is state else []
        wrong += [f"{v.name} is not a continuous Real" for v in (derivative, state) if not v.is_continuous_real]
    wrong += [f"{name} has several derivatives" for name in doubled(state.name for _, state in pairs)]
    yield "state-continuous", some(wrong)
    named, states = {derivative.index for derivative, _ in pairs}, {state.index for _, state in pairs}
    local = [v for v in fmu.variables if "derivative" in v.attributes and v.causality == "local"]
    if offered:
        unlisted = (v.name for v in local if v.index not in named and v.is_continuous_real)
        yield "derivative-unlisted", some(unlisted, "not listed: ")
    reset = (v.name for v in fmu.variables if "reinit" in v.attributes and v.index not in states)
    yield "reinit", some(reset, "present on ")
    if offered and not re.fullmatch(r"\d+", fmu.event_indicators, flags=re.ASCII):
        yield "event-indicators", f"it is {fmu.event_indicators!r}"
    for unknown in fmu.in_section("Derivatives"):
        known = [v for v in fmu.named(unknown.dependencies or ()) if v.causality not in ("input", "independent")]
        yield (
            "derivative-known",
            some((v.name for v in known if v.index not in states), f"{fmu.name_of(unknown)} lists "),
        )
    if fmu.can_exchange("canSerializeFMUstate") and not fmu.can_exchange("canGetAndSetFMUstate"):
        yield "exchange-serialize", _SERIALIZE
    if offered:
        bare = (state.name for _, state in pairs if "nominal" not in state.attributes)
        yield "state-nominal", some(bare, "without a nominal value: ")
