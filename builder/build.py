"""Shock files and vehicle files into FMUs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import eightpost.shock
import eightpost.vehicle.kernel
from builder.documents import documents
from builder.interface import Interface, shock_interface, vehicle_interface
from builder.python_fmu import PythonModel, build_python_fmu, imported_files
from builder.sources import source_folder
from eightpost.errors import FmuError
from eightpost.files import check_output_folder, document_kind
from eightpost.shock import Shock, read_shock
from eightpost.vehicle import StateSpace, Vehicle, read_vehicle

TARGETS = ("python",)


@dataclass(frozen=True)
class Built:
    """One FMU that was written, and from what."""

    path: Path
    source: str
    interface: Interface


def build(sources: Sequence[str | Path], folder: str | Path, *, target: str = "python") -> list[Built]:
    """Build one FMU per source file into `folder`; each is named after its source.

    Args:
        sources: Shock files (`eightpost fit`) and vehicle files (.toml with parameters, .json with a state space).
        folder: Where the FMUs go; made if it is not there.
        target: `python`.

    Raises:
        FmuError: Two sources would give the same FMU, or a vehicle cannot be one.
        InputError: A source cannot be read.
    """
    if target not in TARGETS:
        raise FmuError(f"target {target!r} is not known; known are {', '.join(TARGETS)}")
    check_output_folder(folder)
    models = [_model(Path(source)) for source in sources]
    names = [model.identifier for model in models]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        raise FmuError(f"several sources would be written to {doubled[0]}.fmu; rename one of them")
    built = []
    for source, model in zip(sources, models, strict=True):
        path = Path(folder) / f"{model.identifier}.fmu"
        build_python_fmu(model, path)
        built.append(Built(path, str(source), model.interface))
    return built


def shock_model(shock: Shock, identifier: str) -> PythonModel:
    """Return what a shock's python FMU is made of."""
    interface = shock_interface(shock)
    slave = f"shock_{shock.law_name}"
    law = Path(eightpost.shock.__file__).with_name(f"{shock.law_name}.py")
    common = source_folder() / "common"
    code = (*imported_files(law), common / "table_slave.py", common / "shock_slave.py")
    text = f"{interface.description}: {shock.name}"
    return PythonModel(
        identifier, text, interface, slave, code, {}, documents(identifier, text, interface, shock.conditions)
    )


def vehicle_model(vehicle: Vehicle, identifier: str) -> PythonModel:
    """Return what a vehicle's python FMU is made of: its model without dampers at the ports, and its static state.

    Raises:
        FmuError: The model is discrete, has a direct term in a shock velocity, or a channel that vehicle_ss does
            not know.
    """
    model = vehicle.coupled()
    if model.dt is not None:
        raise FmuError(f"vehicle {vehicle.name!r} is a discrete model; convert it to continuous time first")
    _refuse_direct_velocity(model)
    interface = _with_static(vehicle_interface(model), vehicle.static)
    offsets = {v.name: v.offset for v in interface.variables}
    outputs = [c.name for c in model.outputs]
    data = {name: getattr(model, name).tolist() for name in "ABCD"} | {
        "inputs": [c.name for c in model.inputs],
        "outputs": outputs,
        "offsets": [offsets[name] for name in outputs],
    }
    code = (Path(eightpost.vehicle.kernel.__file__), source_folder() / "common" / "table_slave.py")
    text = f"{interface.description}: {vehicle.name}"
    return PythonModel(
        identifier, text, interface, "vehicle_ss", code, data, documents(identifier, text, interface, {})
    )


def _refuse_direct_velocity(model: StateSpace) -> None:
    """A shock velocity with a direct term makes an algebraic loop with the shock (docs/ports.md)."""
    for channel, terms in zip(model.outputs, model.D != 0.0, strict=True):
        if channel.name.rpartition(".")[2] == "velocity" and terms.any():
            inputs = ", ".join(c.name for c, term in zip(model.inputs, terms, strict=True) if term)
            raise FmuError(
                f"vehicle {model.name!r}: {channel.name} follows {inputs} without delay (D is not zero there), which "
                "makes an algebraic loop with the shock; identify it without direct terms in the shock velocities"
            )


def _with_static(interface: Interface, static: Mapping[str, float]) -> Interface:
    """Give the static offsets their start values; `static` has them by output."""
    starts = {v.offset: static.get(v.name, 0.0) for v in interface.variables if v.offset}
    variables = tuple(replace(v, start=starts[v.name]) if v.name in starts else v for v in interface.variables)
    return replace(interface, variables=variables)


def _model(source: Path) -> PythonModel:
    identifier = fmu_identifier(source.stem)
    if source.suffix == ".json" and document_kind(source) == "shock":
        return shock_model(read_shock(source), identifier)
    if source.suffix in (".json", ".toml"):
        return vehicle_model(read_vehicle(source), identifier)
    raise FmuError(f"{source}: build takes shock files (.json) and vehicle files (.toml, .json)")


def fmu_identifier(name: str) -> str:
    """Return a C name from a file's name: what FMI asks of a model identifier."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{identifier}" if identifier[:1].isdigit() or not identifier else identifier
