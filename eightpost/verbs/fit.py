"""The options of `eightpost fit`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.shock import LAWS
from eightpost.verbs.body import body

RECIPES = ("joint", "boggs")
SHAPES = ("auto", "free", "monotone", "passive")
WEIGHINGS = ("auto", "none", "huber", "tukey")
GAS_TREATMENTS = ("estimate", "included", "subtracted")


@click.command()
@click.argument("dyno_files", metavar="DYNO...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--law", type=click.Choice(list(LAWS)), default="lpnl2", show_default=True, help="Shock law.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Shock file; default: DYNO with .json here.")
@click.option("--recipe", type=click.Choice(RECIPES), default="joint", show_default=True,
              help="joint: all parameters together. boggs: one after the other, as in 3.3.")  # fmt: skip
@click.option("--shape", type=click.Choice(SHAPES), default="auto", show_default=True,
              help="Of the curve. auto: free, but held from falling. free: as the record has it. monotone: it never "
              "falls. passive: it never pushes the way the velocity goes.")  # fmt: skip
@click.option("--order", default="auto", show_default=True, metavar="auto|N",
              help="Of the inner polynomial: by cross-validation, or 1 to 15.")  # fmt: skip
@click.option("--robust", type=click.Choice(WEIGHINGS), default="auto", show_default=True,
              help="auto: outliers are weighed down where there are any. huber, tukey: in any case.")  # fmt: skip
@click.option("--gas", type=click.Choice(GAS_TREATMENTS), default="estimate", show_default=True,
              help="What the force channel holds. estimate: gas force, fitted and kept in the shock. included: gas "
              "force that the car's static load already counts: fitted and left out of the shock. subtracted: none, "
              "the dynamometer took it out.")  # fmt: skip
@click.option(
    "--units", "unit_words", multiple=True, metavar="CHANNEL=UNIT", help="For a channel whose header has none."
)
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (TOML): docs/signs_and_units.md.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn a channel that is positive the other way.")
@click.option("--split", is_flag=True, help="Split each record at its pauses and where a sine changes; fit the runs.")
@click.option(
    "--segment", nargs=2, type=float, metavar="START STOP", help="Seconds of the record to fit; default 1 10."
)
@click.option("--cutoff", type=float, help="Low-pass on model and data [Hz]; default 50.")
@click.option("--transition-speed", metavar="SPEED", help="Of the curve, as '15 in/s'; default 15 in/s.")
@click.option("--name", help="Of the shock; default: the file's name.")
@click.option("--build", help="Of the shock, as the team names it.")
@click.option("--clicks", help="Adjusters and how they are counted: '14 from closed, rebound'.")
@click.option("--gas-pressure", metavar="PRESSURE", help="As '150 psi'.")
@click.option("--plot", type=click.Path(path_type=Path), help="Force-velocity picture; default: the output as .png.")
@body
def fit() -> None:
    """Fit a shock law to a dynamometer file, or to several runs of one build together.

    DYNO is a .csv, .txt, .parquet, .mat or .mf4 file with time, force, and velocity or displacement; units in its
    header, in a channel map, or by --units. Several tables in a file are several runs. A table of forces over peak
    speeds gives a polylinear shock for each setting of the adjusters. Exits 1 if the shock is not
    usable (docs/verdict.md).

    \b
    Examples:
      eightpost fit dyno.csv --law lpnl2 -o shock.json
      eightpost fit run1.csv run2.csv --law lpf1 --order 9 --shape monotone -o shock.json
      eightpost fit sines.csv --split -o shock.json
      eightpost fit peak_velocities.csv -o shock.json
      eightpost fit run7.csv --units force=lbf --flip force --gas included -o dist/run7.json
    """
