"""The options of `eightpost linearity`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("files", metavar="RIG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (TOML): docs/rig_data.md.")
@click.option("--preparation", "how_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Rate, delays, geometry ...: docs/rig_data.md. Default: 125 Hz.")  # fmt: skip
@click.option("--width", default=0.5, show_default=True, metavar="HZ", help="Of the bands over which noise is told.")
@click.option("--high", default=25.0, show_default=True, metavar="HZ", help="Highest frequency.")
@click.option("--coherence", default=0.5, show_default=True, help="A coherence is high from here.")
@click.option("--level", default=-20.0, show_default=True, help="A response is high from here [dB of its largest].")
@click.option("--output", "outputs", multiple=True, metavar="CHANNEL",
              help="Outputs; default: shock velocities, tire forces, ride heights.")  # fmt: skip
@click.option("-o", "folder", default="linearity", show_default=True, type=click.Path(path_type=Path), help="Folder.")
@body
def linearity() -> None:
    """Judge where a linear model can predict a car on the rig: coherence against response energy.

    Table 6.4 of the dissertation. RIG are tests with one actuator each, of one amplitude or several, and besides, if
    wanted, a baseline with all actuators followed by tests of the same drive with another shock at one corner each.
    Exits 0 if no response of energy is lost to a linear model, 1 if one is (Condition III, or a response that changes
    with the amplitude).

    \b
    Example:
      eightpost rig --test single --only lf.road -o rig/lf_road.parquet
      eightpost rig --test single --only rf.road -o rig/rf_road.parquet
      eightpost linearity rig/*.parquet -o linearity/
    """
