"""The options of `eightpost build`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TARGETS = ("native", "python", "all")


@click.command()
@click.argument("sources", nargs=-1, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("dist"), show_default=True,
              help="Folder for the FMUs; with --assemble also the FMU's file.")  # fmt: skip
@click.option("--target", type=click.Choice(TARGETS), default="native", show_default=True,
              help="native: C, for any host on six platforms. python: the readable reference, for Python hosts with "
                   "numpy and scipy. all: both.")  # fmt: skip
@click.option("--confidential", is_flag=True,
              help="Leave out sources, the curve (picture and coefficients) and the names of source files. The lag's "
                   "parameters, which a host may tune, stay readable.")  # fmt: skip
@click.option("--assemble", "system", type=click.Path(path_type=Path),
              help="Build one FMU of a system file: a vehicle and its shocks, with the coupling solved inside "
                   "(docs/assembly.md).")  # fmt: skip
@body
def build() -> None:
    """Build an FMI 2.0 co-simulation FMU from each source.

    SOURCES are shock files (eightpost fit) and vehicle files: parameters (.toml) or an identified state space (.json).
    An FMU is named after its source; the same source gives the same bytes. It carries the verdict on its model, which
    every run repeats. Exits 1 if one is not usable (docs/verdict.md): the FMUs are written all the same.

    \b
    Example:
      eightpost build shock.json car.toml -o dist/
      eightpost build --assemble system.toml -o dist/car_with_shocks.fmu
    """
