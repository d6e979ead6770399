"""Content of modelDescription.xml: what fmpy reads of it, and the variables as components have them."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import fmpy
from fmpy.model_description import read_build_description

from cosim.components.component import UnitDefinition, Variable
from cosim.components.fmi3_variables import TYPES, Fmi3Table, Fmi3Variable
from eightpost.errors import FmuError

_C_NAME = re.compile("[A-Za-z_][A-Za-z0-9_]*")

_EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def read_description(path: Path, folder: Path) -> Any:
    """Return the content of modelDescription.xml as fmpy reads it.

    Args:
        path: FMU file (.fmu).
        folder: Folder in which it is unpacked.

    Raises:
        FmuError: It is missing or cannot be read, or the FMU is not one of FMI 2.0 or 3.0 for co-simulation.
    """
    if not (folder / "modelDescription.xml").is_file():
        raise FmuError(f"{path}: is not an FMU: there is no modelDescription.xml at its top")
    try:
        description = _read(folder)
    except Exception as error:  # fmpy passes on all exceptions of its XML reader
        raise FmuError(f"{path}: its modelDescription.xml cannot be read ({error})") from error
    version = str(description.fmiVersion)
    if not version.startswith(("2.", "3.")):
        raise FmuError(f"{path}: is an FMI {version} FMU; export it as FMI 2.0 or 3.0 for co-simulation")
    if description.coSimulation is None and description.scheduledExecution is not None:
        raise FmuError(
            f"{path}: is for scheduled execution only, which needs a scheduler; export it again for co-simulation"
        )
    if description.coSimulation is None:
        raise FmuError(
            f"{path}: is for model exchange only and contains no solver; export it again as FMI {version[0]}.0 for "
            "co-simulation (tools call it CS, or co-simulation with a solver)"
        )
    identifier = str(description.coSimulation.modelIdentifier or "")
    if not _C_NAME.fullmatch(identifier):  # it is part of the library's path
        raise FmuError(
            f"{path}: its modelIdentifier is {identifier!r}, which is not a C name (letters, digits, underscores); "
            "export the FMU again under such a name"
        )
    return description


def _read(folder: Path) -> Any:
    """Read with fmpy; for FMI 3.0 without the parts that fmpy cannot read and this program does not need."""
    try:
        root = ET.parse(folder / "modelDescription.xml").getroot()
    except ET.ParseError:
        return fmpy.read_model_description(str(folder), validate=False)  # with fmpy's message
    if not root.get("fmiVersion", "").startswith("3."):
        return fmpy.read_model_description(str(folder), validate=False)
    for name in ("TypeDefinitions", "ModelVariables", "ModelStructure"):
        for part in root.findall(name):
            part.clear()
    if root.find("ModelVariables") is None:
        raise ValueError("it has no ModelVariables")
    number, copy = tempfile.mkstemp(suffix=".xml", dir=folder)
    os.close(number)
    try:
        ET.ElementTree(root).write(copy, encoding="utf-8", xml_declaration=True)
        description = fmpy.read_model_description(copy, validate=False)
    finally:
        Path(copy).unlink()
    if description.coSimulation is not None:
        float(description.coSimulation.fixedInternalStepSize or 0.0)  # fmpy does not check that it is a number
    description.buildConfigurations = read_build_description(str(folder), validate=False)
    return description


def table_of(path: Path, folder: Path) -> Fmi3Table:
    """Return the variables of an FMI 3.0 FMU with their elements.

    Args:
        path: FMU file (.fmu).
        folder: Folder in which it is unpacked.

    Raises:
        FmuError: The description is not correct.
    """
    try:
        return Fmi3Table.read((folder / "modelDescription.xml").read_bytes())
    except ValueError as error:
        raise FmuError(f"{path}: its modelDescription.xml: {error}; export the FMU again") from error


def variables_of_table(table: Fmi3Table, description: Any) -> dict[str, Variable]:
    """Return the elements of all variables of FMI 3.0 by name.

    Raises:
        ValueError: A limit is not a number.
    """
    units = {unit.name: _unit(unit) for unit in description.unitDefinitions}
    inputs = {v.reference: v for v in table.variables if v.causality == "input"}
    owners = tuple(table.elements)
    found = {}
    for name, element in table.references.items():
        v, place = owners[element]
        found[name] = _element(name, table.variables[v], place, units, _direct(table, table.variables[v], inputs))
    return found


def _direct(table: Fmi3Table, variable: Fmi3Variable, inputs: Mapping[int, Fmi3Variable]) -> frozenset[str]:
    """Return the names of all inputs that a variable follows without delay; all inputs if nothing is stated."""
    if variable.causality != "output":
        return frozenset()
    stated = table.dependencies.get(variable.reference, tuple(inputs))
    known = [inputs[reference] for reference in stated if reference in inputs]
    return frozenset(element for v in known for name in v.names for element in v.element_names(name))


def _element(
    name: str, variable: Fmi3Variable, place: int, units: Mapping[str, UnitDefinition], direct: frozenset[str]
) -> Variable:
    unit = variable.unit
    return Variable(
        name=name,
        causality="parameter" if variable.causality == "structuralParameter" else variable.causality,
        variability=variable.variability,
        type=TYPES[variable.type],
        unit=units.get(unit, UnitDefinition(unit, {"?": 1})) if unit else None,
        start=variable.start_of(place),
        minimum=_number(name, "min", variable.minimum),
        maximum=_number(name, "max", variable.maximum),
        direct=direct,
    )


def variables_of(description: Any) -> dict[str, Variable]:
    """Return all variables of FMI 2.0 by name.

    Raises:
        ValueError: A limit is not a number.
    """
    units = {unit.name: _unit(unit) for unit in description.unitDefinitions}
    direct = {unknown.variable.name: unknown.dependencies for unknown in description.outputs}
    inputs = frozenset(v.name for v in description.modelVariables if v.causality == "input")
    return {v.name: _variable(v, units, direct, inputs) for v in description.modelVariables}


def _variable(
    v: Any, units: Mapping[str, UnitDefinition], direct: Mapping[str, Any], inputs: frozenset[str]
) -> Variable:
    declared = v.unit or (v.declaredType.unit if v.declaredType is not None else None)
    depends = direct.get(v.name)
    # If a model states no dependencies, FMI assumes that an output depends on everything.
    known = inputs if depends is None else frozenset(other.name for other in depends)
    return Variable(
        name=v.name,
        causality=v.causality or "local",
        variability=v.variability or "continuous",
        type=v.type,
        unit=units.get(declared, UnitDefinition(declared, {"?": 1})) if declared else None,
        start=v.start,
        minimum=_limit(v, "min"),
        maximum=_limit(v, "max"),
        direct=known & inputs if v.causality == "output" else frozenset(),
    )


def _limit(v: Any, name: str) -> float | None:
    """Return the attribute `min` or `max` of a variable.

    Raises:
        ValueError: The attribute is not a number.
    """
    return _number(v.name, name, getattr(v, name)) if v.type in ("Real", "Integer") else None


def _number(name: str, attribute: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name}: {attribute}={text[:40]!r} is not a number; export the FMU again") from None


def _unit(unit: Any) -> UnitDefinition:
    base = unit.baseUnit
    if base is None:
        return UnitDefinition(unit.name, {"?": 1})
    exponents = {name: getattr(base, name) for name in _EXPONENTS if getattr(base, name)}
    return UnitDefinition(unit.name, exponents, base.factor, base.offset)
