"""Content of modelDescription.xml for co-simulation: numbers in place of texts, elements in place of arrays."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import inf, prod
from pathlib import Path
from xml.etree import ElementTree as ET

from cosim.components import component
from cosim.components.component import EXPONENTS, UnitDefinition
from eightpost import fmi
from eightpost.errors import FmuError
from eightpost.fmi import BUILD, Description, whole_number

_C_NAME = re.compile("[A-Za-z_][A-Za-z0-9_]*")

#: Largest number of elements of one array: a larger one is a faulty description.
_MOST = 1_000_000


def read_description(path: Path, folder: Path) -> Description:
    """Return the content of modelDescription.xml.

    Args:
        path: FMU file (.fmu).
        folder: Folder in which it is unpacked.

    Raises:
        FmuError: It is missing or cannot be read, or the FMU is not one of FMI 2.0 or 3.0 for co-simulation.
    """
    if not (folder / "modelDescription.xml").is_file():
        raise FmuError(f"{path}: is not an FMU: there is no modelDescription.xml at its top")
    try:
        build = ET.parse(folder / BUILD).getroot() if (folder / BUILD).is_file() else None
        description = fmi.read_description(ET.parse(folder / "modelDescription.xml").getroot(), build)
        _check_numbers(description)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise FmuError(f"{path}: its modelDescription.xml cannot be read ({error})") from error
    version = description.attributes.get("fmiVersion", "(version not stated)")
    if not version.startswith(("2.", "3.")):
        raise FmuError(f"{path}: is an FMI {version} FMU; export it as FMI 2.0 or 3.0 for co-simulation")
    if description.co_simulation is None and description.is_scheduled:
        raise FmuError(
            f"{path}: is for scheduled execution only, which needs a scheduler; export it again for co-simulation"
        )
    if description.co_simulation is None:
        raise FmuError(
            f"{path}: is for model exchange only and contains no solver; export it again as FMI {version[0]}.0 for "
            "co-simulation (tools call it CS, or co-simulation with a solver)"
        )
    if not _C_NAME.fullmatch(description.identifier):  # it is part of the library's path
        raise FmuError(
            f"{path}: its modelIdentifier is {description.identifier!r}, which is not a C name (letters, digits, "
            "underscores); export the FMU again under such a name"
        )
    return description


def only_step(description: Description) -> float | None:
    """Return the size of the steps that an FMU for one step size states [s]; None if it states none.

    Raises:
        ValueError: It is not a number.
    """
    stated = (description.experiment or {}).get("stepSize") or internal_step(description)
    step = float(stated)
    return step if 0.0 < step < inf else None


def internal_step(description: Description) -> float:
    """Return the internal step that an FMI 3.0 FMU declares [s]; 0 if it declares none."""
    return float((description.co_simulation or {}).get("fixedInternalStepSize", "0") or 0.0)


def _check_numbers(description: Description) -> None:
    """Raise a ValueError if a text that must be a number or refer to a variable does not."""
    only_step(description)
    units_of(description)
    if description.fmi == 2:
        for variable in description.variables:
            _reference(variable)
        for unknown in description.in_section("Outputs"):
            for index in (unknown.index, *(unknown.dependencies or ())):
                if description.variable(index) is None:
                    raise ValueError(f"Outputs: {index!r} is not the index of a variable")


# ---- Variables and their elements -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Row:
    """Variable of an FMU: a scalar, or an array of FMI 3.0."""

    written: fmi.Variable  #: Variable as the description states it.
    names: tuple[str, ...]  #: Name of the variable, and its further names (aliases).
    reference: int  #: Value reference.
    #: Sizes of the dimensions of an array, for the start values of structural parameters; empty for a scalar.
    shape: tuple[int, ...]
    start: tuple[str, ...]  #: Start value of each element, as it is written; empty if the description states none.

    @property
    def type(self) -> str:
        """FMI 3.0 type, e.g. Float64; type of FMI 2.0 in FMI 2.0."""
        return self.written.native or self.written.type

    @property
    def is_real(self) -> bool:
        """Whether its values are real numbers."""
        return self.written.type == "Real"

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def during_steps(self) -> bool:
        """Whether it can be set within a step (intermediateUpdate)."""
        return self.written.attributes.get("intermediateUpdate") in ("true", "1")

    def element_names(self, name: str) -> list[str]:
        """Return the names of its elements, for one of its names: `name[2,1]`, or the name itself for a scalar."""
        if not self.shape:
            return [name]
        return [f"{name}[{','.join(map(str, at))}]" for at in product(*(range(1, n + 1) for n in self.shape))]

    def start_of(self, place: int) -> str | None:
        """Return the start value of an element, as it is written; None if the description states none."""
        return self.start[place] if self.start else None


@dataclass(frozen=True)
class Rows:
    """Variables of an FMU, and their elements in one row; elements of FMI 3.0 are addressed by their numbers."""

    rows: tuple[Row, ...]  #: Variables in the order of the description.
    are_numbered: bool  #: Whether elements are addressed by their numbers, not by value references.

    @classmethod
    def of(cls, description: Description) -> Rows:
        """Return the variables of a description; clocks, and variables without a type, are left out.

        Raises:
            ValueError: The description is not correct.
        """
        written = [variable for variable in description.variables if variable.type not in ("", "Clock")]
        if description.fmi == 2:
            starts = [() if v.start is None else (v.start,) for v in written]
            rows = tuple(Row(v, (v.name,), _reference(v), (), s) for v, s in zip(written, starts, strict=True))
            return cls(rows, are_numbered=False)
        sizes: dict[int | None, str | None] = {_reference(variable): variable.start for variable in written}
        rows = tuple(_row(variable, sizes) for variable in written)
        names = Counter(name for row in rows for name in row.names)
        if twice := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"two variables have the name {twice[0]!r}")
        return cls(rows, are_numbered=True)

    @cached_property
    def elements(self) -> tuple[tuple[int, int], ...]:
        """Variable and place in it of each element."""
        return tuple((k, place) for k, row in enumerate(self.rows) for place in range(row.size))

    @cached_property
    def by_name(self) -> Mapping[str, int]:
        """Numbers of elements by name, the names of the variables first and all aliases after them."""
        begins, total = [], 0
        for row in self.rows:
            begins.append(total)
            total += row.size
        known = list(zip(self.rows, begins, strict=True))
        firsts = [(row.names[0], row, begin) for row, begin in known]
        aliases = [(name, row, begin) for row, begin in known for name in row.names[1:]]
        return {name: begin + k for n, row, begin in firsts + aliases for k, name in enumerate(row.element_names(n))}

    @cached_property
    def references(self) -> Mapping[str, int]:
        """Addresses of elements by name: their numbers in FMI 3.0, value references in FMI 2.0."""
        return self.by_name if self.are_numbered else {row.names[0]: row.reference for row in self.rows}

    @property
    def ramped(self) -> tuple[Row, ...]:
        """Inputs that can follow a line within a step."""
        return tuple(row for row in self._continuous_inputs if row.during_steps)

    @property
    def ramps_all(self) -> bool:
        """Whether all continuous inputs can follow a line within a step."""
        return bool(self._continuous_inputs) and all(row.during_steps for row in self._continuous_inputs)

    @property
    def derives_all(self) -> bool:
        """Whether all real inputs and outputs are scalars of doubles, as the loop needs it for derivatives."""
        ports = (row for row in self.rows if row.is_real and row.written.causality in ("input", "output"))
        return all(row.type == "Float64" and not row.shape for row in ports)

    @property
    def _continuous_inputs(self) -> tuple[Row, ...]:
        return tuple(row for row in self.rows if row.written.causality == "input" and row.written.is_continuous_real)

    def variables(self, description: Description) -> dict[str, component.Variable]:
        """Return the elements of all variables by name.

        Raises:
            ValueError: A limit is not a number.
        """
        units, direct = units_of(description), dict(self._direct(description))
        elements_by_name = {}
        for name, number in self.by_name.items():
            k, place = self.elements[number]
            written, unit = self.rows[k].written, self.rows[k].written.unit
            is_enumeration, declared = written.type == "Enumeration", written.attributes.get("declaredType", "")
            items = description.items.get(declared, {}) if is_enumeration else {}
            elements_by_name[name] = component.Variable(
                name=name,
                causality="parameter" if written.causality == "structuralParameter" else written.causality,
                variability=written.variability,
                type=written.type,
                unit=units.get(unit, UnitDefinition(unit, {"?": 1})) if unit else None,
                start=self.rows[k].start_of(place),
                minimum=_limit(name, "min", written),
                maximum=_limit(name, "max", written),
                direct=direct.get(k, frozenset()),
                items={item: int(value) for item, value in items.items()},
            )
        return elements_by_name

    def _direct(self, description: Description) -> Iterator[tuple[int, frozenset[str]]]:
        """Yield the position of each output with the names of inputs that it follows without delay.

        If a model states no dependencies, FMI assumes that an output depends on everything.
        """
        inputs = {row.written.index: row for row in self.rows if row.written.causality == "input"}
        stated = {unknown.index.strip(): unknown.dependencies for unknown in description.in_section("Outputs")}
        for k, row in enumerate(self.rows):
            if row.written.causality == "output":
                depends = stated.get(str(row.written.index))
                sources = inputs.values() if depends is None else _known(depends, inputs)
                yield k, frozenset(name for v in sources for alias in v.names for name in v.element_names(alias))


def _known(dependencies: Sequence[str], inputs: Mapping[int, Row]) -> list[Row]:
    numbers = [number for text in dependencies if (number := whole_number(text)) is not None]
    if len(numbers) < len(dependencies):
        raise ValueError(f"dependencies={' '.join(dependencies)!r} are not value references")
    return [inputs[number] for number in numbers if number in inputs]


def _row(variable: fmi.Variable, sizes: Mapping[int | None, str | None]) -> Row:
    name = variable.name
    if not name:
        raise ValueError(f"a {variable.native} variable has no name")
    shape = tuple(_length(dimension, sizes, name) for dimension in variable.dimensions)
    if prod(shape) > _MOST:
        raise ValueError(f"{name}: has {prod(shape)} elements; at most {_MOST} are supported")
    names = (name, *(alias.get("name", "") for alias in variable.aliases))
    return Row(variable, names, _reference(variable), shape, _start(variable, prod(shape)))


def _length(dimension: Mapping[str, str], sizes: Mapping[int | None, str | None], name: str) -> int:
    """Return the length of an array along a dimension: a number, or the start value of a structural parameter."""
    text = dimension.get("start", sizes.get(whole_number(dimension.get("valueReference", "").strip())))
    if text is None or whole_number(text.strip()) is None:
        raise ValueError(f"{name}: a dimension has neither a start value nor a structural parameter with one")
    return int(text)


def _start(variable: fmi.Variable, size: int) -> tuple[str, ...]:
    if variable.type in ("String", "Binary"):
        texts: Sequence[str] = variable.starts
        if not texts and variable.start is not None:
            raise ValueError(
                f"{variable.name}: start={variable.start[:40]!r} is an attribute, but a {variable.type} of FMI 3.0 "
                "states its start value in a Start element"
            )
    else:
        texts = (variable.start or "").split()
        if faulty := [text for text in texts if not _is_number(text, variable.type)]:
            raise ValueError(f"{variable.name}: start={faulty[0][:40]!r} is not a number")
    if len(texts) == 1:
        return tuple(texts) * size
    if texts and len(texts) != size:
        raise ValueError(f"{variable.name}: has {len(texts)} start values for {size} elements")
    return tuple(texts)


def _is_number(text: str, kind: str) -> bool:
    if kind == "Boolean":
        return text in ("true", "false", "1", "0")
    try:
        (float if kind == "Real" else int)(text)
    except ValueError:
        return False
    return True


def _reference(variable: fmi.Variable) -> int:
    number = whole_number(variable.reference.strip())
    if number is None or not number < 1 << 32:
        name = variable.name or variable.native
        raise ValueError(f"{name}: valueReference={variable.reference!r} is not a value reference")
    return number


def _limit(name: str, attribute: str, variable: fmi.Variable) -> float | None:
    text = variable.attributes.get(attribute)
    try:
        return None if text is None else float(text)
    except ValueError:
        raise ValueError(f"{name}: {attribute}={str(text)[:40]!r} is not a number; export the FMU again") from None


def units_of(description: Description) -> dict[str, UnitDefinition]:
    """Return the units that a description defines, by name.

    Raises:
        ValueError: An exponent, a factor or an offset is not a number.
    """
    units = {}
    for unit in description.units:
        base = {"?": "1"} if unit.base is None else unit.base
        powers = {name: power for name in (*EXPONENTS, "?") if (power := int(base.get(name, "0")))}
        factor, offset = float(base.get("factor", "1")), float(base.get("offset", "0"))
        units[unit.name] = UnitDefinition(unit.name, powers, factor, offset)
    return units
