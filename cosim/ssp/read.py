"""Reading of an SSP package, or a bare description in its folder, as a system and a scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from weakref import WeakKeyDictionary

from cosim.components.component import Component
from cosim.components.fmu_component import FmuComponent
from cosim.session.master import Case
from cosim.ssp import flatten
from cosim.ssp.description import read_structure
from cosim.ssp.package import Experiment, FmuElement, Structure, Unpacked, Value, named, open_package
from cosim.ssp.values import OpenInputs, Values, read_values
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.errors import EightpostError, InputError, WiringError
from eightpost.signals import Drivefile

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
        raise _naming(error, path) from error


def _naming(error: InputError, path: Path) -> EightpostError:
    """Return the error with the package's name before it, unless it contains the name already."""
    return error if str(path) in str(error) else type(error)(f"{path}: {error}")


def _case(
    structure: Structure, swaps: Mapping[str, str | Path], given: Given, load: Callable[[Path, str], Component]
) -> Case:
    elements = dict(flatten.components(structure.system))
    if not elements:
        raise WiringError(f"{structure.system.where}: contains no component to run")
    names = flatten.flat_names(tuple(elements))
    components, files = _load(elements, names, swaps, load)
    network = flatten.Network(structure.system, {path: components[names[path]].variables for path in elements})
    values, inputs = read_values(network), OpenInputs(network, names)
    drive = None if given.drive is None else inputs.drive(Drivefile.read(given.drive))
    fixed = inputs.fixed(values.inputs, given.inputs, () if drive is None else drive.names)
    idle = inputs.idle((*fixed, *(() if drive is None else drive.names)))
    bonds, connections = flatten.with_bonds(flatten.connections(network, names))
    parameters = _parameters(values, names)
    return Case(
        name=structure.name,
        system=System(components, bonds, connections, constants={**fixed, **idle}, parameters=parameters),
        scenario=_scenario(structure.experiment, given, drive),
        step=structure.experiment.step,
        fmus=files,
        notes=(*_name_notes(names), *values.notes, *_idle_notes(idle), *_time_notes(structure.experiment)),
    )


def _load(
    elements: Mapping[flatten.SystemPath, FmuElement],
    names: Mapping[flatten.SystemPath, str],
    swaps: Mapping[str, str | Path],
    load: Callable[[Path, str], Component],
) -> tuple[dict[str, Component], dict[str, Path]]:
    """Return the components and their files by name."""
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


def _parameters(values: Values, names: Mapping[flatten.SystemPath, str]) -> dict[str, dict[str, Value]]:
    found: dict[str, dict[str, Value]] = {}
    for port, value in values.parameters.items():
        found.setdefault(names[port.path], {})[port.name] = value
    return found


def _scenario(experiment: Experiment, given: Given, drive: Drivefile | None) -> Scenario:
    stop = given.stop
    if stop is None and experiment.stop is not None:
        stop = experiment.stop - experiment.start
    if stop is None:
        raise InputError("the package has no DefaultExperiment with a stopTime; give the length of the run (--stop)")
    return Scenario(
        stop=stop,
        drive=drive,
        drive_start=0.0 if drive is None else experiment.start,
        targets={} if drive is None else {name: name for name in drive.names},
        record_step=given.record_step,
    )


def _name_notes(names: Mapping[flatten.SystemPath, str]) -> tuple[str, ...]:
    changed = [f"{'.'.join(path)} is {name}" for path, name in names.items() if path != (name,)]
    return (f"component names: {', '.join(changed)}",) if changed else ()


def _idle_notes(idle: Mapping[str, float]) -> tuple[str, ...]:
    if not idle:
        return ()
    values = ", ".join(f"{name} = {value:g}" for name, value in idle.items())
    return (f"these inputs have no source and keep the FMUs' start values (change with --drive or --input): {values}",)


def _time_notes(experiment: Experiment) -> tuple[str, ...]:
    if experiment.start == 0.0:
        return ()
    return (
        f"the package starts at {experiment.start:g} s: the run uses the drive file from that time, but for the "
        "components time begins at 0",
    )
