"""Systems: components, bonds and connections, checked when a system is created."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from cosim.components.component import DISCRETE, Component, Variable, convert_between, named_unit
from cosim.components.fmu_component import FmuComponent
from cosim.components.watch import OpenedFmu
from eightpost import units
from eightpost.display import Summarized, Summary, some
from eightpost.errors import UnknownUnitError, WiringError, suggestion
from eightpost.wiring import Wire, Wiring

# ---- Variables of components by name, and the values that they take -------------------------------------------------


def _find_variable(components: Mapping[str, Component], name: str) -> Variable:
    component, _, variable = name.partition(".")
    if component not in components:
        raise WiringError(f"{name}: there is no component {component!r}; {suggestion(component, components)}")
    variables = components[component].variables
    if variable not in variables:
        raise WiringError(
            f"{name}: component {component!r} has no variable {variable!r}; {suggestion(variable, variables)}"
        )
    return variables[variable]


def own_unit(components: Mapping[str, Component], name: str, value: bool | float | str) -> bool | float | str:
    """Return a value of `component.variable` in the variable's own unit; a number is already in it.

    Raises:
        WiringError: There is no such component or variable, or the unit does not fit.
    """
    variable = _find_variable(components, name)
    if isinstance(value, np.generic):
        value = value.item()
    if variable.type == "Enumeration" and isinstance(value, str):
        if value not in variable.items:
            raise WiringError(f"{name} = {value!r}: {suggestion(value, variable.items)}")
        return variable.items[value]
    if variable.type in DISCRETE:
        return int(value) if isinstance(value, float) and value == round(value) else value
    if variable.type != "Real":
        return value
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, Real):
            raise WiringError(f"{name}: the value is {value!r}; give a number, or a text such as '55 lbf'")
        return float(value)
    try:
        number, unit = units.quantity(value)
        return convert_between(named_unit(unit), variable.unit, f"{name} = {value!r}")(number)
    except UnknownUnitError as error:
        raise WiringError(f"{name}: {error}") from error


def can_be_set(variable: Variable) -> bool:
    """Return whether a variable can be set before a run and keeps its value: a parameter, or an initial value.

    In FMI exactly the variables that can be set before initialization have a start value (FMI 2.0.4, 2.2.7, `initial`).
    Real inputs are excluded here, because they are connected, driven or constant.
    """
    if variable.causality == "input":
        return variable.type != "Real"
    return variable.causality == "parameter" or (variable.start is not None and variable.variability != "constant")


_KINDS: Mapping[str, tuple[type, ...]] = {
    "Real": (int, float),
    "Integer": (int,),
    "Boolean": (bool,),
    "String": (str,),
    "Enumeration": (int,),
    "Binary": (),
}


def _check_value(name: str, variable: Variable, value: object) -> None:
    """Refuse a value of the wrong type or outside the range that the component declares."""
    if type(value) not in _KINDS.get(variable.type, (type(value),)):
        raise WiringError(f"{name} = {value!r}: it is a {variable.type} variable and takes no {type(value).__name__}")
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return
    low, high = variable.minimum, variable.maximum
    if not isfinite(value) or (low is not None and value < low) or (high is not None and value > high):
        unit = f" {variable.unit.name}" if variable.unit and variable.unit.name != "1" else ""
        lowest, highest = ("any" if limit is None else f"{limit:g}" for limit in (low, high))
        raise WiringError(f"{name} = {value!r}{unit} is outside its range, {lowest} to {highest}{unit}")


# ---- Systems --------------------------------------------------------------------------------------------------------

#: A coupling step that suits race cars and their shocks (docs/explanation/coupling.md) [s].
DEFAULT_STEP = 1e-3


_DISCRETE = frozenset(DISCRETE)


@dataclass(frozen=True, slots=True)
class Connection:
    """Connection from an output to an input, both as `component.variable`; units are converted, then `gain` applies.

    A component that is positive in extension is connected with gain -1. `offset` is added last, in the input's own
    unit. Both ends have the same type unless `convert` is set. Integer, Boolean and enumeration values are held over
    each step; a value for an input of these types is rounded (a Boolean is true unless 0).
    """

    source: str
    target: str
    gain: float = 1.0
    offset: float = 0.0
    convert: bool = False

    @property
    def ends(self) -> tuple[str, str]:
        """Source and target."""
        return self.source, self.target

    def __str__(self) -> str:
        return f"{self.source} -> {self.target}"


@dataclass(frozen=True, slots=True)
class Bond:
    """Velocity/force port: velocity goes one way, force comes back (docs/reference/ports.md)."""

    name: str
    velocity: Connection
    force: Connection
    displacement: Connection | None = None

    @classmethod
    def between(
        cls, vehicle: str, shock: str, *, gain: float = 1.0, displacement: bool = True, name: str | None = None
    ) -> Bond:
        """Connect a vehicle's port and a shock by the names of docs/reference/ports.md.

        Args:
            vehicle: Component and port: `car.lf`; only `car` for a quarter car.
            shock: Component of the shock.
            gain: Gain on velocity, displacement and force; -1 for a shock that is positive in extension.
            displacement: Whether to connect the displacement too.
            name: Name of the bond; default the vehicle's port.
        """
        travel = Connection(f"{vehicle}.displacement", f"{shock}.displacement", gain) if displacement else None
        return cls(
            name=name or vehicle,
            velocity=Connection(f"{vehicle}.velocity", f"{shock}.velocity", gain),
            force=Connection(f"{shock}.force", f"{vehicle}.force", gain),
            displacement=travel,
        )

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Two or three connections of the bond."""
        return (self.velocity, self.force) + ((self.displacement,) if self.displacement else ())


@dataclass(frozen=True, repr=False)
class System(Summarized):
    """Components and their connections; every rule that does not need a scenario is checked here.

    Raises:
        WiringError: An unknown name, two sources for an input that is not declared a sum, incompatible units; the
            message names the connection and what to do.
    """

    components: Mapping[str, Component]  #: Components by name; names have no dots.
    bonds: tuple[Bond, ...] = ()  #: Velocity/force ports.
    connections: tuple[Connection, ...] = ()  #: Any other connections.
    sums: frozenset[str] = frozenset()  #: Inputs, as `component.variable`, that add up the values of several sources.
    #: Inputs with a constant value, in the component's own unit.
    constants: Mapping[str, float] = field(default_factory=dict)
    #: Values of parameters, and initial values of other variables with a start value, by component and in the
    #: component's own units.
    parameters: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "bonds", tuple(self.bonds))
        object.__setattr__(self, "connections", tuple(self.connections))
        object.__setattr__(self, "sums", frozenset(self.sums))
        for name in self.components:
            if not name or "." in name:
                raise WiringError(f"component name {name!r}: give it a name without dots")
        for connection in self.all_connections:
            self._check_connection(connection)
        for name in (*self.constants, *self.sums):
            self.input(name)
        self._check_sources()
        self._check_bond_names()
        self._check_parameters()
        self._check_gas_springs()

    @classmethod
    def load(
        cls,
        fmus: Mapping[str, str | PathLike[str]],
        bonds: Iterable[Bond | tuple[str, str]] = (),
        *,
        connections: Iterable[Connection] = (),
        sums: Iterable[str] = (),
        constants: Mapping[str, float] | None = None,
        parameters: Mapping[str, float | bool | str] | Mapping[str, Mapping[str, float | bool | str]] | None = None,
    ) -> System:
        """Create a system from FMU files.

        Args:
            fmus: FMU file of each component by its name.
            bonds: Velocity/force ports, also as pairs of the vehicle's port and the shock: `("car.lf", "lf")`.
            connections: Any other connections.
            sums: Inputs that add up the values of several sources.
            constants: Inputs with a constant value, in the component's own unit.
            parameters: Values of parameters by `component.parameter`, or by component and parameter.

        Raises:
            FmuError: A file is missing or is not an FMU that can be used.
            WiringError: An unknown name, two sources of one input, incompatible units, or something else than a bond.
        """
        if not isinstance(fmus, Mapping):
            raise WiringError(f"the FMUs are {fmus!r}; give them by name: {{'car': 'car.fmu', 'lf': 'shock.fmu'}}")
        for name, path in fmus.items():
            if not isinstance(path, (str, PathLike)):
                raise WiringError(f"component {name!r} is a {type(path).__name__}; give the file of its FMU")
        components = {name: FmuComponent(Path(path), name) for name, path in fmus.items()}
        values_by_name: Mapping[str, Any] = parameters or {}
        tables = {name: dict(values) for name, values in values_by_name.items() if isinstance(values, Mapping)}
        system = cls(components, _bonds(bonds), tuple(connections), frozenset(sums), dict(constants or {}), tables)
        return system.with_parameters({name: value for name, value in values_by_name.items() if name not in tables})

    def _summary(self) -> Summary:
        return Summary.of("System", *self.summary_rows())

    def summary_rows(self) -> tuple[tuple[str, str], ...]:
        """Return components, bonds and other connections, and changed values, as rows of a summary."""
        changed = [f"{part}.{name} = {value}" for part, own in self.parameters.items() for name, value in own.items()]
        return (
            ("components", some((f"{name} ({Path(c.source).name})" for name, c in self.components.items()), 8)),
            ("bonds", some((bond.name for bond in self.bonds), 8)),
            ("connections", some((f"{c.source} -> {c.target}" for c in self.connections), 3)),
            ("constants", some((f"{name} = {value}" for name, value in self.constants.items()), 3)),
            ("parameters", some(changed, 6)),
        )

    @property
    def ramps(self) -> bool:
        """Whether all components can ramp their inputs over a step."""
        return all(c.capabilities.interpolates_inputs for c in self.components.values())

    @property
    def can_repeat_steps(self) -> bool:
        """Whether every component can save and restore its state."""
        return all(c.capabilities.state for c in self.components.values())

    @property
    def accepts_any_step(self) -> bool:
        """Whether every component accepts steps of any size."""
        return all(c.capabilities.variable_step for c in self.components.values())

    @property
    def has_foreign_fmus(self) -> bool:
        """Whether a component is an FMU that this project did not build."""
        return any(isinstance(c, OpenedFmu) and not c.is_ours for c in self.components.values())

    @property
    def only_step(self) -> float | None:
        """Coupling step that suits components which accept steps of one size only [s]; None if none states its size.

        Raises:
            WiringError: Two of them state different sizes.
        """
        sizes = {c.capabilities.only_step: name for name, c in self.components.items() if c.capabilities.only_step}
        if len(sizes) > 1:
            stated = " and ".join(f"{name} of {size:g} s" for size, name in sizes.items())
            raise WiringError(
                f"no coupling step suits the components: {stated} only (stepSize); export one of them again"
            )
        return next(iter(sizes), None)

    @property
    def coupled_with_held(self) -> frozenset[str]:
        """Components that hold their inputs over a step, and all components connected with them."""
        held = {name for name, c in self.components.items() if not c.capabilities.interpolates_inputs}
        links = [(c.source.partition(".")[0], c.target.partition(".")[0]) for c in self.all_connections]
        while wider := {end for link in links if held & set(link) for end in link} - held:
            held |= wider
        return frozenset(held)

    @property
    def decisive(self) -> frozenset[str]:
        """Outputs whose coupling error is judged: velocities and forces of bonds, tire forces."""
        ends = {c.source for bond in self.bonds for c in (bond.velocity, bond.force)}
        return frozenset(ends.union(self.tire_forces))

    @property
    def tire_forces(self) -> tuple[str, ...]:
        """Outputs that are tire forces."""
        return tuple(n for n, v in self.variables() if v.causality == "output" and n.endswith("tire_force"))

    def variables(self) -> Iterator[tuple[str, Variable]]:
        """Yield all variables of the components with their names, as `component.variable`."""
        return ((f"{name}.{v.name}", v) for name, c in self.components.items() for v in c.variables.values())

    @property
    def all_connections(self) -> tuple[Connection, ...]:
        """All connections: those of the bonds, then the others."""
        return tuple(c for bond in self.bonds for c in bond.connections) + self.connections

    def wiring(
        self, fmus: Mapping[str, str | Path], *, name: str = "system", step: float = DEFAULT_STEP, stop: float = 1.0
    ) -> Wiring:
        """Return what `builder.ssp.write_ssp` and `builder.assembly.assemble` need; a drive is left to the host.

        Args:
            fmus: FMU file of each component.
            name: Name of the system.
            step: Coupling step that a package proposes [s].
            stop: Duration of a run that a package proposes [s].
        """
        wires = []
        for c in self.all_connections:
            source, target = self.output(c.source), self.input(c.target)
            conversion = convert_between(source.unit, target.unit, f"{c.source} -> {c.target}")
            wires.append(Wire(c.source, c.target, c.gain, conversion.factor, conversion.offset, c.offset, c.convert))
        values = {component: dict(self.parameters.get(component, {})) for component in self.components}
        for full_name, value in self.constants.items():
            component, _, variable = full_name.partition(".")
            values[component][variable] = value
        files = {component: Path(fmus[component]) for component in self.components}
        return Wiring(name, files, tuple(wires), step, stop, self.sums, values)

    def with_parameters(self, values: Mapping[str, float | bool | str]) -> System:
        """Return the system with other values of parameters; it shares the components, which are not loaded again.

        Args:
            values: Values by `component.variable`: a number in the variable's own unit, or a text with another unit
                ("55 lbf").

        Raises:
            WiringError: There is no such parameter (the message lists similar names), or it does not allow the value.
        """
        changed = {component: dict(own) for component, own in self.parameters.items()}
        for name, value in values.items():
            if not isinstance(name, str) or "." not in name:
                raise WiringError(
                    f"parameters: {name!r} must be component.parameter, such as 'lf.compression_scale'; the components "
                    f"are {', '.join(self.components)}"
                )
            component, _, variable = name.partition(".")
            changed.setdefault(component, {})[variable] = own_unit(self.components, name, value)
        return replace(self, parameters=changed) if values else self

    def start_values(self, component: str) -> dict[str, float | bool | str]:
        """Return the values that a component gets before initialization: parameters and constant discrete inputs."""
        constants = {
            name.partition(".")[2]: value
            for name, value in self.constants.items()
            if name.partition(".")[0] == component and self.input(name).type in DISCRETE
        }
        return dict(self.parameters.get(component, {})) | constants

    @property
    def discrete_connections(self) -> tuple[Connection, ...]:
        """Connections with an Integer, Boolean or enumeration end; they are exchanged outside the loop."""
        return tuple(c for c in self.connections if _DISCRETE & {self.output(c.source).type, self.input(c.target).type})

    @property
    def real_connections(self) -> tuple[Connection, ...]:
        """Connections from Real to Real: those of the bonds, then the others."""
        discrete = set(self.discrete_connections)
        return tuple(c for c in self.all_connections if c not in discrete)

    def output(self, name: str) -> Variable:
        """Return the variable `component.variable`, of any causality that can be read.

        Raises:
            WiringError: There is no such component or variable.
        """
        return _find_variable(self.components, name)

    def input(self, name: str) -> Variable:
        """Return the input `component.variable`.

        Raises:
            WiringError: There is no such component or variable, or it is not an input for numbers.
        """
        variable = _find_variable(self.components, name)
        if variable.causality != "input" or variable.type not in ("Real", *DISCRETE):
            raise WiringError(
                f"{name} is a {variable.type} {variable.causality}, not an input for numbers; in a bond the vehicle "
                "comes first"
            )
        return variable

    def _check_bond_names(self) -> None:
        names = [bond.name for bond in self.bonds]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise WiringError(
                f"two bonds are named {doubled[0]!r}: give each its own name (name = ...), so that their energies can "
                "be distinguished"
            )

    def _check_connection(self, connection: Connection) -> None:
        what = f"{connection.source} -> {connection.target}"
        source, target = self.output(connection.source), self.input(connection.target)
        _check_types(connection, source, target, what)
        if not (isfinite(connection.gain) and connection.gain != 0.0):
            raise WiringError(f"{what}: the gain must be finite and not zero, not {connection.gain!r}")
        if not isfinite(connection.offset):
            raise WiringError(f"{what}: the offset must be finite, not {connection.offset!r}")
        convert_between(source.unit, target.unit, what)
        for bond in self.bonds:
            if connection in bond.connections and {source.type, target.type} != {"Real"}:
                raise WiringError(f"{what}: the ends of bond {bond.name} must be Real variables")

    def _check_sources(self) -> None:
        sources: dict[str, list[str]] = {}
        for connection in self.all_connections:
            sources.setdefault(connection.target, []).append(connection.source)
        for target in self.constants:
            sources.setdefault(target, []).append("a constant")
        for target, fed_by in sources.items():
            discrete = self.input(target).type in DISCRETE or any(c.target == target for c in self.discrete_connections)
            if len(fed_by) > 1 and discrete:
                raise WiringError(
                    f"{target} has {len(fed_by)} sources ({', '.join(fed_by)}), but Integer, Boolean and enumeration "
                    "values cannot be added; remove all but one"
                )
            if len(fed_by) > 1 and target not in self.sums:
                raise WiringError(
                    f"{target} has {len(fed_by)} sources ({', '.join(fed_by)}); remove all but one, or add "
                    f'"{target}" to sums if they add up'
                )

    def _check_parameters(self) -> None:
        for component, values in self.parameters.items():
            for name, value in values.items():
                variable = _find_variable(self.components, f"{component}.{name}")
                if not can_be_set(variable):
                    raise WiringError(f"{component}.{name} is an {variable.causality}, not a parameter")
                _check_value(f"{component}.{name}", variable, value)
        for name, constant in self.constants.items():
            _check_value(name, _find_variable(self.components, name), constant)

    def _check_gas_springs(self) -> None:
        """Refuse a gas spring whose displacement is constant: its force would be wrong (docs/reference/ports.md)."""
        for name, component in self.components.items():
            if not {"gas_stiffness", "displacement"} <= set(component.variables):
                continue
            stiffness = self.parameters.get(name, {}).get("gas_stiffness", component.variables["gas_stiffness"].start)
            if float(stiffness or 0.0) != 0.0 and f"{name}.displacement" in self.constants:
                raise WiringError(
                    f"{name} has a gas spring (gas_stiffness {stiffness}) but its displacement is a constant; "
                    "connect it to the vehicle's displacement at that corner"
                )


def _check_types(connection: Connection, source: Variable, target: Variable, what: str) -> None:
    """Refuse values that are not numbers, and connections of different types without `convert`."""
    if source.type not in ("Real", *DISCRETE):
        raise WiringError(f"{what}: {connection.source} is a {source.type}; connections carry numbers only")
    if source.type != target.type and not connection.convert:
        raise WiringError(
            f"{what}: connects {_a(source.type)} to {_a(target.type)}; if this is intended, let the connection convert "
            "the value (convert = true)"
        )
    if source.type == target.type != "Real" and (connection.gain, connection.offset) != (1.0, 0.0):
        raise WiringError(
            f"{what}: {_a(source.type)} is transferred unchanged, without gain and offset; remove them, or put a "
            "component between"
        )


def _a(kind: str) -> str:
    return f"{'an' if kind[0] in 'EI' else 'a'} {kind}"


def _bonds(entries: Iterable[Bond | tuple[str, str]]) -> tuple[Bond, ...]:
    """Return bonds, of which some are given as pairs of names."""
    if isinstance(entries, Bond | str) or not isinstance(entries, Iterable):
        raise WiringError(f"bonds is a {type(entries).__name__}; give a list of bonds")
    bonds: list[Bond] = []
    for one in entries:
        if isinstance(one, Bond):
            bonds.append(one)
        elif isinstance(one, (tuple, list)) and len(one) == 2 and all(isinstance(name, str) for name in one):
            bonds.append(Bond.between(*one))
        else:
            raise WiringError(f"{one!r} is not a bond; write ('car.lf', 'lf'): the vehicle's port, then the shock")
    return tuple(bonds)
