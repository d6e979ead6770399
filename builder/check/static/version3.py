"""Rules that only FMI 3.0 has, for the description and the build description."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from builder.check.rules import Faults, listed, some
from builder.check.subject import Subject
from eightpost.fmi.description import BUILD, Description, Variable, whole_number

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


def build_description(subject: Subject, fmu: Description) -> Faults:
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
