"""`eightpost ssp`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from eightpost.app.options import FilePath, OutputFile, Verb
from eightpost.outputs import PACKAGE


@click.command(cls=Verb)
@click.argument("system", type=FilePath())
@click.option("-o", "--output", type=OutputFile(PACKAGE, default=lambda given: given["system"].with_suffix(".ssp")),
              help="Output package; default: SYSTEM with the suffix .ssp (of a package _new.ssp).")  # fmt: skip
def ssp(system: Path, output: Path) -> None:
    """Write a system of coupled FMUs as an SSP 1.0 package for other tools.

    SYSTEM is a file that `eightpost run` accepts; a package with subsystems is written as one flat system. The package
    holds the FMUs, their connections, and for each component a file of its settable parameters,
    resources/<component>.ssv. A package cannot hold a drive file: the tool that imports the package drives the open
    inputs.

    \b
    Example:
      eightpost ssp examples/seven_dof.toml -o car.ssp
    """
    from builder.ssp import write_ssp
    from cosim.system_file import read_case
    from eightpost.api.reading import existing_toml

    existing_toml(system, "system")
    case = read_case(system)
    open_inputs = write_ssp(output, case.wiring)
    console = Console()
    count = len(case.system.components)
    console.print(f"{output}: {count} components, {len(case.system.all_connections)} connections, SSP 1.0")
    if open_inputs:
        console.print(f"  open inputs, 0 unless driven: {', '.join(open_inputs)}", highlight=False)
