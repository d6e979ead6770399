"""The shock and the quarter car of a page: their interfaces, and their C code as WebAssembly modules."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from builder.assembly import Assembly, Part, read_parts
from builder.assembly.assembled_fmu import assembly_sources
from builder.assembly.parts import VEHICLE
from builder.assembly.plan import assembly_interface
from builder.build import product_of
from builder.fmu.interface import Interface
from builder.native.native_fmu import version_files, without_binaries
from builder.native.toolchain import Library, compile_for_browser
from eightpost.archive import read_archive, write_archive
from eightpost.errors import FmuError
from eightpost.wiring import Wire, Wiring

#: Names of the two components of the assembled car.
SHOCK, CAR = "shock", "car"

#: Variables of a quarter car that the page uses; a vehicle with four ports has them with a corner's name only.
_NEEDED = ("force", "road", "velocity", "displacement", "tire_force", "wheel_position", "chassis_position")


@dataclass(frozen=True)
class Model:
    """An FMU for a page."""

    interface: Interface  #: Variables of the FMU.
    module: bytes  #: WebAssembly module of the FMU's C code.


@dataclass(frozen=True)
class Models:
    """The models of a page."""

    shock: Model  #: Shock alone.
    car: Model  #: Quarter car with the shock, coupled inside.
    title: str  #: Description of the shock's FMU.
    validity: bytes | None  #: Validity that the shock's FMU states for its model, as JSON; None if it states none.


def read_models(shock: Path, vehicle: Path) -> Models:
    """Return the models of a page.

    Args:
        shock: Shock file (.json) or native FMU of a shock.
        vehicle: File of a quarter car (.toml, .json) or its native FMU.

    Raises:
        FmuError: A file cannot be used, or the compiler zig is not installed, or it fails.
        InputError: A file cannot be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        fmus = {CAR: _fmu(vehicle, Path(folder) / "car.fmu"), SHOCK: _fmu(shock, Path(folder) / "shock.fmu")}
        wires = tuple(
            Wire(f"{source}.{name}", f"{target}.{name}")
            for source, target, name in ((CAR, SHOCK, "velocity"), (CAR, SHOCK, "displacement"), (SHOCK, CAR, "force"))
        )
        wiring = Wiring(f"{vehicle.stem} with {shock.stem}", fmus, wires, step=1e-3, stop=1.0)
        _refuse_others(wiring, shock, vehicle)
        assembly = Assembly.of(wiring, "car_with_shock")
        sources = read_archive(fmus[SHOCK])
    part = assembly.shocks[0]
    library = Library("shock", _code(sources), is_one_unit=True)
    return Models(
        shock=Model(part.interface, compile_for_browser(library)),
        car=_coupled(assembly),
        title=part.text,
        validity=part.validity,
    )


def _fmu(source: Path, path: Path) -> Path:
    """Return the FMU of a file: itself, or one without binaries that is written to `path`."""
    if source.suffix == ".fmu":
        return source
    write_archive(path, without_binaries(product_of(source)).members)
    return path


def _code(members: dict[str, bytes]) -> dict[str, bytes]:
    return {name.removeprefix("sources/"): text for name, text in members.items() if name.startswith("sources/")}


def _coupled(assembly: Assembly) -> Model:
    interface = assembly_interface(assembly)
    sources = assembly_sources(assembly, interface, "page") | version_files(assembly.identifier, 2)
    return Model(interface, compile_for_browser(Library(assembly.identifier, sources)))


def _refuse_others(wiring: Wiring, shock: Path, vehicle: Path) -> None:
    car, found = read_parts(wiring.fmus)
    if found.kind == VEHICLE:
        raise FmuError(f"{shock} is a vehicle; give a shock file (eightpost fit) or the FMU of a shock")
    if missing := [name for name in _NEEDED if name not in _names(car)]:
        raise FmuError(
            f"{vehicle} is not a quarter car with one port, a road, a tire and positions: it has no "
            f"{', '.join(missing)}; choose one such as examples/corner.toml (--vehicle)"
        )


def _names(part: Part) -> set[str]:
    return {variable.name for variable in part.interface.variables}
