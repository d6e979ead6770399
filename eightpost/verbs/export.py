"""The options of `eightpost export`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.option("--ports", type=click.Choice(["difference", "whole"]), default="difference", show_default=True,
              help="What the shock inputs of a vehicle take: what a shock's force is more than the baseline damper's, "
              "or the whole of it.")  # fmt: skip
@click.option(
    "--high", default=25.0, show_default=True, metavar="HZ", help="Highest frequency of a vehicle's response."
)
@click.option("--step", default=0.05, show_default=True, metavar="HZ", help="Between its frequencies.")
@click.option("-o", "output", required=True, type=click.Path(path_type=Path), help="A .mat, .uff or .unv file.")
@body
def export() -> None:
    """Export models and frequency responses for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters) or a frequency response (.npz). A vehicle becomes a .mat with
    A, B, C, D, names and units, or its frequency response as a universal file (datasets 58); a response becomes either.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --high 20 --step 0.05
      eightpost export response.npz -o response.mat
    """
