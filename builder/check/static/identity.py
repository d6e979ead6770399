"""Rules for the identity of the FMU: version, GUID, identifier, date, authorship, default experiment."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import datetime

from builder.check.catalogue import description as rules
from builder.check.description import Description
from builder.check.rules import Finding, listed

_C_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_PLAIN = re.compile(r"[A-Za-z0-9{}_-]+")
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")
_ABOUT = ("description", "author", "version", "license", "generationTool")


def version(description: Description) -> Iterator[Finding]:
    """Check that fmiVersion is 2.0."""
    stated = description.attributes.get("fmiVersion")
    if stated != "2.0":
        yield rules.VERSION.finding(f"it is {stated!r}")


def guid(description: Description) -> Iterator[Finding]:
    """Check that there is a GUID of plain characters."""
    if not description.guid.strip():
        yield rules.GUID.finding("the attribute guid is missing or empty")
    elif not _PLAIN.fullmatch(description.guid):
        yield rules.GUID_PLAIN.finding(f"it is {description.guid!r}")


def identifier(description: Description) -> Iterator[Finding]:
    """Check that co-simulation is supported and that its modelIdentifier is a C name."""
    if description.co_simulation is None:
        yield rules.CO_SIMULATION.finding("there is no element CoSimulation")
    elif not _C_NAME.fullmatch(description.identifier):
        yield rules.IDENTIFIER.finding(f"it is {description.identifier!r}")


def date(description: Description) -> Iterator[Finding]:
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


def about(description: Description) -> Iterator[Finding]:
    """Check that description, author, version, license and generationTool are present."""
    missing = [name for name in _ABOUT if not description.attributes.get(name, "").strip()]
    if missing:
        yield rules.ABOUT.finding(f"missing: {listed(missing)}")


def experiment(description: Description) -> Iterator[Finding]:
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


def categories(description: Description) -> Iterator[Finding]:
    """Check that names of log categories are unique."""
    doubled = [name for name, count in Counter(description.categories).items() if count > 1]
    if doubled:
        yield rules.CATEGORIES.finding(f"duplicate names: {listed(doubled)}")


RULES = (version, guid, identifier, date, about, experiment, categories)
