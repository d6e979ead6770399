"""The options of `eightpost ssp`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("system", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The package; default: beside SYSTEM, .ssp.")
@body
def ssp() -> None:
    """Write a system of coupled FMUs as an SSP 1.0 package for other tools.

    SYSTEM is a file that `eightpost run` takes; a package of others is written flat. The package holds the FMUs, their
    connections, and for each component a file of the parameters that can be set, resources/<component>.ssv. A drivefile
    has no place in it: the tool that imports the package drives the inputs that are left open.

    \b
    Example:
      eightpost ssp examples/seven_dof.toml -o car.ssp
    """
