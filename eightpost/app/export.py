"""`eightpost export`: models and frequency responses for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click
from rich.console import Console

from eightpost.app.options import Quantity


@click.command()
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.option("--ports", type=click.Choice(["difference", "whole"]), default="difference", show_default=True,
              help="Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the "
              "baseline damper. whole: the whole force of the shock.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", bare=True), default="25 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency of a vehicle's response.")  # fmt: skip
@click.option("--step", type=Quantity("Hz", bare=True), default="0.05 Hz", show_default=True, metavar="FREQUENCY",
              help="Distance between the frequencies of a vehicle's response.")  # fmt: skip
@click.option("-o", "output", required=True, type=click.Path(path_type=Path), help="Output file: .mat, .uff or .unv.")
def export(source: Path, ports: Literal["difference", "whole"], high: float, step: float, output: Path) -> None:
    """Export models and frequency responses for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters) or a frequency response (.npz). A vehicle is exported to a
    .mat file with A, B, C, D, names and units, or as its frequency response to a universal file (dataset 58). A
    frequency response is exported to either format.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --high '20 Hz' --step '0.05 Hz'
      eightpost export response.npz -o response.mat
    """
    from eightpost.ident.exports.export import export as write

    summary = write(source, output, ports=ports, high=high, step=step)
    Console(soft_wrap=True, highlight=False).print(f"read {source}; wrote {output}: {summary}", markup=False)
