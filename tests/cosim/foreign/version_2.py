"""FMI 2.0 FMUs of other makers: a library, and a description made of rows of variables."""

import fmpy

from eightpost.archive import write_archive

#: Attributes of the base unit of each unit.
_UNITS = {
    "m": 'm="1"', "m/s": 'm="1" s="-1"', "N": 'kg="1" m="1" s="-2"', "mm": 'm="1" factor="0.001"',
    "mm/s": 'm="1" s="-1" factor="0.001"', "kN": 'kg="1" m="1" s="-2" factor="1000"',
    "deg": 'rad="1" factor="0.017453292519943295"',
}  # fmt: skip


def description(name, variables, *, guid="", attributes="", kind="CoSimulation", flags="", sources="", more=""):
    """Return modelDescription.xml.

    Each variable is a name, a value reference, a causality, a type with its attributes and, if it is an output, the
    indices of the variables that it depends on.
    """
    units = "".join(f'<Unit name="{unit}"><BaseUnit {base}/></Unit>' for unit, base in _UNITS.items())
    rows = "".join(
        f'<ScalarVariable name="{own}" valueReference="{number}" causality="{causality}"><{kept}/></ScalarVariable>'
        for own, number, causality, kept, *_ in variables
    )
    outputs = "".join(
        f'<Unknown index="{index}" dependencies="{"".join(row[4:])}"/>'
        for index, row in enumerate(variables, 1)
        if row[2].startswith("output")
    )
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{guid or f"{{{name}}}"}" {attributes}>
  <{kind} modelIdentifier="{name}" {flags}>{sources}</{kind}>
  <UnitDefinitions>{units}</UnitDefinitions>{more}
  <ModelVariables>{rows}</ModelVariables>
  <ModelStructure><Outputs>{outputs}</Outputs></ModelStructure>
</fmiModelDescription>"""
    return text.encode()


def write(path, library, name, variables, *, files=None, **declared):
    """Write the FMU, with more files by their names in it; return its path."""
    xml, binary = description(name, variables, **declared), f"binaries/{fmpy.platform}/{name}"
    write_archive(
        path, {"modelDescription.xml": xml, f"{binary}{fmpy.sharedLibraryExtension}": library, **(files or {})}
    )
    return path
