"""The options of `eightpost identify`."""

from __future__ import annotations

import pkgutil
from pathlib import Path

import click

from eightpost.verbs.body import body

#: Each file in it is a recipe.
_FOLDER = Path(__file__).parents[1] / "ident" / "vehicle" / "recipes"


def _recipes() -> list[str]:
    return sorted(module.name.replace("_", "-") for module in pkgutil.iter_modules([str(_FOLDER)]))


@click.command()
@click.argument("rig_files", metavar="RIG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), default=Path("vehicle.json"),
              show_default=True, help="The vehicle; its response and what was said of it lie beside it.")  # fmt: skip
@click.option("--recipe", "recipe_name", type=click.Choice(_recipes()), default="common-poles", show_default=True,
              help="How: docs/common_poles.md, docs/identification.md.")  # fmt: skip
@click.option("--baseline", type=click.Path(path_type=Path), metavar="RIG",
              help="Which file is the baseline test; found from the shocks' dampings otherwise.")  # fmt: skip
@click.option("--damping", metavar="RATE", help="Damping around which the vehicle is identified, as '20 lbf.s/in'; "
              "default: the slope of each baseline shock.")  # fmt: skip
@click.option("--rate", default="125 Hz", show_default=True, help="To which the records are decimated.")
@click.option("--settling", default="0 s", show_default=True, help="Left out at the start of every record.")
@click.option("--preparation", type=click.Path(path_type=Path), metavar="TOML",
              help="Rate, settling, delays and geometry from a file (docs/rig_data.md), in their place.")  # fmt: skip
@click.option("--static", "static_files", metavar="RIG", multiple=True, type=click.Path(path_type=Path),
              help="Tests that hold loads: the car's static tire forces and ride heights (6.4.4).")  # fmt: skip
@click.option("--output-channels", metavar="NAMES", help="Outputs of the model, by commas; default: all it can have.")
@click.option("--name", help="Of the vehicle; default: the output's name.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (TOML): docs/rig.md.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn a channel that is positive the other way.")
@click.option("--plots", type=click.Choice(["none", "main", "all"]), default="main", show_default=True,
              help="main: shock velocities, tire forces, ride heights.")  # fmt: skip
@body
def identify() -> None:
    """Identify a vehicle from rig tests: one with baseline shocks, one with another shock at each corner.

    RIG is a .parquet, .csv, .mat or .mf4 file with the channels of docs/rig.md, or with a channel map. The vehicle is
    built into an FMU by `eightpost build`. Exits 1 if the vehicle is not usable (docs/verdict.md):
    not stable with other shocks, or far from the data.

    \b
    Examples:
      eightpost identify rig/*.parquet -o car.json
      eightpost identify base.parquet soft_lf.parquet soft_rf.parquet soft_lr.parquet soft_rr.parquet -o car.json
      eightpost identify rig/*.parquet --static static/heave.parquet --static static/roll.parquet -o car.json
      eightpost identify q1.csv q5.csv --recipe boggs --damping '31.03 lbf.s/in' -o corner.json
    """
