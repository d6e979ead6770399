"""`eightpost build --assemble`: a system file into one FMU."""

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
    """Build one FMU of a system file; `output` is the file, or a folder for a file with the system file's name.

    Raises:
        FmuError: The system cannot be assembled; the message names each component that cannot.
        WiringError: The system does not fit together.
    """
    path = output if output.suffix == ".fmu" else output / f"{fmu_identifier(source.stem)}.fmu"
    if path.stem != fmu_identifier(path.stem):
        raise FmuError(
            f"{path}: {path.stem!r} is no name for a model in C; use letters, digits and underscores, as in "
            f"{fmu_identifier(path.stem)}.fmu"
        )
    assembly = assembly_of(read_case(source), path.stem)
    columns = (TextColumn("compiling"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        return assemble(assembly, path, progress=lambda done, total: bar.update(task, completed=done, total=total))


def assembly_of(case: Case, identifier: str) -> Assembly:
    """Return a case's system as one FMU to be; its drive and its algorithm are the host's affair.

    Raises:
        FmuError: It cannot be assembled.
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
    """Connections with the conversion between their ends' units, in the order in which the master adds them up."""
    for connection in system.all_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        found = convert_between(source.unit, target.unit, f"{connection.source} -> {connection.target}")
        # The connection's offset comes last, in the target's unit.
        offset = found.offset + connection.offset / connection.gain
        yield Link(connection.source, connection.target, connection.gain, found.factor, offset)


def show_assembled(console: Console, built: Assembled) -> None:
    """Print what was put together, its micro step and its platforms."""
    names = built.interface.names
    table = Table(Column("component", overflow="fold"), Column("FMU", overflow="fold"), "interface", "is fed by")
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
