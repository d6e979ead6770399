"""FMI 3.0 in the terms of FMI 2.0: names of functions and attributes, and the texts of findings.

The rules are written for FMI 2.0, which has most of the concepts of FMI 3.0 under other names. A description of FMI 3.0
is read in terms of FMI 2.0 (eightpost.fmi.description), and a finding is translated back.
"""

from __future__ import annotations

import re
from dataclasses import replace

from builder.check.rules import Finding
from eightpost.fmi.functions import FLAGS, function_name

_WORDS = {
    **{re.escape(old): new for new, old in FLAGS.items() if new != "providesDirectionalDerivatives"},
    r"providesDirectionalDerivative\b": "providesDirectionalDerivatives",
    r"ModelStructure/(Outputs|Derivatives)": "ModelStructure",
    r"\bOutputs\b(?! (depend|are|before|cannot))": "Output",
    r"\bDerivatives\b(?! (are|follow|depend))": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
    "fmiVersion is 2.0": "fmiVersion is 3.0",
    'fmiVersion="2.0", also for 2.0.1 to 2.0.4': 'fmiVersion="3.0", also for 3.0.1 and 3.0.2',
    "attribute guid": "attribute instantiationToken",
    "a GUID": "an instantiationToken",
    "GUID": "instantiationToken",
    "SourceFiles of ModelExchange": "buildDescription.xml",
    "SourceFiles": "buildDescription.xml",
    "[Ii]nput derivatives": "intermediate updates of inputs",
    "model.png": "terminalsAndIcons/icon.png",
    "win32, win64, linux32, linux64, darwin64": "x86_64-linux, x86_64-windows, x86_64-darwin, aarch64-linux and so on",
    "indices of variables": "value references of variables",
    "use indices that count from 1 in the order of ModelVariables": "use value references",
    "Inputs and time have no attribute initial": "Time has no attribute initial",
    "At most one variable is independent": "Exactly one variable is independent",
    "keep one$": "declare one variable as time",
    "Variables with the same value reference .*": "Each variable has its own value reference",
    "list each index once": "list each value reference once",
    "Only Real variables": "Only Float32 and Float64 variables",
    r"\bReals\b": "Float64 variables",
    r"\bReal\b": "Float64",
    "see the tables of section 2.2.7": "see the tables of section 2.4.7",
}
_TRANSLATIONS = tuple((re.compile(old), new) for old, new in _WORDS.items())

_SOURCES = {"FMI 2.2": "FMI 3.0 2.4", "FMI 2.3": "FMI 3.0 2.5", "FMI 2.1": "FMI 3.0 2.3", "FMI 4": "FMI 3.0 4"}


def text_in_version_3(text: str) -> str:
    """Return a text about an FMU with the names of FMI 3.0."""
    text = re.sub(r"fmi2(\w+)", lambda found: f"fmi3{function_name(found[1])}", text)
    for pattern, new in _TRANSLATIONS:
        text = pattern.sub(new, text)
    return text


def finding_in_version_3(finding: Finding) -> Finding:
    """Return a finding about an FMU of FMI 3.0 with its names, and with the section of that standard."""
    rule = finding.rule
    told = replace(
        rule,
        title=text_in_version_3(rule.title),
        source=_source(rule.source),
        advice=text_in_version_3(rule.advice),
    )
    return Finding(told, text_in_version_3(finding.message))


def _source(source: str) -> str:
    if "FMI 3.0" in source:
        return source[source.index("FMI 3.0") :]
    if re.match(r"FMI 3(\.|$)", source):
        return "FMI 3.0 3"
    return next((new for old, new in _SOURCES.items() if source.startswith(old)), source)
