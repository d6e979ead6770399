"""Options of `eightpost validate`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

#: Settling time at the start of a vehicle's records, which is left out [s].
SETTLING = 4.0


@click.command()
@click.argument("paths", metavar="JSON... RECORD...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--kind", "kinds", metavar="[FILE=]KIND", multiple=True,
              help="Kind of a record, or of all: random, sine, static or bump. Default: recognized from the "
              "motion.")  # fmt: skip
@click.option("--configuration", "configurations", metavar="[FILE=]N", multiple=True,
              help="Shocks: configuration of a record, or of all: 1 to 12 of Table 3.1. Default: none.")  # fmt: skip
@click.option("--limit", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Maximum error [% of the measured standard deviation]; the exit code is 1 above it. Default: "
              "vehicles 25, shocks 30.")  # fmt: skip
@click.option("--level", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Vehicles: maximum error of an RMS on random records [%]; the exit code is 1 above it. Default "
              "5.")  # fmt: skip
@click.option("--shock", "shock_words", metavar="CORNER|NAME=SHOCK.JSON", multiple=True,
              help="Vehicles: law at a corner (lf, rf, lr, rr), or of the shock that has this name in the records. "
              "Default: the measured shock forces.")  # fmt: skip
@click.option("--against", metavar="CAR", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Vehicles: another fit (.json) or parameters (.toml) whose modes are listed for comparison; "
              "default: none.")  # fmt: skip
@click.option("--settling", metavar="SECONDS", type=click.FloatRange(min=0.0),
              help="Vehicles: settling time left out at the start of each record [s], at most 1/4 of the record; "
              f"default {SETTLING:g}.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.HTML",
              help="Interactive, printable page to write (docs/validation.md); default: none.")  # fmt: skip
@click.option("--keep", is_flag=True,
              help="Write the verdict into the shock or vehicle files and replace an earlier one. FMUs built from "
              "these files carry the verdict into every run.")  # fmt: skip
@click.option("--cutoff", type=float, metavar="HZ",
              help="Shocks: cut-off frequency of the low-pass [Hz]; default 50, for bumps 200.")  # fmt: skip
@click.option("--units", "unit_words", metavar="CHANNEL=UNIT", multiple=True,
              help="Unit of a channel whose header names none, e.g. force=lbf; may be repeated.")  # fmt: skip
@click.option("--map", "map_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map of all records (docs/signs_and_units.md); default: the channel names in the "
              "files.")  # fmt: skip
@click.option("--flip", multiple=True, metavar="CHANNEL",
              help="Reverse the sign of a channel in all records, e.g. force; may be repeated.")  # fmt: skip
@body
def validate() -> None:
    """Validate fitted shocks or an identified vehicle on held-out records.

    JSON files are shocks, or one vehicle. A RECORD is a dynamometer or rig record, or a folder of records.

    Each shock is compared with each record, unless both state a condition and the conditions differ. The exit code is 1
    if the verdict is "not usable" (docs/verdict.md): more than a fifth of a record is outside the fitted velocities, a
    record has no shock, or an error is above --limit.

    A vehicle is driven by each record's roads and loads. The exit code is 1 if an RMS differs by more than --level, an
    error is above --limit, the ranking of setups differs from that of the rig, or all records were used in the fit.

    \b
    Examples:
      eightpost validate shock.json data/ --report out.html
      eightpost validate static.json lpnl2.json run7.csv --kind run7.csv=sine --limit 5
      eightpost validate vehicle.json rig/*.parquet --report car.html
      eightpost validate vehicle.json rig/ --shock A=A.json --shock B=B.json --report car.html
    """
