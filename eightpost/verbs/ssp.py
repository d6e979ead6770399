"""Options of `eightpost ssp`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("system", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Output package; default: SYSTEM with the suffix .ssp.")  # fmt: skip
@body
def ssp() -> None:
    """Write a system of coupled FMUs as an SSP 1.0 package for other tools.

    SYSTEM is a file that `eightpost run` accepts; a package with subsystems is written as one flat system. The package
    holds the FMUs, their connections, and for each component a file of its settable parameters,
    resources/<component>.ssv. A package cannot hold a drive file: the tool that imports the package drives the open
    inputs.

    \b
    Example:
      eightpost ssp examples/seven_dof.toml -o car.ssp
    """
