"""Writing of an assembly as one FMU file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from builder.assembly.documents import assembly_documents
from builder.assembly.plan import Assembly, assembly_interface
from builder.assembly.sources import assembly_sources
from builder.build import fmu_identifier
from builder.fmu.description import Description
from builder.fmu.interface import Interface
from builder.native.native_fmu import CAPABILITIES, EXCHANGE, Source, compiled, sealed
from builder.native.toolchain import Toolchain, find_toolchain
from eightpost import __version__
from eightpost.archive import write_archive
from eightpost.errors import FmuError
from eightpost.files import check_output_folder
from eightpost.wiring import Wiring


@dataclass(frozen=True)
class Assembled:
    """An assembled FMU that was written: its file, assembly, interface, platforms, and limits of its toolchain."""

    path: Path
    assembly: Assembly
    interface: Interface
    platforms: tuple[str, ...]
    limits: str


def assemble(
    wiring: Wiring,
    path: str | Path,
    *,
    toolchain: Toolchain | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Assembled:
    """Write a system as one native FMU; the same system gives the same bytes.

    Args:
        wiring: Vehicle, shocks and connections to assemble; see `cosim.System.wiring`.
        path: FMU file to write; its name must be a C identifier.
        toolchain: Compiler and its platforms; by default, the one with the most platforms that is installed.
        progress: Callback that receives the number of compiled binaries and the total number.

    Raises:
        FmuError: The system cannot be assembled, or there is no compiler, or it fails.
    """
    path = Path(path)
    if path.stem != fmu_identifier(path.stem):
        raise FmuError(
            f"{path}: {path.stem!r} is not a valid C identifier; use letters, digits and underscores, e.g. "
            f"{fmu_identifier(path.stem)}.fmu"
        )
    check_output_folder(path.parent)
    assembly = Assembly.of(wiring, path.stem)
    toolchain = toolchain or find_toolchain()
    interface = assembly_interface(assembly)
    (members,) = compiled([_unbuilt(assembly, interface)], toolchain=toolchain, progress=progress)
    write_archive(path, members)
    platforms = tuple(platform.name for platform in toolchain.platforms)
    return Assembled(path, assembly, interface, platforms, toolchain.limits)


def _unbuilt(assembly: Assembly, interface: Interface) -> Source:
    """Return the FMU without its binaries."""
    description = Description(
        identifier=assembly.identifier,
        guid="",
        text=assembly.text,
        interface=interface,
        capabilities=CAPABILITIES,
        generation_tool=f"eightpost {__version__}",
        exchange=EXCHANGE,
    )
    members = assembly_documents(assembly, interface)
    return sealed(description, members, lambda guid: assembly_sources(assembly, interface, guid))
