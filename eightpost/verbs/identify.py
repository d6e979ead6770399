"""Options of `eightpost identify`."""

from __future__ import annotations

import pkgutil
from pathlib import Path

import click

from eightpost.verbs.body import body

#: Folder of the recipes, one file each. Their names are listed without importing them.
_FOLDER = Path(__file__).parents[1] / "ident" / "vehicle" / "recipes"


def _recipes() -> list[str]:
    return sorted(module.name.replace("_", "-") for module in pkgutil.iter_modules([str(_FOLDER)]))


@click.command()
@click.argument("rig_files", metavar="RIG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("vehicle.json"),
              show_default=True,
              help="Output vehicle file; its frequency response and its summary are written to the same "
              "folder.")  # fmt: skip
@click.option("--recipe", "recipe_name", type=click.Choice(_recipes()), default="common-poles", show_default=True,
              help="Identification method: docs/common_poles.md, docs/identification.md.")  # fmt: skip
@click.option("--baseline", type=click.Path(path_type=Path), metavar="RIG",
              help="Baseline test among the RIG files; default: found from the damping of the shocks.")  # fmt: skip
@click.option("--damping", metavar="RATE",
              help="Damping about which the vehicle is identified, e.g. '20 lbf.s/in'; default: the slope of each "
              "baseline shock.")  # fmt: skip
@click.option("--rate", default="125 Hz", show_default=True, metavar="FREQUENCY",
              help="Sampling rate to which the records are decimated.")  # fmt: skip
@click.option("--settling", default="0 s", show_default=True, metavar="TIME",
              help="Settling time left out at the start of every record, e.g. '4 s'.")  # fmt: skip
@click.option("--preparation", type=click.Path(path_type=Path), metavar="TOML",
              help="File with rate, settling, delays and geometry (docs/rig_data.md), which replaces --rate and "
              "--settling; default: none.")  # fmt: skip
@click.option("--static", "static_files", metavar="RIG", multiple=True, type=click.Path(path_type=Path),
              help="Test with held loads, for the car's static tire forces and ride heights (6.4.4); may be "
              "repeated.")  # fmt: skip
@click.option("--output-channels", metavar="NAMES",
              help="Outputs of the model, separated by commas; default: all possible outputs.")  # fmt: skip
@click.option("--name", help="Name of the vehicle; default: the name of the output file.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map (docs/rig.md); default: the channel names in the files.")  # fmt: skip
@click.option("--flip", multiple=True, metavar="CHANNEL",
              help="Reverse the sign of a channel, e.g. lf.force; may be repeated.")  # fmt: skip
@click.option("--plots", type=click.Choice(["none", "main", "all"]), default="main", show_default=True,
              help="Outputs to draw. main: shock velocities, tire forces and ride heights.")  # fmt: skip
@body
def identify() -> None:
    """Identify a vehicle from rig tests: one with baseline shocks, one with another shock at each corner.

    RIG is a .parquet, .csv, .mat or .mf4 file with the channels of docs/rig.md, or with a channel map. Use `eightpost
    build` to build an FMU of the vehicle. The exit code is 1 if the vehicle is not usable (docs/verdict.md): it is not
    stable with other shocks, or it is far from the data.

    \b
    Examples:
      eightpost identify rig/*.parquet -o car.json
      eightpost identify base.parquet soft_lf.parquet soft_rf.parquet soft_lr.parquet soft_rr.parquet -o car.json
      eightpost identify rig/*.parquet --static static/heave.parquet --static static/roll.parquet -o car.json
      eightpost identify q1.csv q5.csv --recipe boggs --damping '31.03 lbf.s/in' -o corner.json
    """
