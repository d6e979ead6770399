"""Reading of an SSP package, or a bare description in its folder, as a system and a scenario."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from weakref import WeakKeyDictionary

from cosim.components.component import DISCRETE, Component, Conversion, Variable, convert_between, named_unit, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.session.run import Case
from cosim.ssp import flatten
from cosim.ssp.description import read_structure
from cosim.ssp.flatten import Hop, Network, Port, SystemPath, compose
from cosim.ssp.package import Assignment, Experiment, FmuElement, Structure, Unpacked, Value, named, open_package
from cosim.systems.coupling import Scenario
from cosim.systems.system import System, can_be_set
from eightpost import units
from eightpost.array_types import Array
from eightpost.errors import InputError, UnknownUnitError, WiringError
from eightpost.signals import Drivefile, TimeSeries

# ---- Parameter values assigned to variables -------------------------------------------------------------------------


@dataclass(frozen=True)
class Values:
    """Values from parameter sets by port of an FMU: parameters and inputs, with notes on values that match nothing."""

    parameters: Mapping[Port, Value] = field(default_factory=dict)
    inputs: Mapping[Port, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def _read_values(network: Network) -> Values:
    """Return the values that parameter sets give to variables.

    A set bound at a higher level takes precedence over one at a lower level; of two at one level the later one does. A
    value at a system's connector reaches the variables that the connector feeds. An input fed by another FMU gets none.
    """
    given, notes = _assigned(network)
    parameters: dict[Port, Value] = {}
    inputs: dict[Port, float] = {}
    direct = (port for port in given if network.variable(port) is not None)
    for target in dict.fromkeys((*network.fed(), *direct)):
        origin, hops = network.chain(target)
        if hops and isinstance(network.elements[origin.path], FmuElement):
            continue
        found = _strongest(origin, hops, given)
        variable = network.variable(target)
        if found is None or variable is None:
            continue
        value = _at(network, target, variable, found)
        if can_be_set(variable):
            parameters[target] = value
        elif variable.causality == "input":
            inputs[target] = float(value)
        else:
            notes.append(f"{found.assignment.where}: {target} = {value!r} is ignored: the FMU computes this variable")
    return Values(parameters, inputs, tuple(notes))


@dataclass(frozen=True)
class _Given:
    """Value at a port, its rank, and the links from there to the variable."""

    rank: int
    assignment: Assignment
    port: Port
    hops: Sequence[Hop] = ()


def _assigned(network: Network) -> tuple[dict[Port, _Given], list[str]]:
    """Return the value of highest rank at each port, and notes on values without a port; the top system comes last."""
    found: dict[Port, _Given] = {}
    unmatched: dict[str, list[str]] = {}
    paths = sorted(network.elements, key=len, reverse=True)
    assignments = ((path, value) for path in paths for value in network.elements[path].values)
    for rank, (place, value) in enumerate(assignments):
        port = network.find(value.name, place)
        if port is None:
            unmatched.setdefault(value.where, []).append(".".join((*place, value.name)))
        else:
            found[port] = _Given(rank, value, port)
    return found, [f"{where}: no variable matches {', '.join(names)}" for where, names in unmatched.items()]


def _strongest(origin: Port, hops: Sequence[Hop], given: Mapping[Port, _Given]) -> _Given | None:
    ports = [origin, *(hop.target for hop in hops)]
    found = [
        _Given(given[port].rank, given[port].assignment, port, hops[index:])
        for index, port in enumerate(ports)
        if port in given
    ]
    return max(found, key=lambda value: value.rank, default=None)


def _at(network: Network, target: Port, variable: Variable, given: _Given) -> Value:
    """Return a value converted along its links to an FMU's variable."""
    assignment, what = given.assignment, f"{given.assignment.where}: {given.port}"
    unit = network.unit(given.port)
    first = Conversion()
    if not assignment.suppressed:
        first = convert_between(assignment.unit, unit, what)
        unit = unit or assignment.unit
    total, _ = network.carry(unit, given.hops, compose(first, assignment.transformation))
    value = assignment.value
    if total != Conversion():
        if isinstance(value, (bool, str)):
            raise WiringError(f"{what} = {value!r}: a linear transformation needs a number; remove it")
        value = total(value)
    return _typed(value, target, variable, assignment)


def _typed(value: Value, target: Port, variable: Variable, assignment: Assignment) -> Value:
    """Return a value in the variable's type, if this is possible without loss."""
    number = not isinstance(value, (bool, str))
    if variable.type == "Real" and number:
        return float(value)
    if variable.type in ("Integer", "Enumeration") and number and float(value).is_integer():
        return int(value)
    if variable.type == "Enumeration" and isinstance(value, str):
        return _item(value, target, variable, assignment)
    if (variable.type, type(value)) in (("Boolean", bool), ("String", str)):
        return value
    raise WiringError(
        f"{assignment.where}: {target} = {value!r} is given as {assignment.type}, but the variable is a "
        f"{variable.type}; correct the type"
    )


def _item(name: str, target: Port, variable: Variable, assignment: Assignment) -> int:
    """Return the number of an enumeration's item: from the FMU, else from the parameter set."""
    items = variable.items or dict(assignment.items)
    if name not in items:
        listed = ", ".join(items) or "none known"
        raise WiringError(
            f"{assignment.where}: {target} = {name!r} is not an item of its enumeration ({listed}); correct it"
        )
    return items[name]


# ---- Data for the open inputs of a package --------------------------------------------------------------------------


@dataclass(frozen=True)
class _OpenInputs:
    """Inputs for numbers that no other FMU feeds."""

    network: Network  #: Network of the package.
    names: Mapping[SystemPath, str]  #: Component names by path.

    @cached_property
    def ports(self) -> tuple[Port, ...]:
        """Open inputs in the order of the components."""
        numbers = ("Real", *DISCRETE)
        return tuple(
            port for port in self.network.inputs() if self._variable(port).type in numbers and not self._is_fed(port)
        )

    def full_name(self, port: Port) -> str:
        """Return `component.variable`."""
        return f"{self.names[port.path]}.{port.name}"

    def drive(self, given: Drivefile) -> Drivefile:
        """Return a drive file with one channel for each input, under its full name.

        Raises:
            WiringError: A channel has no input, or two have the same.
        """
        channels: dict[str, tuple[str, Array]] = {}
        for name, unit in zip(given.names, given.units, strict=True):
            for port, start in self._reached(name, f"drive file channel {name!r}"):
                if self.full_name(port) in channels:
                    raise WiringError(f"two channels of the drive file feed {port}; keep one")
                channels[self.full_name(port)] = self._channel(given, (name, unit), (port, start))
        return Drivefile(TimeSeries.from_channels(given.series.time, channels))

    def fixed(self, known: Mapping[Port, float], given: Mapping[str, str], driven: Collection[str]) -> dict[str, float]:
        """Return the constant values of inputs by full name.

        Args:
            known: Values from the package; the drive file takes precedence over them.
            given: Texts by name: a number in the unit of the named port, or a value with its unit; they take
                precedence over the package.
            driven: Full names of the inputs that the drive file feeds.

        Raises:
            WiringError: There is no such open input, the drive file feeds it too, or the text is not a value.
        """
        found = {self.full_name(port): value for port, value in known.items()}
        found = {name: value for name, value in found.items() if name not in driven}
        for name, text in given.items():
            for port, start in self._reached(name, f"input {name!r}"):
                if self.full_name(port) in driven:
                    raise WiringError(f"input {name!r}: the drive file feeds {port} too; remove one of the two")
                found[self.full_name(port)] = self._constant(name, text, (port, start))
        return found

    def idle(self, fed: Collection[str]) -> dict[str, float]:
        """Return the start values of the Real inputs without a source; other types keep them anyway.

        Raises:
            WiringError: An input has no start value.
        """
        variables = {self.full_name(port): self._variable(port) for port in self.ports}
        left = {name: v.start for name, v in variables.items() if v.type == "Real" and name not in fed}
        if empty := [name for name, start in left.items() if start is None]:
            raise WiringError(
                f"{len(empty)} inputs have no source and no start value: {', '.join(empty)}; give a drive file with "
                "channels of these names (--drive), a constant (--input NAME=VALUE), or a value in a parameter set"
            )
        return {name: float(start) for name, start in left.items() if start is not None}

    def _variable(self, port: Port) -> Variable:
        variable = self.network.variable(port)
        if variable is None:
            raise WiringError(f"{port}: the FMU has no such variable; correct the name")
        return variable

    def _is_fed(self, port: Port) -> bool:
        origin, hops = self.network.chain(port)
        return bool(hops) and isinstance(self.network.elements[origin.path], FmuElement)

    def _reached(self, name: str, what: str) -> Iterator[tuple[Port, Port]]:
        """Yield the open inputs that a name refers to, each with the port at which the value enters."""
        start = self._port(name)
        found = [] if start is None else [port for port in self.ports if start in self._line(port)]
        if not found:
            found = [port for port in self.ports if port.name == name]
            start = None
        if not found or (start is None and len(found) > 1):
            which = " and ".join(map(str, found)) or "no open input"
            raise WiringError(
                f"{what} matches {which}; name a connector of the package, or component and input; open inputs: "
                f"{', '.join(map(str, self.ports)) or 'none'}"
            )
        yield from ((port, start or port) for port in found)

    def _port(self, name: str) -> Port | None:
        if (found := self.network.find(name, ())) is not None:
            return found
        component, _, variable = name.partition(".")
        paths = [path for path, flat in self.names.items() if flat == component]
        return self.network.find(variable, paths[0]) if paths else None

    def _line(self, port: Port) -> list[Port]:
        origin, hops = self.network.chain(port)
        return [origin, *(hop.target for hop in hops)]

    def _carried(self, unit: str | None, what: str, way: tuple[Port, Port]) -> Conversion:
        """Return the conversion from a value at the port where it enters to the input's own unit."""
        port, start = way
        line = self._line(port)
        at = self.network.unit(start)
        given = at if unit is None else named_unit(unit)
        first = convert_between(given, at, what)
        hops = self.network.chain(port)[1][line.index(start) :]
        return self.network.carry(at or given, hops, first)[0]

    def _channel(self, given: Drivefile, channel: tuple[str, str], way: tuple[Port, Port]) -> tuple[str, Array]:
        """Return unit and samples of a channel for the master, which converts to the input's unit."""
        name, unit = channel
        what, values = f"drive file channel {name!r}", given.series[name]
        total = self._carried(unit, what, way)
        variable = self._variable(way[0])
        if way[0] == way[1] and variable.unit is not None:
            return unit, values
        back, si = to_si(variable)
        total = compose(total, back)
        return si, values if total == Conversion() else total.factor * values + total.offset

    def _constant(self, name: str, text: str, way: tuple[Port, Port]) -> float:
        what, kind = f"input {name!r}", self._variable(way[0]).type
        if kind in DISCRETE:
            return _discrete(text, kind, f"{way[0]} = {text!r}")
        number, unit = _quantity(text, what)
        return self._carried(unit, what, way)(number)


def _discrete(text: str, kind: str, what: str) -> int:
    if kind == "Boolean" and text in ("true", "false"):
        return text == "true"
    try:
        return int(text) if kind != "Boolean" else bool(("0", "1").index(text))
    except ValueError:
        expected = "true or false" if kind == "Boolean" else "a whole number"
        raise WiringError(f"{what}: the input is a {kind}; give {expected}") from None


def _quantity(text: str, what: str) -> tuple[float, str | None]:
    """Return a number and its unit; None if the text is only a number."""
    try:
        return float(text), None
    except ValueError:
        pass
    try:
        return units.quantity(text)
    except UnknownUnitError as error:
        raise WiringError(f"{what}: {error}") from error


# ==== Reading ========================================================================================================

SUFFIXES = (".ssp", ".ssd")

#: Keeps an unpacked package as long as one of its components exists.
_PACKAGES: WeakKeyDictionary[Component, Unpacked] = WeakKeyDictionary()


@dataclass(frozen=True)
class Given:
    """Run data that a package may lack."""

    #: Drive file; each channel feeds the open input, or the connector of the top system, of its name.
    drive: Path | None = None
    stop: float | None = None  #: Length of the run [s]; overrides the package's.
    record_step: float | None = None  #: Time between recorded samples [s]; None: every step.
    #: Constant values of open inputs as texts: a number in the input's own unit, or a value with its unit.
    inputs: Mapping[str, str] = field(default_factory=dict)


def read_ssp(
    path: str | Path,
    *,
    fmus: Mapping[str, str | Path] | None = None,
    given: Given | None = None,
    load: Callable[[Path, str], Component] = FmuComponent,
) -> Case:
    """Read a package or a bare description.

    Args:
        path: Package (.ssp) or description (.ssd).
        fmus: FMUs by component name that replace those in the package.
        given: Drive file, times and inputs that the package lacks.
        load: Function that opens an FMU under a component's name.

    Raises:
        InputError: A file is missing, unsafe or wrong; the message names it.
        WiringError: The package contains something that is not supported; the message names the element.
        FmuError: An FMU cannot be used.
    """
    path, given = Path(path), given or Given()
    place = open_package(path, str(path))
    try:
        structure = read_structure(place)
        return _case(structure, fmus or {}, given, load)
    except InputError as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error


def _case(
    structure: Structure, swaps: Mapping[str, str | Path], given: Given, load: Callable[[Path, str], Component]
) -> Case:
    elements = dict(flatten.components(structure.system))
    if not elements:
        raise WiringError(f"{structure.system.where}: contains no component to run")
    names = flatten.flat_names(tuple(elements))
    components, files = _load(elements, names, swaps, load)
    network = flatten.Network(structure.system, {path: components[names[path]].variables for path in elements})
    values, inputs = _read_values(network), _OpenInputs(network, names)
    drive = None if given.drive is None else inputs.drive(Drivefile.read(given.drive))
    fixed = inputs.fixed(values.inputs, given.inputs, () if drive is None else drive.names)
    idle = inputs.idle((*fixed, *(() if drive is None else drive.names)))
    bonds, connections = flatten.with_bonds(flatten.connections(network, names))
    parameters: dict[str, dict[str, Value]] = {}
    for port, value in values.parameters.items():
        parameters.setdefault(names[port.path], {})[port.name] = value
    return Case(
        name=structure.name,
        system=System(components, bonds, connections, constants={**fixed, **idle}, parameters=parameters),
        scenario=_scenario(structure.experiment, given, drive),
        step=structure.experiment.step,
        fmus=files,
        notes=tuple(_notes(names, values, idle, structure.experiment)),
    )


def _load(
    elements: Mapping[flatten.SystemPath, FmuElement],
    names: Mapping[flatten.SystemPath, str],
    swaps: Mapping[str, str | Path],
    load: Callable[[Path, str], Component],
) -> tuple[dict[str, Component], dict[str, Path]]:
    if unknown := sorted(set(swaps) - set(names.values())):
        raise WiringError(f"no component {unknown[0]!r} to swap; there are {', '.join(names.values())}")
    components: dict[str, Component] = {}
    files: dict[str, Path] = {}
    for path, element in elements.items():
        name = names[path]
        files[name] = Path(swaps.get(name, element.path))
        with named(element.path, element.where):
            components[name] = load(files[name], name)
        if element.unpacked is not None:
            _PACKAGES[components[name]] = element.unpacked
    return components, files


def _scenario(experiment: Experiment, given: Given, drive: Drivefile | None) -> Scenario:
    stop = given.stop
    if stop is None and experiment.stop is not None:
        stop = experiment.stop - experiment.start
    if stop is None:
        raise InputError(
            "the package has no DefaultExperiment with a stopTime; give the length of the run (--set stop=TIME)"
        )
    return Scenario(
        stop=stop,
        drive=drive,
        drive_start=0.0 if drive is None else experiment.start,
        targets={} if drive is None else {name: name for name in drive.names},
        record_step=given.record_step,
    )


def _notes(
    names: Mapping[flatten.SystemPath, str], values: Values, idle: Mapping[str, float], experiment: Experiment
) -> Iterator[str]:
    if changed := [f"{'.'.join(path)} is {name}" for path, name in names.items() if path != (name,)]:
        yield f"component names: {', '.join(changed)}"
    yield from values.notes
    if idle:
        starts = ", ".join(f"{name} = {value:g}" for name, value in idle.items())
        yield (
            "these inputs have no source and keep the FMUs' start values (change with --drive or --input): " + starts
        )
    if experiment.start != 0.0:
        yield (
            f"the package starts at {experiment.start:g} s: the run uses the drive file from that time, but for the "
            "components time begins at 0"
        )
