"""`eightpost build --assemble`: one FMU from a system file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from builder.assembly import Assembled, Assembly, Link, assemble, read_parts
from builder.build import fmu_identifier
from cosim.conversion import convert_between
from cosim.system import System
from cosim.system_file import Case, read_case
from eightpost.errors import FmuError


def assemble_with_progress(console: Console, source: Path, output: Path) -> Assembled:
    """Build one FMU from a system file.

    Args:
        console: Console for the progress bar.
        source: System file.
        output: File name of the FMU (.fmu), or a folder, in which the FMU is named after the system file.

    Raises:
        FmuError: The system cannot be assembled; the message names each component that cannot.
        WiringError: The system does not fit together.
    """
    path = output if output.suffix == ".fmu" else output / f"{fmu_identifier(source.stem)}.fmu"
    if path.stem != fmu_identifier(path.stem):
        raise FmuError(
            f"{path}: {path.stem!r} is not a valid C identifier; use letters, digits and underscores, e.g. "
            f"{fmu_identifier(path.stem)}.fmu"
        )
    assembly = assembly_of(read_case(source), path.stem)
    columns = (TextColumn("compiling"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        return assemble(assembly, path, progress=lambda done, total: bar.update(task, completed=done, total=total))


def assembly_of(case: Case, identifier: str) -> Assembly:
    """Return the description of the FMU that holds a case's system; drive and algorithm are left to the host.

    Raises:
        FmuError: The system cannot be assembled.
    """
    system = case.system
    parameters = {f"{name}.{own}": value for name, given in system.parameters.items() for own, value in given.items()}
    starts = dict(system.constants) | {name: value for name, value in parameters.items() if not isinstance(value, str)}
    return Assembly(
        identifier=identifier,
        text=f"Vehicle with its shocks, coupled inside: {case.name}",
        parts=read_parts(case.fmus),
        links=tuple(_links(system)),
        sums=system.sums,
        starts=starts,
    )


def _links(system: System) -> Iterator[Link]:
    """Yield the connections with their unit conversion, in the order in which the master adds them up."""
    for connection in system.all_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        conversion = convert_between(source.unit, target.unit, f"{connection.source} -> {connection.target}")
        # The offset of the connection is applied last, in the unit of the target.
        offset = conversion.offset + connection.offset / connection.gain
        yield Link(connection.source, connection.target, connection.gain, conversion.factor, offset)


def show_assembled(console: Console, built: Assembled) -> None:
    """Print the components of the FMU, its micro step and its platforms."""
    names = built.interface.names
    table = Table(Column("component", overflow="fold"), Column("FMU", overflow="fold"), "interface", "sources")
    for part in built.assembly.parts:
        sources = [link.source for link in built.assembly.links if link.target.startswith(f"{part.name}.")]
        table.add_row(part.name, part.file, f"{part.kind} {part.interface.version}", ", ".join(sources))
    console.print(table)
    step = next(float(v.start or 0.0) for v in built.interface.variables if v.name == "coupling_step")
    console.print(
        f"{escape(str(built.path))}: {len(names('input'))} inputs, {len(names('output'))} outputs, "
        f"{len(names('parameter'))} parameters, {built.path.stat().st_size / 1024:.0f} KiB"
    )
    console.print(
        f"micro step: {step * 1e3:g} ms at most (parameter coupling_step); error: output coupling_error, in %"
    )
    console.print(f"platforms: {', '.join(built.platforms)}")
    if built.limits:
        console.print(f"[yellow]note[/] {escape(built.limits)}")
