"""Options of `eightpost fit`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.shock import LAWS
from eightpost.verbs.body import body

RECIPES = ("joint", "boggs")
SHAPES = ("auto", "free", "monotone", "passive")
WEIGHTINGS = ("auto", "none", "huber", "tukey")
GAS_TREATMENTS = ("estimate", "included", "subtracted")


@click.command()
@click.argument("dyno_files", metavar="DYNO...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--law", type=click.Choice(list(LAWS)), default="lpnl2", show_default=True,
              help="Shock law to fit (docs/shock_models.md).")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Output shock file; default: the name of the first DYNO with the suffix .json, in the current "
              "folder.")  # fmt: skip
@click.option("--recipe", type=click.Choice(RECIPES), default="joint", show_default=True,
              help="Order of the fit. joint: all parameters together. boggs: one after the other, as in "
              "3.3.")  # fmt: skip
@click.option("--shape", type=click.Choice(SHAPES), default="auto", show_default=True,
              help="Constraint on the static curve. auto: monotonic, but only if the unconstrained curve would fall. "
              "free: unconstrained. monotone: monotonic. passive: the force never acts in the direction of the "
              "motion.")  # fmt: skip
@click.option("--order", default="auto", show_default=True, metavar="auto|N",
              help="Order of the curve's inner polynomial: 1 to 15, or auto for cross-validation.")  # fmt: skip
@click.option("--robust", type=click.Choice(WEIGHTINGS), default="auto", show_default=True,
              help="Weighting of outliers. auto: outliers are down-weighted if there are any. none: no weighting. "
              "huber, tukey: always weighted by this function.")  # fmt: skip
@click.option("--gas", type=click.Choice(GAS_TREATMENTS), default="estimate", show_default=True,
              help="Gas force in the force channel. estimate: it is fitted and kept in the shock. included: it is "
              "fitted and left out of the shock, because the static load of the car already counts it. subtracted: "
              "the dynamometer already subtracted it, so it is not fitted.")  # fmt: skip
@click.option("--units", "unit_words", multiple=True, metavar="CHANNEL=UNIT",
              help="Unit of a channel whose header names none, e.g. force=lbf; may be repeated.")  # fmt: skip
@click.option("--map", "map_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map (docs/signs_and_units.md); default: the channel names in the file.")  # fmt: skip
@click.option("--flip", multiple=True, metavar="CHANNEL",
              help="Reverse the sign of a channel, e.g. force; may be repeated.")  # fmt: skip
@click.option("--split", is_flag=True,
              help="Split each record at its pauses and where a sine changes, and fit the parts as runs.")  # fmt: skip
@click.option("--segment", nargs=2, type=float, metavar="START STOP",
              help="Start and end of the part of the record to fit [s]; default 1 10.")  # fmt: skip
@click.option("--cutoff", type=float, metavar="HZ",
              help="Cut-off frequency of the low-pass on model and data [Hz]; default 50.")  # fmt: skip
@click.option("--transition-speed", metavar="SPEED",
              help="Velocity at which the inner polynomial of the curve ends; default '15 in/s', less for a slow "
              "record.")  # fmt: skip
@click.option("--name", help="Name of the shock; default: the name of the file.")
@click.option("--build", help="Team's own name for the shock build; default: that in the file.")
@click.option("--clicks", metavar="TEXT",
              help="Settings of the adjusters and how they are counted, e.g. '14 from closed, rebound'; default: those "
              "in the file.")  # fmt: skip
@click.option("--gas-pressure", metavar="PRESSURE",
              help="Gas pressure of the shock, e.g. '150 psi'; default: that in the file.")  # fmt: skip
@click.option("--plot", type=click.Path(path_type=Path),
              help="Force-velocity picture; default: the output file with the suffix .png.")  # fmt: skip
@body
def fit() -> None:
    """Fit a shock law to a dynamometer file, or to several runs of one build together.

    DYNO is a .csv, .txt, .parquet, .mat or .mf4 file with time, force, and velocity or displacement. Units are in its
    header, in a channel map, or given by --units. Several tables in a file are several runs. A table of forces over
    peak velocities gives a polylinear shock for each setting of the adjusters. The exit code is 1 if the shock is not
    usable (docs/verdict.md).

    \b
    Examples:
      eightpost fit dyno.csv --law lpnl2 -o shock.json
      eightpost fit run1.csv run2.csv --law lpf1 --order 9 --shape monotone -o shock.json
      eightpost fit sines.csv --split -o shock.json
      eightpost fit peak_velocities.csv -o shock.json
      eightpost fit run7.csv --units force=lbf --flip force --gas included -o dist/run7.json
    """
