"""Rules for modelDescription.xml."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import chain, pairwise

from builder.check.archive import CheckedFmu, binaries, contents, entries, exchange_files, terminals
from builder.check.rules import Faults, Finding, findings, listed, some
from eightpost import units
from eightpost.errors import UnknownUnitError
from eightpost.fmi import BUILD, Description, Unit, Variable, whole_number

# ---- Identity -------------------------------------------------------------------------------------------------------

_VERSION_3 = re.compile(r"3\.0(\.\d+)?(-.+)?")
_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_PLAIN = re.compile(r"[A-Za-z0-9{}_-]+")
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_ABOUT = ("modelName", "description", "author", "version", "license", "generationTool")
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
            values[name] = math.nan
        if not math.isfinite(values[name]):
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
        known = (v for v in fmu.named(unknown.dependencies or ()) if v.causality not in ("input", "independent"))
        wrong = [v.name for v in known if v.index not in states]
        yield "derivative-known", some(wrong, f"{fmu.name_of(unknown)} lists ")
    if fmu.can_exchange("canSerializeFMUstate") and not fmu.can_exchange("canGetAndSetFMUstate"):
        yield "exchange-serialize", _SERIALIZE
    if offered:
        bare = (state.name for _, state in pairs if "nominal" not in state.attributes)
        yield "state-nominal", some(bare, "without a nominal value: ")


# ---- Names, value references, causalities, start values -------------------------------------------------------------

_VARIABILITIES = {
    **dict.fromkeys(("parameter", "calculatedParameter", "structuralParameter"), ("fixed", "tunable")),
    "input": ("discrete", "continuous"),
    "output": ("constant", "discrete", "continuous"),
    "local": ("constant", "fixed", "tunable", "discrete", "continuous"),
    "independent": ("continuous",),
}
_CALCULATED = ("calculated", "approx")
_BOOLEANS = ("true", "false", "0", "1")


def variables(fmu: Description) -> Faults:
    """Yield faults of names, references, causalities, types and start values."""
    every = fmu.variables
    names = [v.name for v in every] + [alias.get("name", "") for v in every for alias in v.aliases]
    yield "variable-unique", some(doubled(names), "several variables are named ")
    yield from _aliases(fmu)
    for v in every:
        if v.variability not in _VARIABILITIES.get(v.causality, ()):
            yield "variable-combination", f"{v.name}: causality {v.causality} with variability {v.variability}"
        elif v.causality not in ("input", "independent") and v.initial is not None and v.initial not in _initials(v):
            yield "variable-combination", f"{v.name}: initial {v.initial} on a {v.variability} {v.causality}"
    no_initial = ("input", "independent") if fmu.fmi == 2 else ("independent",)  # FMI 3.0 allows it for inputs
    yield "initial-on-input", some((v.name for v in every if v.causality in no_initial and v.initial), "present on ")
    continuous = (v.name for v in every if v.type != "Real" and v.variability == "continuous")
    yield "continuous-real", some(continuous, "continuous but not Real: ")
    yield from _start_presence(fmu)
    for v in every:
        for name in ("start", "min", "max", "nominal"):
            if name in v.attributes and not _is_value(v, v.attributes[name]):
                yield "start-value", f"{v.name}: {name} is {v.attributes[name]!r}"
    nominals = ((v, v.number("nominal")) for v in every)
    yield "nominal", some(f"{v.name} has {value:g}" for v, value in nominals if value is not None and value <= 0.0)
    for v in every:
        limits = low, start, high = v.number("min"), v.number("start"), v.number("max")
        known = [value for value in limits if value is not None]
        if known != sorted(known):
            yield "start-range", f"{v.name}: min {low}, start {start}, max {high}"
    for v in every:
        yield "declared-type", _fault_of_type(fmu, v)
    for name, items in fmu.items.items():
        yield "enumeration-values", some(doubled(items.values()), f"{name}: several items have the value ")
    times = [v.name for v in every if v.causality == "independent"]
    if len(times) > 1:
        yield "independent", f"independent variables: {listed(times)}"
    elif not times and fmu.fmi == 3:
        yield "independent", "the time variable is missing, which FMI 3.0 needs"
    shown = (v for v in every if v.causality in ("input", "output", "parameter"))
    yield "variable-description", some((v.name for v in shown if not v.description.strip()), "without a description: ")


def _initials(variable: Variable) -> tuple[str, ...]:
    if variable.causality in ("parameter", "structuralParameter") or variable.variability == "constant":
        return ("exact",)
    if variable.causality == "calculatedParameter" or variable.variability in ("fixed", "tunable"):
        return _CALCULATED
    return ("exact", *_CALCULATED)


def _aliases(fmu: Description) -> Faults:
    """Compare variables with the same value reference; FMI 3.0 allows only one."""
    if fmu.fmi == 3:
        counts = Counter(v.reference for v in fmu.variables)
        shared = (v.name for v in fmu.variables if counts[v.reference] > 1)
        yield "alias-set", some(shared, after=": each variable needs its own; use elements Alias")
        return
    sets: dict[tuple[str, str], list[Variable]] = {}
    for v in fmu.variables:
        sets.setdefault(("Integer" if v.type == "Enumeration" else v.type, v.reference), []).append(v)
    for (kind, reference), same in sets.items():
        if len(same) > 1 and (why := _disagreement(same)):
            yield "alias-set", f"{kind} {reference}: {listed([v.name for v in same])} {why}"


def _disagreement(same: list[Variable]) -> str:
    if len({v.unit for v in same}) > 1:
        return "have different units"
    if sum(v.is_settable_at_start for v in same) > 1:
        return "can all be set"
    starts = [v for v in same if v.start is not None and v.variability != "constant"]
    return "have several start values" if len(starts) > 1 else ""


def _start_presence(fmu: Description) -> Faults:
    missing, surplus = [], []
    for v in fmu.variables:
        if v.type in ("Clock", "Binary"):  # clocks have no start value, that of a binary is optional
            continue
        if v.causality == "independent" or v.effective_initial == "calculated":
            surplus += [v.name] if v.start is not None else []
        elif v.start is None and (v.causality == "input" or v.effective_initial in ("exact", "approx")):
            missing.append(v.name)
    yield "start-required", some(missing, "missing on ")
    yield "start-forbidden", some(surplus, "present on ")


def _is_value(variable: Variable, text: str) -> bool:
    """Return whether a text is a finite value of a variable's type, or a list of them for an array."""
    return all(_is_scalar(variable, part) for part in (text.split() if variable.is_array else [text]))


def _is_scalar(variable: Variable, text: str) -> bool:
    if variable.type == "Boolean":
        return text.strip() in _BOOLEANS
    try:
        if variable.type == "Real":
            return math.isfinite(float(text))
        if variable.type in ("Integer", "Enumeration"):
            low, high = _integers(variable.native)
            return low <= int(text) < high
    except ValueError:
        return False
    return True


def _integers(native: str) -> tuple[int, int]:
    """Return the range of an integer type: the first value, and the first one beyond its end."""
    bits = 64 if native == "Enumeration" else int(native.partition("Int")[2] or 32)
    return (0, 2**bits) if native.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1))


def _fault_of_type(fmu: Description, v: Variable) -> str:
    declared = v.attributes.get("declaredType")
    if declared is None:
        return ""
    if declared not in fmu.types:
        return f"{v.name} is of type {declared!r}, which is not declared"
    kind, own = fmu.types[declared][0], v.native or v.type
    return "" if kind == own else f"{v.name} is {own}, but its declared type {declared!r} is {kind}"


# ---- Units, compared with the meaning of their names ----------------------------------------------------------------

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

#: SI exponents, factor and offset of a unit.
_Meaning = tuple[Mapping[str, int], float, float]

#: Names with two meanings, both of which are accepted.
_AMBIGUOUS: Mapping[str, tuple[_Meaning, ...]] = {
    "g": (({"m": 1, "s": -2}, 9.80665, 0.0), ({"kg": 1}, 1e-3, 0.0)),
    "lb": (({"kg": 1, "m": 1, "s": -2}, 4.4482216152605, 0.0), ({"kg": 1}, 0.45359237, 0.0)),
}
#: Names that have a different meaning in this project's file headers than in FMUs.
_UNKNOWN = {"C", "F", "c", "f", "h", "min", "-", "#", "gs"}

_TOLERANCE = 1e-6


def units_of(fmu: Description) -> Faults:
    """Yield faults of units and display units; those of names with a known meaning are compared with it."""
    displays = {unit.name: {display.get("name") for display in unit.displays} for unit in fmu.units}
    for v in fmu.variables:
        display = v.attributes.get("displayUnit")
        if v.unit is not None and v.unit not in displays:
            yield "unit-defined", f"{v.name} is in {v.unit!r}, which is not defined"
        elif display is not None and v.unit is None:
            yield "unit-defined", f"{v.name} has the display unit {display!r} but no unit"
        elif display is not None and display != v.unit and display not in displays[v.unit or ""]:
            what = f"the display unit {display!r}, which is not a display unit of {v.unit!r}"
            yield "unit-defined", f"{v.name} has {what}"
    twice = doubled(unit.name for unit in fmu.units)
    for unit in fmu.units:
        twice += [f"{name} of {unit.name}" for name in doubled(display.get("name", "") for display in unit.displays)]
    yield "unit-unique", some(twice, "defined twice: ")
    reals = (v for v in fmu.variables if v.type == "Real" and not v.unit)
    bare = (v.name for v in reals if fmu.fmi == 2 or v.causality != "independent")  # nothing is connected to time
    yield "unit-missing", some(bare, "without a unit: ")
    yield "unit-base", some((unit.name for unit in fmu.units if unit.base is None), "without a BaseUnit: ")
    for unit in fmu.units:
        yield from _base_unit(unit)
    for unit in fmu.units:
        for stated in unit.displays:
            yield "display-factor", _fault_of_display(unit.name, stated)


def _base_unit(unit: Unit) -> Faults:
    known = list(_meanings(unit.name))
    if unit.base is None or not known:
        return
    stated = {base: _number(unit.base, base, 0.0) for base in _BASE}
    alike = [meaning for meaning in known if _same_dimension(stated, meaning[0])]
    if not alike:
        yield "unit-exponents", f"{unit.name} is {_words(known[0][0])}, but its BaseUnit is {_words(stated)}"
    elif not any(_same_scale(unit.base, factor, offset) for _, factor, offset in alike):
        _, factor, offset = alike[0]
        own = f"the factor {unit.base.get('factor', '1')} with offset {unit.base.get('offset', '0')}"
        what = f"one {unit.name} is {factor:.9g} SI units with offset {offset:g}"
        yield "unit-factor", f"{what}, but its BaseUnit has {own}"


def _fault_of_display(unit: str, display: Mapping[str, str]) -> str:
    name = display.get("name", "")
    if not (list(_meanings(unit)) and list(_meanings(name))) or {unit, name} & _AMBIGUOUS.keys():
        return ""
    if not units.compatible(unit, name):
        return f"{unit} cannot be converted to {name}: the dimensions differ"
    factor, offset = units.conversion(unit, name)
    if _same_scale(display, factor, offset):
        return ""
    own = f"the factor is {display.get('factor', '1')} with offset {display.get('offset', '0')}"
    return f"one {unit} is {factor:.9g} {name} with offset {offset:g}, but {own}"


def _meanings(name: str) -> Iterator[_Meaning]:
    """Yield the meanings of a name; nothing for an unknown name."""
    if name in _AMBIGUOUS:
        yield from _AMBIGUOUS[name]
    elif name and name not in _UNKNOWN and units.is_unit(name):
        try:
            si = units.si_exponents(name)
            factor, offset = units.conversion(name, "K") if si == {"K": 1} else (units.si_factor(name), 0.0)
        except UnknownUnitError:
            return
        yield si, factor, offset


def _same_dimension(stated: Mapping[str, float], meant: Mapping[str, float]) -> bool:
    """Compare exponents; the radian only counts in rad and rad/s, because tools differ for units such as N.m/rad."""
    if any(stated.get(base, 0) != meant.get(base, 0) for base in _BASE if base != "rad"):
        return False
    return "rad" not in meant or bool(meant.keys() - {"rad", "s"}) or stated["rad"] == meant["rad"]


def _same_scale(stated: Mapping[str, str], factor: float, offset: float) -> bool:
    return math.isclose(_number(stated, "factor", 1.0), factor, rel_tol=_TOLERANCE) and math.isclose(
        _number(stated, "offset", 0.0), offset, rel_tol=_TOLERANCE, abs_tol=1e-9
    )


def _number(attributes: Mapping[str, str], name: str, default: float) -> float:
    try:
        return float(attributes.get(name, default))
    except ValueError:
        return math.nan


def _words(si: Mapping[str, float]) -> str:
    return " ".join(f"{base}^{power:g}" for base, power in si.items() if power) or "dimensionless"


# ==== Rules that only FMI 3.0 has, for the description and the build description =====================================

_INTERVALS = ("constant", "fixed", "tunable", "changing", "countdown", "triggered")


def version_3(fmu: Description) -> Faults:
    """Yield faults of arrays, clocks, clocked states, aliases, the time, and the flags of updates and events."""
    for v in fmu.variables:
        for number, dimension in enumerate(v.dimensions, 1):
            if fault := _fault_of_dimension(fmu, dimension):
                yield "array-dimension", f"{v.name}, dimension {number}: {fault}"
    for v in fmu.variables:
        length = fmu.lengths.get(v.name, 0)
        if v.start is None or v.type in ("String", "Binary") or length == 0:
            continue  # strings have elements of their own
        if (count := len(v.start.split())) not in (1, length):
            yield "array-start-count", f"{v.name} has {count} start values for {length} elements"
    for v in fmu.variables:
        clocks = v.attributes.get("clocks", "").split()
        yield "clock-reference", some((r for r in clocks if not _is_clock(fmu.variable(r))), f"{v.name} lists ")
        if v.type == "Clock" and (fault := _fault_of_interval(v)):
            yield "clock-interval", f"{v.name}: {fault}"
    for v in fmu.listed_in("ClockedStates"):
        yield "clocked-state", some(sorted({"previous", "clocks"} - v.attributes.keys()), f"{v.name} lacks ")
    displays = {unit.name: {display.get("name") for display in unit.displays} for unit in fmu.units}
    for v in fmu.variables:
        units = (alias["displayUnit"] for alias in v.aliases if "displayUnit" in alias)
        odd = sorted(unit for unit in units if unit != v.unit and unit not in displays.get(v.unit or "", set()))
        yield "alias-display-unit", some(odd, f"{v.name} is in {v.unit!r}, its alias is displayed in ")
    times = (v for v in fmu.variables if v.causality == "independent" and v.type != "Real")
    yield "independent-type", some(f"{v.name} is {v.native}" for v in times)
    if fmu.co_simulation is not None:
        yield from _flags(fmu)


def _flags(fmu: Description) -> Faults:
    offered = fmu.can("providesIntermediateUpdate")
    named = (v.name for v in fmu.variables if not offered and v.attributes.get("intermediateUpdate") in ("true", "1"))
    yield "intermediate-flag", some(named, after=" have intermediateUpdate, but the flag is not set")
    if fmu.can("canReturnEarlyAfterIntermediateUpdate") and not offered:
        yield "early-return-flag", "providesIntermediateUpdate is not true"
    inputs = (v.name for v in fmu.variables if v.type == "Clock" and v.causality == "input")
    if not fmu.can("hasEventMode"):
        yield "event-mode", some(inputs, "input clocks: ")


def _fault_of_dimension(fmu: Description, dimension: Mapping[str, str]) -> str:
    reference, start = dimension.get("valueReference"), dimension.get("start")
    if (reference is None) == (start is None):
        return "it has neither start nor valueReference" if start is None else "it has both start and valueReference"
    if reference is None:
        return f"its start is {start!r}" if whole_number((start or "").strip()) is None else ""
    size = fmu.variable(reference)
    if size is None:
        return f"its valueReference {reference!r} is not that of a variable"
    is_size = size.causality == "structuralParameter" and size.native == "UInt64"
    return "" if is_size else f"{size.name} is a {size.causality} of type {size.native}"


def _is_clock(variable: Variable | None) -> bool:
    return variable is not None and variable.type == "Clock"


def _fault_of_interval(clock: Variable) -> str:
    kind = clock.attributes.get("intervalVariability", "")
    if kind not in _INTERVALS:
        return f"intervalVariability is {kind!r}"
    has_interval = clock.attributes.keys() & {"intervalDecimal", "intervalCounter"}
    return f"it is {kind} and has no interval" if kind in ("constant", "fixed") and not has_interval else ""


def build_description(subject: CheckedFmu, fmu: Description) -> Faults:
    """Yield faults of the build description that sources of FMI 3.0 need."""
    if not any(name.startswith("sources/") for name in subject.members):
        return
    if BUILD not in subject.members:
        yield "build-description", "it is missing"
        return
    try:
        root = ET.fromstring(subject.members[BUILD])
    except (ET.ParseError, ValueError, LookupError) as error:
        yield "build-description", f"it cannot be read: {error}"
        return
    configured = {e.get("modelIdentifier") for e in root.iterfind("BuildConfiguration")}
    known = listed(sorted(filter(None, configured))) or "none"
    declared = {kind["modelIdentifier"] for kind in (fmu.co_simulation, fmu.model_exchange)
                if kind and "modelIdentifier" in kind}  # fmt: skip
    missing = sorted(declared - configured)
    yield "build-description", some(missing, "it has no BuildConfiguration for ", f"; it has one for {known}")
    if not root.get("fmiVersion", "").startswith("3."):
        yield "build-description", f"its fmiVersion is {root.get('fmiVersion')!r}"


# ==== Static rules: what an archive and its modelDescription.xml contain, without running the FMU ====================


def static_findings(subject: CheckedFmu) -> Iterator[Finding]:
    """Apply every static rule; if there is no description, apply only the rules for the archive."""
    yield from findings(entries(subject))
    if (description := subject.description) is None:
        return
    for rules in (identity, variables, units_of, structure, capabilities, exchange):
        yield from findings(rules(description))
    for rules_of_files in (binaries, contents, terminals, exchange_files):
        yield from findings(rules_of_files(subject, description))
    if description.fmi == 3:
        yield from findings(chain(version_3(description), build_description(subject, description)))
