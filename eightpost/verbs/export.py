"""Options of `eightpost export`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.option("--ports", type=click.Choice(["difference", "whole"]), default="difference", show_default=True,
              help="Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the "
              "baseline damper. whole: the whole force of the shock.")  # fmt: skip
@click.option("--high", default=25.0, show_default=True, metavar="HZ",
              help="Highest frequency of a vehicle's response [Hz].")  # fmt: skip
@click.option("--step", default=0.05, show_default=True, metavar="HZ",
              help="Distance between the frequencies of a vehicle's response [Hz].")  # fmt: skip
@click.option("-o", "output", required=True, type=click.Path(path_type=Path), help="Output file: .mat, .uff or .unv.")
@body
def export() -> None:
    """Export models and frequency responses for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters) or a frequency response (.npz). A vehicle is exported to a
    .mat file with A, B, C, D, names and units, or as its frequency response to a universal file (dataset 58). A
    frequency response is exported to either format.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --high 20 --step 0.05
      eightpost export response.npz -o response.mat
    """
