"""Options of `eightpost vehicle`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("path", metavar="CAR", type=click.Path(path_type=Path))
@click.option("--vary", "parameter", metavar="PARAMETER",
              help="Parameter to vary at all four corners alike, e.g. damping; default: none.")  # fmt: skip
@click.option("--factors", default="0.5,1,2,3", show_default=True, metavar="FACTORS",
              help="Factors that the parameter is multiplied by, separated by commas.")  # fmt: skip
@click.option("--output", "names", metavar="CHANNEL", multiple=True,
              help="Output to draw, e.g. lf.tire_force; may be repeated. Default: shock velocities, tire forces and "
              "ride heights.")  # fmt: skip
@click.option("--high", default=25.0, show_default=True, metavar="HZ", help="Highest frequency [Hz].")
@click.option("-o", "folder", default="vehicle", show_default=True, type=click.Path(path_type=Path),
              help="Output folder.")  # fmt: skip
@body
def vehicle() -> None:
    """Show modes and frequency responses of a vehicle, and the effect of a parameter on them.

    CAR is a vehicle file: parameters (.toml), or an identified model (.json), which has no parameters to vary. The
    vehicle includes its linear dampers. The command writes a picture for each output, and the responses as
    response.npz.

    \b
    Example:
      eightpost vehicle car.toml --vary damping --factors 0.5,1,2,3 -o study
    """
