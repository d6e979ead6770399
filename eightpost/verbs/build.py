"""Options of `eightpost build`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TARGETS = ("native", "python", "all")


@click.command()
@click.argument("sources", nargs=-1, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("dist"), show_default=True,
              help="Output folder of the FMUs; with --assemble, a folder or the file name of the FMU.")  # fmt: skip
@click.option("--target", type=click.Choice(TARGETS), default="native", show_default=True,
              help="Code of the FMUs. native: compiled C, for any host on six platforms. python: the readable "
                   "reference, for hosts with Python, numpy and scipy. all: both.")  # fmt: skip
@click.option("--confidential", is_flag=True,
              help="Leave out the sources, the static curve (picture and coefficients) and the names of the source "
                   "files. The parameters of the lag, which a host may tune, stay readable.")  # fmt: skip
@click.option("--assemble", "system", type=click.Path(path_type=Path), metavar="SYSTEM",
              help="System file to build as one FMU: a vehicle and its shocks, with the coupling solved inside "
                   "(docs/assembly.md). Default: one FMU from each of SOURCES.")  # fmt: skip
@body
def build() -> None:
    """Build an FMI 2.0 co-simulation FMU from each source.

    SOURCES are shock files (written by `eightpost fit`) and vehicle files: parameters (.toml) or an identified state
    space (.json).

    An FMU is named after its source, and the same source gives the same bytes. The FMU carries the verdict on its
    model, and every run repeats this verdict. The exit code is 1 if a model is not usable (docs/verdict.md); its FMU
    is written nevertheless.

    \b
    Examples:
      eightpost build shock.json car.toml -o dist/
      eightpost build --assemble system.toml -o dist/car_with_shocks.fmu
    """
