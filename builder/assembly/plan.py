"""Plan of an assembled FMU: its parts, their connections, its variables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from builder.assembly.parts import Part, read_parts
from builder.interface import RATES, Interface, Variable, read_table, spring_ports, variable_of
from eightpost.errors import FmuError
from eightpost.wiring import Wire, Wiring

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
