"""Options of `eightpost linearity`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("files", metavar="RIG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--map", "map_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map (docs/rig_data.md); default: the channel names in the files.")  # fmt: skip
@click.option("--preparation", "how_file", type=click.Path(path_type=Path), metavar="TOML",
              help="File with rate, delays, geometry and other settings (docs/rig_data.md); default: decimation to "
              "125 Hz only.")  # fmt: skip
@click.option("--width", default=0.5, show_default=True, metavar="HZ",
              help="Width of the frequency bands in which the noise is estimated [Hz].")  # fmt: skip
@click.option("--high", default=25.0, show_default=True, metavar="HZ", help="Highest frequency to judge [Hz].")
@click.option("--coherence", default=0.5, show_default=True, metavar="0..1",
              help="Lower limit of a high coherence, 0 to 1.")  # fmt: skip
@click.option("--level", default=-20.0, show_default=True, metavar="DB",
              help="Lower limit of a high response [dB], relative to the output's largest response.")  # fmt: skip
@click.option("--output", "outputs", multiple=True, metavar="CHANNEL",
              help="Output to judge, e.g. lf.tire_force; may be repeated. Default: shock velocities, tire forces and "
              "ride heights.")  # fmt: skip
@click.option("-o", "folder", default="linearity", show_default=True, type=click.Path(path_type=Path),
              help="Output folder.")  # fmt: skip
@body
def linearity() -> None:
    """Judge where a linear model can predict a car on the rig: coherence against response energy.

    This is Table 6.4 of the dissertation. RIG files are tests with one actuator each, at one amplitude or at several.
    Optionally, a baseline test with all actuators may follow, and then tests of the same drive with another shock at
    one corner each. The exit code is 0 if a linear model predicts all high responses, and 1 if it misses one (Condition
    III, or a response that changes with the amplitude).

    \b
    Example:
      eightpost rig --test single --only lf.road -o rig/lf_road.parquet
      eightpost rig --test single --only rf.road -o rig/rf_road.parquet
      eightpost linearity rig/*.parquet -o linearity/
    """
