"""The options of `eightpost vehicle`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("path", metavar="CAR", type=click.Path(path_type=Path))
@click.option("--vary", "parameter", metavar="PARAMETER", help="Vary a parameter, all four corners alike.")
@click.option("--factors", default="0.5,1,2,3", show_default=True, help="What it is multiplied by, with commas.")
@click.option("--output", "names", metavar="CHANNEL", multiple=True, help="Outputs to draw; default: the key ones.")
@click.option("--high", default=25.0, show_default=True, metavar="HZ", help="Highest frequency [Hz].")
@click.option("-o", "folder", default="vehicle", show_default=True, type=click.Path(path_type=Path), help="Folder.")
@body
def vehicle() -> None:
    """Show modes and frequency responses of a vehicle, and what a parameter does to them.

    CAR is a vehicle file: parameters (.toml), or an identified model (.json), which has no parameters to vary. Its
    linear dampers are in it. Written are a picture per output, and the responses as response.npz.

    \b
    Example:
      eightpost vehicle car.toml --vary damping --factors 0.5,1,2,3 -o study
    """
