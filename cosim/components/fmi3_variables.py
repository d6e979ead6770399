"""Variables of an FMI 3.0 FMU: arrays as elements with a name each, aliases, and what outputs depend on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from xml.etree import ElementTree as ET

_INTEGERS = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
#: Types as the rest of the co-simulation names them, by FMI 3.0 type. Clocks are not variables for it.
TYPES: Mapping[str, str] = {
    "Float64": "Real",
    "Float32": "Real",
    **dict.fromkeys(_INTEGERS, "Integer"),
    "Enumeration": "Enumeration",
    "Boolean": "Boolean",
    "String": "String",
    "Binary": "Binary",
}
_FIXED = ("parameter", "calculatedParameter", "structuralParameter")
#: Largest number of elements of one array: a larger one is a faulty description.
_MOST = 1_000_000


@dataclass(frozen=True, slots=True)
class Fmi3Variable:
    """Variable of an FMI 3.0 FMU: a scalar or an array."""

    names: tuple[str, ...]  #: Name of the variable, and its further names (aliases).
    type: str  #: FMI 3.0 type, e.g. Float64.
    reference: int  #: Value reference.
    causality: str  #: input, output, parameter, structuralParameter ...
    variability: str  #: continuous, discrete, tunable, fixed ...
    #: Sizes of the dimensions of an array, for the start values of structural parameters; empty for a scalar.
    shape: tuple[int, ...]
    start: tuple[str, ...]  #: Start value of each element, as it is written; empty if the description states none.
    unit: str | None  #: Name of the unit; None if the description states none.
    minimum: str | None  #: Minimum value, as it is written.
    maximum: str | None  #: Maximum value, as it is written.
    during_steps: bool  #: Whether it can be set within a step (intermediateUpdate).

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def is_real(self) -> bool:
        """Whether its values are real numbers."""
        return TYPES[self.type] == "Real"

    def element_names(self, name: str) -> list[str]:
        """Return the names of its elements, for one of its names: `name[2,1]`, or the name itself for a scalar."""
        if not self.shape:
            return [name]
        return [f"{name}[{','.join(map(str, at))}]" for at in product(*(range(1, n + 1) for n in self.shape))]

    def start_of(self, place: int) -> str | None:
        """Return the start value of an element, as it is written; None if the description states none."""
        return self.start[place] if self.start else None


@dataclass(frozen=True)
class Fmi3Table:
    """Variables of an FMU, and their elements in one row; an element's number is its value reference for FMI 2.0."""

    variables: tuple[Fmi3Variable, ...]  #: Variables in the order of the description.
    #: Value references of the variables on which an output depends without delay, by the output's; an output without an
    #: entry depends on all inputs.
    dependencies: Mapping[int, tuple[int, ...]]
    has_derivatives: bool = False  #: Whether the FMU gives directional derivatives.

    @classmethod
    def read(cls, content: bytes | str) -> Fmi3Table:
        """Read the variables from the content of modelDescription.xml.

        Raises:
            ValueError: The description is not correct.
        """
        try:
            root = ET.fromstring(content)
        except ET.ParseError as error:
            raise ValueError(f"is not XML: {error}") from error
        rows = [row for row in root.iterfind("ModelVariables/*") if row.tag in TYPES]
        units = {row.get("name"): row.get("unit") for row in root.iterfind("TypeDefinitions/*")}
        sizes = {_whole(row, "valueReference"): row.get("start") for row in rows}
        variables = tuple(_variable(row, sizes, units) for row in rows)
        names = Counter(name for variable in variables for name in variable.names)
        if twice := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"two variables have the name {twice[0]!r}")
        outputs = [row for row in root.iterfind("ModelStructure/Output") if "dependencies" in row.attrib]
        dependencies = {_whole(row, "valueReference"): _references(row) for row in outputs}
        flag = root.find("CoSimulation[@providesDirectionalDerivatives]")
        given = flag is not None and flag.get("providesDirectionalDerivatives") in ("true", "1")
        return cls(variables, dependencies, given)

    @cached_property
    def begins(self) -> tuple[int, ...]:
        """Number of the first element of each variable."""
        found, total = [], 0
        for variable in self.variables:
            found.append(total)
            total += variable.size
        return tuple(found)

    @property
    def elements(self) -> Iterator[tuple[int, int]]:
        """Variable and place in it of each element."""
        return ((k, place) for k, variable in enumerate(self.variables) for place in range(variable.size))

    @cached_property
    def references(self) -> Mapping[str, int]:
        """Numbers of elements by name, the names of the variables first and all aliases after them."""
        rows = list(zip(self.variables, self.begins, strict=True))
        firsts = [(v.names[0], v, begin) for v, begin in rows]
        aliases = [(name, v, begin) for v, begin in rows for name in v.names[1:]]
        return {name: begin + k for n, v, begin in firsts + aliases for k, name in enumerate(v.element_names(n))}

    @property
    def ramped(self) -> tuple[Fmi3Variable, ...]:
        """Inputs that can follow a line within a step."""
        return tuple(v for v in self._continuous_inputs if v.during_steps)

    @property
    def ramps_all(self) -> bool:
        """Whether all continuous inputs can follow a line within a step."""
        return bool(self._continuous_inputs) and all(v.during_steps for v in self._continuous_inputs)

    @property
    def derives_all(self) -> bool:
        """Whether the FMU gives directional derivatives, and all real inputs and outputs are scalars of doubles."""
        ports = (v for v in self.variables if v.is_real and v.causality in ("input", "output"))
        return self.has_derivatives and all(v.type == "Float64" and not v.shape for v in ports)

    @property
    def _continuous_inputs(self) -> tuple[Fmi3Variable, ...]:
        return tuple(
            v for v in self.variables if v.causality == "input" and v.is_real and v.variability == "continuous"
        )


def _variable(row: ET.Element, sizes: Mapping[int, str | None], units: Mapping[str | None, str | None]) -> Fmi3Variable:
    name, causality = row.get("name"), row.get("causality", "local")
    if not name:
        raise ValueError(f"a {row.tag} variable has no name")
    shape = tuple(_length(dimension, sizes, name) for dimension in row.iterfind("Dimension"))
    if prod(shape) > _MOST:
        raise ValueError(f"{name}: has {prod(shape)} elements; at most {_MOST} are supported")
    usual = "continuous" if TYPES[row.tag] == "Real" else "discrete"
    return Fmi3Variable(
        names=(name, *(alias.get("name", "") for alias in row.iterfind("Alias"))),
        type=row.tag,
        reference=_whole(row, "valueReference"),
        causality=causality,
        variability=row.get("variability") or ("fixed" if causality in _FIXED else usual),
        shape=shape,
        start=_start(row, prod(shape), name),
        unit=row.get("unit") or units.get(row.get("declaredType")),
        minimum=row.get("min"),
        maximum=row.get("max"),
        during_steps=row.get("intermediateUpdate") in ("true", "1"),
    )


def _length(dimension: ET.Element, sizes: Mapping[int, str | None], name: str) -> int:
    """Return the length of an array along a dimension: a number, or the start value of a structural parameter."""
    text = dimension.get("start")
    if text is None:
        text = sizes.get(_whole(dimension, "valueReference"))
    if text is None or not text.strip().isdecimal():
        raise ValueError(f"{name}: a dimension has neither a start value nor a structural parameter with one")
    return int(text)


def _start(row: ET.Element, size: int, name: str) -> tuple[str, ...]:
    if row.tag in ("String", "Binary"):
        found: Sequence[str] = [start.get("value", "") for start in row.iterfind("Start")]
    else:
        found = row.get("start", "").split()
        if faulty := [text for text in found if not _is_number(text, row.tag)]:
            raise ValueError(f"{name}: start={faulty[0][:40]!r} is not a number")
    if len(found) == 1:
        return tuple(found) * size
    if found and len(found) != size:
        raise ValueError(f"{name}: has {len(found)} start values for {size} elements")
    return tuple(found)


def _is_number(text: str, kind: str) -> bool:
    if kind == "Boolean":
        return text in ("true", "false", "1", "0")
    try:
        (float if TYPES[kind] == "Real" else int)(text)
    except ValueError:
        return False
    return True


def _references(row: ET.Element) -> tuple[int, ...]:
    try:
        return tuple(map(int, row.get("dependencies", "").split()))
    except ValueError:
        raise ValueError(f"dependencies={row.get('dependencies')!r} are not value references") from None


def _whole(row: ET.Element, attribute: str) -> int:
    """Return an attribute that is a value reference.

    Raises:
        ValueError: It is missing, or is not a value reference.
    """
    text = row.get(attribute, "")
    if not text.strip().isdecimal() or not int(text) < 1 << 32:
        raise ValueError(f"{row.get('name', row.tag)}: {attribute}={text!r} is not a value reference")
    return int(text)
