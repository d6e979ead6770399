"""Rules that only FMI 3.0 has, for the description and the build description."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

from builder.check.catalogue import version3 as rules
from builder.check.description import Description, Variable, whole_number
from builder.check.description3 import BUILD
from builder.check.rules import Finding, listed
from builder.check.subject import Subject

_INTERVALS = ("constant", "fixed", "tunable", "changing", "countdown", "triggered")


def _dimensions(description: Description) -> Iterator[Finding]:
    """Check the sizes of arrays."""
    for name, dimensions in description.dimensions.items():
        for number, dimension in enumerate(dimensions, 1):
            if fault := _fault_of_dimension(description, dimension):
                yield rules.DIMENSION.finding(f"{name}, dimension {number}: {fault}")


def _fault_of_dimension(description: Description, dimension: Mapping[str, str]) -> str:
    reference, start = dimension.get("valueReference"), dimension.get("start")
    if (reference is None) == (start is None):
        return "it has neither start nor valueReference" if start is None else "it has both start and valueReference"
    if reference is None:
        return f"its start is {start!r}" if whole_number((start or "").strip()) is None else ""
    size = description.variable(reference)
    if size is None:
        return f"its valueReference {reference!r} is not that of a variable"
    is_size = size.causality == "structuralParameter" and size.native == "UInt64"
    return "" if is_size else f"{size.name} is a {size.causality} of type {size.native}"


def _start_counts(description: Description) -> Iterator[Finding]:
    """Check the number of start values of arrays; strings have elements of their own."""
    for name, length in description.lengths.items():
        variable = description.by_name.get(name)
        if variable is None or variable.start is None or variable.type in ("String", "Binary") or length == 0:
            continue
        count = len(variable.start.split())
        if count not in (1, length):
            yield rules.START_COUNT.finding(f"{name} has {count} start values for {length} elements")


def _clocks(description: Description) -> Iterator[Finding]:
    """Check that clocks are referred to, and that they have intervals."""
    for v in description.variables:
        named = v.attributes.get("clocks", "").split()
        found = [description.variable(reference) for reference in named]
        wrong = [r for r, clock in zip(named, found, strict=True) if clock is None or clock.type != "Clock"]
        if wrong:
            yield rules.CLOCKS.finding(f"{v.name} lists {listed(wrong)}")
        if v.type == "Clock" and (fault := _fault_of_interval(v)):
            yield rules.INTERVAL.finding(f"{v.name}: {fault}")


def _fault_of_interval(clock: Variable) -> str:
    variability = clock.attributes.get("intervalVariability", "")
    if variability not in _INTERVALS:
        return f"intervalVariability is {variability!r}"
    has_interval = "intervalDecimal" in clock.attributes or "intervalCounter" in clock.attributes
    return (
        f"it is {variability} and has no interval" if variability in ("constant", "fixed") and not has_interval else ""
    )


def _clocked_states(description: Description) -> Iterator[Finding]:
    """Check that clocked states have the attributes that make them such."""
    for unknown in description.in_section("ClockedStates"):
        variable = description.variable(unknown.index)
        if variable is not None and not {"previous", "clocks"} <= variable.attributes.keys():
            missing = sorted({"previous", "clocks"} - variable.attributes.keys())
            yield rules.CLOCKED_STATE.finding(f"{variable.name} lacks {listed(missing)}")


def _aliases(description: Description) -> Iterator[Finding]:
    """Check the display units of aliases."""
    displays = {unit.name: {display.get("name") for display in unit.displays} for unit in description.units}
    for name, units in description.alias_units.items():
        own = description.by_name[name].unit if name in description.by_name else None
        wrong = sorted(unit for unit in units if unit != own and unit not in displays.get(own or "", set()))
        if wrong:
            yield rules.ALIAS_UNIT.finding(f"{name} is in {own!r}, its alias is displayed in {listed(wrong)}")


def _time(description: Description) -> Iterator[Finding]:
    """Check the type of the independent variable."""
    wrong = [
        f"{v.name} is {v.native}" for v in description.variables if v.causality == "independent" and v.type != "Real"
    ]
    if wrong:
        yield rules.TIME_TYPE.finding(listed(wrong))


def _flags(description: Description) -> Iterator[Finding]:
    """Check the flags of intermediate updates and of event mode."""
    if description.co_simulation is None:
        return
    named = [v.name for v in description.variables if v.attributes.get("intermediateUpdate") in ("true", "1")]
    offered = description.can("providesIntermediateUpdate")
    if named and not offered:
        yield rules.INTERMEDIATE_FLAG.finding(f"{listed(named)} have intermediateUpdate, but the flag is not set")
    if description.can("canReturnEarlyAfterIntermediateUpdate") and not offered:
        yield rules.EARLY_FLAG.finding("providesIntermediateUpdate is not true")
    clocks = [v.name for v in description.variables if v.type == "Clock" and v.causality == "input"]
    if clocks and not description.can("hasEventMode"):
        yield rules.EVENT_MODE.finding(f"input clocks: {listed(clocks)}")


RULES = (_dimensions, _start_counts, _clocks, _clocked_states, _aliases, _time, _flags)


def _build(subject: Subject) -> Iterator[Finding]:
    """Check that sources come with a build description."""
    description = subject.description
    if description is None or not any(name.startswith("sources/") for name in subject.members):
        return
    content = subject.members.get(BUILD)
    if content is None:
        yield rules.BUILD.finding("it is missing")
        return
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        yield rules.BUILD.finding(f"it cannot be read: {error}")
        return
    configured = {e.get("modelIdentifier") for e in root.iterfind("BuildConfiguration")}
    declared = {kind["modelIdentifier"] for kind in (description.co_simulation, description.model_exchange)
                if kind and "modelIdentifier" in kind}  # fmt: skip
    if missing := sorted(declared - configured):
        known = listed(sorted(filter(None, configured))) or "none"
        yield rules.BUILD.finding(f"it has no BuildConfiguration for {listed(missing)}; it has one for {known}")
    if not root.get("fmiVersion", "").startswith("3."):
        yield rules.BUILD.finding(f"its fmiVersion is {root.get('fmiVersion')!r}")


ARCHIVE_RULES = (_build,)
