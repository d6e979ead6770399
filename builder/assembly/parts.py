"""Parts of an assembled FMU, read from their own FMUs."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from builder.interface import Interface, Variable, own_value, shock_kinds, source_files
from builder.native_fmu import model_files
from builder.product import BEYOND_SETTINGS
from builder.tables import interface_header, layout, settings_data
from eightpost import __version__, fmi
from eightpost.archive import read_archive
from eightpost.errors import FmuError
from eightpost.files import MALFORMED
from eightpost.fmi import Description, read_description
from eightpost.shock import LAWS, Axis, Port, Settings, ShockLaw, StaticCurve, Term, own_parameters
from eightpost.shock.curve import KNOTS
from eightpost.shock.settings import LAGGED_SLOPE, TEMPERATURE
from eightpost.validity import MEMBER

# ==== The law and the settings of a shock, read from the contents of its FMU =========================================


def law_of(kind: str, values: Mapping[str, float | bool]) -> ShockLaw:
    """Return a shock's law for the values of its variables.

    Args:
        kind: Kind of the interface, such as `shock_lpf1`.
        values: Values by name, as in the FMU of the shock.
    """
    numbers = {name: float(value) for name, value in values.items()}
    law = LAWS[kind.removeprefix("shock_")]
    lists: dict[str, tuple[float, ...]] = {}
    for name, value in numbers.items():
        if found := re.fullmatch(r"curve\.(\w+)\[\d+\]", name):
            lists[found[1]] = (*lists.get(found[1], ()), value)
    scalars = {name.removeprefix("curve."): value for name, value in numbers.items() if name.startswith("curve.")}
    curve = {f.name: lists.get(f.name, scalars.get(f.name)) for f in dataclasses.fields(StaticCurve)}
    port = Port(**{f.name: numbers[f.name] for f in dataclasses.fields(Port)})
    own = {name: own_value(law, name, numbers) for name in own_parameters(law)}
    return law(curve=StaticCurve(**curve), port=port, **own)  # type: ignore[arg-type]


def _settings_of(data: str, interface: Interface) -> Settings:
    """Return the settings in a settings_data.h; texts that no calculation needs are empty, bands are zero."""
    tables: dict[str, str] = dict(re.findall(r"(\w+)(?:\[\w+\])+ = (\{.*?\});", data, flags=re.DOTALL))
    counts = [int(count) for count in re.findall(r"\d+", tables["node_counts"])]
    axes = tuple(_axes(data, _rows(tables["axis_nodes"]), counts, interface))
    deviations = _rows(tables["deviations"])
    terms = []
    for places, rows, first in re.findall(r"\{\d+, \{([^}]*)\}, (\d+), (\d+)\}", tables["terms"]):
        names = tuple(axes[int(place)].name for place in places.split(","))
        terms.append(Term(names, deviations[int(first) : int(first) + int(rows)]))
    tested = _rows(tables["tested"])
    return Settings(axes, _parameters(data), tuple(terms), tested, ((0.0,) * KNOTS,) * len(tested))


def _axes(data: str, nodes: Sequence[tuple[float, ...]], counts: Sequence[int], interface: Interface) -> list[Axis]:
    starts = {v.name.replace(".", "_"): v for v in interface.variables}
    members = re.findall(r"setting\[\d+\] = v->named\.\w+\.(\w+);", data)
    axes = []
    for member, row, count in zip(members, nodes, counts, strict=True):
        variable = starts[member]
        name = variable.name.removeprefix("clicks.")
        unit = "K" if name == TEMPERATURE else "click"
        axes.append(Axis(name, row[:count], float(variable.start or 0.0), unit))
    return axes


def _parameters(data: str) -> tuple[str, ...]:
    factors = dict.fromkeys(re.findall(r"now->(\w+)(?:\[\d+\])? \*= exponential", data))
    lagged = "curve_lagged_slope[k] + changes[k]" in data
    return (*([LAGGED_SLOPE] if lagged else []), *factors)


def _rows(table: str) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(cell) for cell in row.split(",")) for row in re.findall(r"\{([^{}]+)\}", table))


# ---- Reading of an interface from the modelDescription.xml of an FMU ------------------------------------------------


def _described_interface(root: ET.Element) -> Interface | None:
    """Return the interface of an FMU of eightpost; None for any other FMU."""
    annotation = root.find("VendorAnnotations/Tool[@name='eightpost']/Interface")
    if annotation is None:
        return None
    fmu = read_description(root)
    return Interface(
        kind=annotation.get("name", ""),
        version=annotation.get("version", ""),
        description=root.get("description", ""),
        variables=tuple(_variable(variable, fmu) for variable in fmu.variables),
        direct=_dependencies(fmu, "Outputs") | _dependencies(fmu, "Derivatives"),
        initial=_dependencies(fmu, "InitialUnknowns"),
    )


def _variable(variable: fmi.Variable, fmu: Description) -> Variable:
    written = variable.attributes
    start, of, *limits = (written.get(name) for name in ("start", "derivative", "min", "max", "nominal"))
    minimum, maximum, nominal = (None if text is None else float(text) for text in limits)
    is_boolean = variable.type == "Boolean"
    return Variable(
        name=variable.name,
        reference=int(variable.reference),
        type=variable.type,
        causality=variable.causality,
        variability=variable.variability,
        unit=variable.unit,
        display=written.get("displayUnit"),
        start=None if start is None else start in ("true", "1") if is_boolean else float(start),
        minimum=minimum,
        maximum=maximum,
        description=variable.description,
        derivative_of=None if of is None else _existing(fmu, of),
        nominal=nominal,
    )


def _existing(fmu: Description, index: str) -> str:
    variable = fmu.variable(index)
    if variable is None:
        raise ValueError(f"{index!r} is not the index of a variable")
    return variable.name


def _dependencies(fmu: Description, section: str) -> dict[str, tuple[str, ...]]:
    return {
        _existing(fmu, unknown.index): tuple(_existing(fmu, index) for index in unknown.dependencies or ())
        for unknown in fmu.in_section(section)
    }


# ---- A part of an assembly ------------------------------------------------------------------------------------------

VEHICLE = "vehicle_ss"

#: Files of fmus/common that a model's compilation unit includes.
_BENEATH = ("component.h", "elementary.c", "elementary.h", "fresh.h", "message.h", "names.h")

_NOT_ASSEMBLED = "run it with the other FMUs instead (eightpost run); it cannot be assembled into one FMU"


@dataclass(frozen=True)
class Part:
    """One component of an assembly."""

    name: str  #: Name of the component.
    file: str  #: The FMU's file name.
    text: str  #: Description of the FMU.
    guid: str  #: GUID of the FMU.
    interface: Interface  #: Variables of the FMU with their start values.
    states: int  #: Number of values that its model keeps from step to step.
    #: Content of vehicle_data.h for a vehicle, or of settings_data.h for a shock with settings; empty for any other
    #: shock, whose values are all parameters.
    data: str
    validity: bytes | None = None  #: Validity that the FMU states for its model; None if it states none.
    settings: Settings | None = None  #: Settings of a shock; None if it has none.

    @property
    def unit(self) -> str:
        """Name of the part's compilation unit: its kind, and for a shock with settings the digest of their tables.

        Parts with the same unit have the same code and constants.
        """
        if self.settings is None:
            return self.kind
        header = interface_header(layout(self.interface, self.states), self.kind, "")
        return f"{self.kind}_{hashlib.sha256((header + self.data).encode()).hexdigest()[:8]}"

    @property
    def kind(self) -> str:
        """Kind of the interface, and so of the model."""
        return self.interface.kind

    @property
    def is_vehicle(self) -> bool:
        """Whether it is the vehicle."""
        return self.kind == VEHICLE


class _CannotBeError(Exception):
    """The reason why an FMU cannot be a part, and what to do."""


def read_parts(files: Mapping[str, Path]) -> tuple[Part, ...]:
    """Return the parts for FMU files by component name.

    Raises:
        FmuError: At least one FMU cannot be a part; the message lists all of them, with what to do.
    """
    parts, refused = [], []
    for name, file in files.items():
        try:
            parts.append(_part(name, file, read_archive(file)))
        except _CannotBeError as reason:
            refused.append(f"{name} ({file}) {reason}")
        except (ET.ParseError, *MALFORMED) as error:
            if isinstance(error, FmuError):
                raise
            refused.append(f"{name} ({file}) cannot be read ({error}); build or copy it again")
    if refused:
        raise FmuError("; ".join(refused))
    return tuple(parts)


def _part(name: str, file: Path, members: Mapping[str, bytes]) -> Part:
    root = ET.fromstring(members["modelDescription.xml"])
    if root.get("fmiVersion", "").startswith("3."):
        raise _CannotBeError(
            "is of FMI 3.0; assemble FMUs of FMI 2.0 (eightpost build), with --fmi 3 for an assembly of FMI 3.0"
        )
    interface = _described_interface(root)
    if interface is None:
        raise _CannotBeError(f"is not an FMU of eightpost, so its equations are not known; {_NOT_ASSEMBLED}")
    if interface.kind not in (VEHICLE, *shock_kinds()):
        raise _CannotBeError(f"is of the kind {interface.kind!r}, which cannot be a part; {_NOT_ASSEMBLED}")
    _refuse_closed(root, members)
    header = members["sources/interface.h"].decode()
    states = int(_found(r"\bSTATES = (\d+)", header))
    _refuse_other_version(root, interface, members, states)
    return Part(
        name=name,
        file=file.name,
        text=root.get("description", ""),
        guid=root.get("guid", ""),
        interface=interface,
        states=states,
        data=(members.get("sources/vehicle_data.h") or members.get("sources/settings_data.h") or b"").decode(),
        validity=members.get(MEMBER),
        settings=_settings(members, interface, root),
    )


def _settings(members: Mapping[str, bytes], interface: Interface, root: ET.Element) -> Settings | None:
    """Return the settings of a shock; an error if this version would write their tables differently."""
    if BEYOND_SETTINGS not in interface.names("local"):
        return None
    data = members.get("sources/settings_data.h", b"").decode()
    try:
        settings = _settings_of(data, interface)
        law = law_of(interface.kind, {v.name: v.start for v in interface.variables if v.start is not None})
        if settings_data(settings, law, interface) == data:
            return settings
    except MALFORMED:  # as another version may have written it
        pass
    raise _CannotBeError(_other_version(root))


def _refuse_closed(root: ET.Element, members: Mapping[str, bytes]) -> None:
    kind = root.find("CoSimulation")
    if kind is None or kind.get("needsExecutionTool") == "true":
        raise _CannotBeError("is a python FMU; build it as a native FMU (eightpost build --target native)")
    if "sources/model.c" not in members or "sources/interface.h" not in members:
        raise _CannotBeError(
            "is confidential: it contains neither sources nor curve; ask its supplier for an assembly or an open build"
        )


def _refuse_other_version(root: ET.Element, interface: Interface, members: Mapping[str, bytes], states: int) -> None:
    """Raise an error if the sources are from another version: they are compiled together with those of this version."""
    header = interface_header(
        layout(interface, states), str(root.get("modelName")), str(root.get("guid")).strip("{}")
    ).encode()
    beneath = {name: text for name, text in source_files("common").items() if name in _BENEATH}
    files = {"interface.h": header, **beneath, **model_files(interface.kind)}
    if any(members.get(f"sources/{name}") != content for name, content in files.items()):
        raise _CannotBeError(_other_version(root))


def _other_version(root: ET.Element) -> str:
    return (
        f"contains a different model than eightpost {__version__} builds (it was built by "
        f"{root.get('generationTool')}); build it again"
    )


def _found(pattern: str, text: str) -> str:
    match = re.search(pattern, text)
    if match is None:
        raise _CannotBeError(f"was built by another version than eightpost {__version__}; build it again")
    return match[1]
