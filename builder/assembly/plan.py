"""Plan of an assembled FMU: its parts, read from their own FMUs, their connections, its variables."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from builder.interface import (
    RATES,
    Interface,
    Variable,
    own_value,
    read_table,
    shock_kinds,
    source_files,
    spring_ports,
    variable_of,
)
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
from eightpost.wiring import Wire, Wiring


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
    found = re.search(r"\bSTATES = (\d+)", header)
    if found is None:
        raise _CannotBeError(f"was built by another version than eightpost {__version__}; build it again")
    states = int(found[1])
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


# ---- The plan of an assembly ----------------------------------------------------------------------------------------

_RUN = "run it as separate FMUs (eightpost run)"


@dataclass(frozen=True)
class Assembly:
    """One FMU to build from a vehicle and its shocks.

    Raises:
        FmuError: The parts cannot be assembled; the message lists each reason.
    """

    identifier: str  #: C name of the FMU.
    text: str  #: One-line description.
    parts: tuple[Part, ...]  #: Vehicle and shocks; the vehicle is moved to the front.
    links: tuple[Wire, ...]  #: Connections between vehicle and shocks.
    #: Connected inputs to which the host's values are added, as `component.variable`.
    sums: frozenset[str] = frozenset()
    #: Start values of inputs and parameters that replace those of the parts, as `component.variable`.
    starts: Mapping[str, float | bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        ordered = sorted(self.parts, key=lambda part: not part.is_vehicle)
        object.__setattr__(self, "parts", tuple(ordered))
        if reasons := list(_reasons(self)):
            raise FmuError("cannot be assembled: " + "; ".join(reasons))

    @classmethod
    def of(cls, wiring: Wiring, identifier: str) -> Assembly:
        """Return the plan for a system of FMUs.

        Raises:
            FmuError: The system cannot be assembled; the message names each component that cannot.
        """
        values = {f"{part}.{own}": value for part, given in wiring.values.items() for own, value in given.items()}
        starts = {name: value for name, value in values.items() if not isinstance(value, str)}
        text = f"Vehicle with its shocks, coupled inside: {wiring.name}"
        return cls(identifier, text, read_parts(wiring.fmus), wiring.wires, wiring.sums, starts)

    @property
    def vehicle(self) -> Part:
        """Vehicle, which is the first part."""
        return self.parts[0]

    @property
    def shocks(self) -> tuple[Part, ...]:
        """Shocks, which are all other parts."""
        return self.parts[1:]

    @property
    def signals(self) -> tuple[tuple[Part, str], ...]:
        """Outputs that feed another part: the shocks' forces, then those of the vehicle."""
        sources = {link.source for link in self.links}
        return tuple(
            (part, name)
            for part in (*self.shocks, self.vehicle)
            for name in part.interface.names("output")
            if f"{part.name}.{name}" in sources
        )

    def into(self, part: Part, variable: str) -> tuple[Wire, ...]:
        """Return the links to an input, in order."""
        return tuple(link for link in self.links if link.target == f"{part.name}.{variable}")

    def is_outside(self, part: Part, variable: str) -> bool:
        """Return whether an input of a part is an input of the assembly: it is not connected, or it is in `sums`."""
        return not self.into(part, variable) or f"{part.name}.{variable}" in self.sums


def _reasons(assembly: Assembly) -> Iterator[str]:
    yield from _wrong_parts(assembly)
    names = {part.name: part for part in assembly.parts}
    for link in assembly.links:
        yield from _wrong_link(link, names)
    linked = {link.places[0][0] for link in assembly.links}
    for part in assembly.parts:
        if part.name not in linked:
            yield f"no output of {part.name} is connected to another component: connect it with a bond, or remove it"
    yield from _loops(assembly)


def _wrong_parts(assembly: Assembly) -> Iterator[str]:
    vehicles = [part.name for part in assembly.parts if part.is_vehicle]
    if len(vehicles) != 1:
        yield (
            f"there are {len(vehicles)} vehicles ({', '.join(vehicles) or 'none'}), but exactly one is needed: write a "
            "system file for each vehicle with its own shocks"
        )
    if len(vehicles) == len(assembly.parts):
        yield "there is no shock: build the vehicle alone (eightpost build)"
    for part in assembly.parts:
        if not re.fullmatch(r"[A-Za-z_]\w*", part.name, flags=re.ASCII):
            yield (
                f"the component name {part.name!r} cannot be a prefix of variable names: use letters, digits and "
                "underscores, and start with a letter"
            )


def _wrong_link(link: Wire, names: Mapping[str, Part]) -> Iterator[str]:
    (source, output), (target, _) = link.places
    what = f"{link.source} -> {link.target}"
    if names[source].is_vehicle == names[target].is_vehicle:
        yield f"{what} does not connect a vehicle and a shock: {_RUN}"
    elif output not in names[source].interface.names("output"):
        yield f"{what}: {link.source} is not an output of its FMU: connect an output, or {_RUN}"


def _loops(assembly: Assembly) -> Iterator[str]:
    """Yield algebraic loops: the vehicle's outputs to the shocks must not have feedthrough from a shock force."""
    part = assembly.parts[0]
    fed = {name for _, (target, name) in (link.places for link in assembly.links) if target == part.name}
    for link in assembly.links:
        (source, output), _ = link.places
        if source == part.name and (direct := sorted(fed & set(part.interface.direct.get(output, ())))):
            yield (
                f"{link.source} -> {link.target} makes an algebraic loop, because {link.source} has feedthrough from "
                f"{', '.join(direct)}: {_RUN} with the implicit algorithm"
            )


# ---- The interface of an assembly -----------------------------------------------------------------------------------

KIND = "assembly"

#: Offset of the value references of each part; the references of the assembly's own variables are below it.
REFERENCES_PER_PART = 1000

#: Row of interface.toml that becomes one variable for each shock.
_ERROR = "<shock>.coupling_error"

#: Parameters that affect the force of a shock at rest; all others only have an effect when it moves. The temperature
#: and the clicks change the gas preload.
_AT_REST = ("motion_ratio", "gas_stiffness", "gas_preload", "temperature")


def assembly_interface(assembly: Assembly) -> Interface:
    """Return the interface of an assembly."""
    table = read_table(KIND)
    own = {row["name"]: row for row in table["variable"]}
    rows = [row for name, row in own.items() if name != _ERROR]
    variables = [variable_of(row, row["name"], row["reference"], row.get("start")) for row in rows]
    for number, part in enumerate(assembly.parts, start=1):
        variables += _of_part(assembly, part, REFERENCES_PER_PART * number)
        if not part.is_vehicle:
            reference = REFERENCES_PER_PART * number + own[_ERROR]["reference"]
            variables.append(variable_of(own[_ERROR], f"{part.name}.coupling_error", reference, None))
    outputs = [v.name for v in variables if v.causality == "output"]
    initial, direct = _initial(assembly), _direct(assembly)
    return Interface(
        kind=table["interface"],
        version=table["version"],
        description=table["description"],
        variables=tuple(variables),
        direct={name: direct.get(name, ()) for name in outputs} | direct,
        initial={name: initial.get(name, ()) for name in outputs} | initial,
    )


def coupling_step(interface: Interface) -> float:
    """Return the start value of an assembled FMU's parameter for its largest micro step [s]."""
    return next(float(v.start or 0.0) for v in interface.variables if v.name == "coupling_step")


def _of_part(assembly: Assembly, part: Part, first: int) -> Iterator[Variable]:
    for variable in part.interface.variables:
        if variable.causality == "input" and not assembly.is_outside(part, variable.name):
            continue
        of = None if variable.derivative_of is None else f"{part.name}.{variable.derivative_of}"
        name = _name_in(part, variable.name)
        yield replace(
            variable,
            name=name,
            derivative_of=of,
            reference=first + variable.reference,
            start=assembly.starts.get(name, variable.start),
            description=f"{part.name}: {variable.description}",
        )


def _name_in(part: Part, name: str) -> str:
    """Return the name in the assembly of a variable of a part: `lf.force`, `der(lf.lagged_force)`."""
    return f"der({part.name}.{name[4:]}" if name.startswith("der(") else f"{part.name}.{name}"


def _direct(assembly: Assembly) -> dict[str, tuple[str, ...]]:
    """Return the inputs with feedthrough to each output and derivative, and the states that it depends on.

    They are followed from the vehicle to the shocks and back to the vehicle. In co-simulation a shock force reaches the
    vehicle one step later, so the vehicle's outputs follow fewer of them.
    """
    found: dict[str, tuple[str, ...]] = {}
    for part in (*assembly.parts, assembly.vehicle):
        states = part.interface.states
        for unknown, knowns in part.interface.direct.items():
            known: set[str] = set()
            for name in knowns:
                if name in states or assembly.is_outside(part, name):
                    known.add(f"{part.name}.{name}")
                known.update(*(found.get(link.source, ()) for link in assembly.into(part, name)))
            found[_name_in(part, unknown)] = tuple(sorted(known))
    return found


def _initial(assembly: Assembly) -> dict[str, tuple[str, ...]]:
    """Return the variables that each output depends on at the start, which is the union of two kinds of start.

    In a start from zero, nothing moves and only feedthrough matters. In an equilibrium start, nothing moves either, and
    the displacements depend on constant inputs; accelerations are zero.
    """
    steady = _closed(assembly, _steady(assembly))
    zero = _closed(assembly, _from_zero(assembly.vehicle.interface))
    flag = f"{assembly.vehicle.name}.start_at_equilibrium"
    found = {}
    for name in steady:
        part, _, output = name.partition(".")
        known = steady[name] | zero[name] | ({flag} if steady[name] != zero[name] else set())
        if part == assembly.vehicle.name and output in assembly.vehicle.interface.names("output"):
            known |= {f"{part}.{offset}" for offset in _offsets(assembly, output)}
        found[name] = tuple(sorted(known))
    return found


def _steady(assembly: Assembly) -> Mapping[str, tuple[str, ...]]:
    """Return the inputs and port springs that each vehicle output, state and derivative depends on in steady state.

    Without a steady state these are the inputs that matter in a start from zero. A rate is zero at rest, unless it
    depends on springs there: accelerations of a fitted vehicle have small constant parts.
    """
    interface = assembly.vehicle.interface
    if "HAS_EQUILIBRIUM = 0" in assembly.vehicle.data:
        return _from_zero(interface)
    units = {v.name: v.unit for v in interface.variables}
    springs = {f"{port}port_spring" for port in spring_ports(interface)}
    known_at_rest, found = {*interface.names("input"), *springs}, {}
    for name, names in interface.initial.items():
        is_zero = name in interface.derivatives or (units[name] in RATES and springs.isdisjoint(names))
        found[name] = () if is_zero else tuple(known for known in names if known in known_at_rest)
    return found


def _from_zero(interface: Interface) -> Mapping[str, tuple[str, ...]]:
    """Return the inputs that each vehicle output, state and derivative depends on in a start from zero."""
    return {name: interface.feedthrough(name) for name in interface.initial}


def _offsets(assembly: Assembly, output: str) -> tuple[str, ...]:
    interface = assembly.vehicle.interface
    added = {v.name for v in interface.variables if v.causality == "parameter" and v.type == "Real"}
    springs = {f"{port}port_spring" for port in spring_ports(interface)}
    return tuple(name for name in interface.initial[output] if name in added - springs)


def _closed(assembly: Assembly, vehicle: Mapping[str, tuple[str, ...]]) -> dict[str, set[str]]:
    """Return the dependencies of each unknown at a start, followed through the loop of vehicle and shocks.

    `vehicle` contains the inputs and springs of the vehicle that each of its unknowns depends on.
    """
    found: dict[str, set[str]] = {
        _name_in(part, unknown): set() for part in assembly.parts for unknown in part.interface.initial
    }
    before = -1
    while before != (before := sum(map(len, found.values()))):
        for part in assembly.parts:
            for unknown in part.interface.initial:
                found[_name_in(part, unknown)] |= (
                    {known for name in vehicle[unknown] for known in _behind(assembly, part, name, found)}
                    if part.is_vehicle
                    else set(_at_shock(assembly, part, unknown, found))
                )
    return found


def _at_shock(assembly: Assembly, part: Part, output: str, found: Mapping[str, set[str]]) -> Iterator[str]:
    named = part.interface
    behind = {name: set(_behind(assembly, part, name, found)) for name in named.names("input")}
    for name in named.initial[output]:
        is_spring = name in _AT_REST or name.startswith("clicks.")
        at_rest = output == "force" and is_spring and (name != "gas_stiffness" or behind["displacement"])
        if name not in behind and (at_rest or behind["velocity"]):
            yield f"{part.name}.{name}"
    for name in set(behind) & set(named.initial[output]):
        yield from behind[name]


def _behind(assembly: Assembly, part: Part, name: str, found: Mapping[str, set[str]]) -> Iterator[str]:
    """Yield the variables that an input of a part depends on."""
    if assembly.is_outside(part, name):
        yield f"{part.name}.{name}"
    for link in assembly.into(part, name):
        yield from found[link.source]
