"""The options of `eightpost validate`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

#: Left out at the start of a vehicle's records [s].
SETTLING = 4.0


@click.command()
@click.argument("paths", metavar="JSON... RECORD...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--kind", "kinds", metavar="[FILE=]KIND", multiple=True,
              help="random, sine, static or bump, of one file or of all; default: seen from the motion.")  # fmt: skip
@click.option("--configuration", "configurations", metavar="[FILE=]N", multiple=True,
              help="Shocks: configuration 1 to 12 of Table 3.1, of one file or of all.")  # fmt: skip
@click.option("--limit", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Highest error, in percent of the measured standard deviation; more exits 1. "
              "Default: of vehicles 25, of shocks 30.")  # fmt: skip
@click.option("--level", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Vehicles: largest error of an RMS on random records; more exits 1. Default: 5.")  # fmt: skip
@click.option("--shock", "shock_words", metavar="CORNER|NAME=SHOCK.JSON", multiple=True,
              help="Vehicles: the law at a corner (lf, rf, lr, rr), or of the shock that records call so; else the "
              "measured shock forces are taken.")  # fmt: skip
@click.option("--against", metavar="CAR", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Vehicles: another fit (.json) or parameters (.toml) whose modes stand beside.")  # fmt: skip
@click.option("--settling", metavar="SECONDS", type=click.FloatRange(min=0.0),
              help=f"Vehicles: left out at the start of records, at most 1/4; default {SETTLING:g}.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.HTML",
              help="Write one interactive, printable page (docs/validation.md).")  # fmt: skip
@click.option("--keep", is_flag=True,
              help="Write the verdict into the shock or vehicle files, in place of an earlier one: FMUs that are built "
              "from them carry it into every run.")  # fmt: skip
@click.option("--cutoff", type=float, metavar="HZ", help="Shocks: low-pass [Hz]; default 50, of bumps 200.")
@click.option("--units", "unit_words", metavar="CHANNEL=UNIT", multiple=True, help="Unit of a channel without one.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (.toml) of all records.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn the sign of a channel of all records.")
@body
def validate() -> None:
    """Validate fitted shocks or an identified vehicle on records that they were not fitted to.

    Files that end in .json are shocks, or one vehicle; all others are dynamometer or rig records. A folder stands for
    the records in it.

    Each shock is held against each record, unless both say a condition and they differ. Exits 1 if the verdict is "not
    usable" (docs/verdict.md): more than a fifth of a record is outside the fitted velocities, a record has no shock, or
    an error is over --limit.

    A vehicle is driven by each record's roads and loads. Exits 1 if an RMS is off by more than --level, an error over
    --limit, setups are ranked otherwise than by the rig, or all records are the fit's own.

    \b
    Examples:
      eightpost validate shock.json data/ --report out.html
      eightpost validate static.json lpnl2.json run7.csv --kind run7.csv=sine --limit 5
      eightpost validate vehicle.json rig/*.parquet --report car.html
      eightpost validate vehicle.json rig/ --shock A=A.json --shock B=B.json --report car.html
    """
