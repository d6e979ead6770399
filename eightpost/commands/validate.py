"""`eightpost validate`: fitted shocks or an identified vehicle against records that they were not fitted to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.commands.validate_paths import is_vehicle, pair, sorted_paths
from eightpost.errors import InputError
from eightpost.signals import ChannelMap

if TYPE_CHECKING:
    from collections.abc import Mapping

_SETTLING = 4.0


@click.command()
@click.argument("paths", metavar="JSON... RECORD...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--kind", "kinds", metavar="[FILE=]KIND", multiple=True,
              help="random, sine, static or bump, of one file or of all; default: seen from the motion.")  # fmt: skip
@click.option("--configuration", "configurations", metavar="[FILE=]N", multiple=True,
              help="Shocks: configuration 1 to 12 of Table 3.1, of one file or of all.")  # fmt: skip
@click.option("--limit", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Highest error, in percent of the measured standard deviation; more exits 1. "
              "Default: of vehicles 25.")  # fmt: skip
@click.option("--level", metavar="PERCENT", type=click.FloatRange(min=0.0, min_open=True),
              help="Vehicles: largest error of an RMS on random records; more exits 1. Default: 5.")  # fmt: skip
@click.option("--shock", "shock_words", metavar="CORNER|NAME=SHOCK.JSON", multiple=True,
              help="Vehicles: the law at a corner (lf, rf, lr, rr), or of the shock that records call so; else the "
              "measured shock forces are taken.")  # fmt: skip
@click.option("--against", metavar="CAR", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Vehicles: another fit (.json) or parameters (.toml) whose modes stand beside.")  # fmt: skip
@click.option("--settling", metavar="SECONDS", type=click.FloatRange(min=0.0),
              help=f"Vehicles: left out at the start of records, at most 1/4; default {_SETTLING:g}.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.HTML",
              help="Write one interactive, printable page (docs/validation.md).")  # fmt: skip
@click.option("--cutoff", type=float, metavar="HZ", help="Shocks: low-pass [Hz]; default 50, of bumps 200.")
@click.option("--units", "unit_words", metavar="CHANNEL=UNIT", multiple=True, help="Unit of a channel without one.")
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (.toml) of all records.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn the sign of a channel of all records.")
@click.pass_context
def validate(  # one parameter per option
    ctx: click.Context,
    paths: tuple[Path, ...],
    kinds: tuple[str, ...],
    configurations: tuple[str, ...],
    limit: float | None,
    level: float | None,
    shock_words: tuple[str, ...],
    against: Path | None,
    settling: float | None,
    report: Path | None,
    cutoff: float | None,
    unit_words: tuple[str, ...],
    map_file: Path | None,
    flip: tuple[str, ...],
) -> None:
    """Validate fitted shocks or an identified vehicle on records that they were not fitted to.

    Files that end in .json are shocks, or one vehicle; all others are dynamometer or rig records. A folder stands for
    the records in it.

    Each shock is held against each record, unless both say a condition and they differ. Exits 1 if more than half of a
    record is outside the fitted velocities, if a record has no shock, or if an error is over --limit.

    A vehicle is driven by each record's roads and loads. Exits 1 if an RMS is off by more than --level, an error over
    --limit, setups are ranked otherwise than by the rig, or all records are the fit's own.

    \b
    Examples:
      eightpost validate shock.json data/ --report out.html
      eightpost validate static.json lpnl2.json run7.csv --kind run7.csv=sine --limit 5
      eightpost validate vehicle.json rig/*.parquet --report car.html
      eightpost validate vehicle.json rig/ --shock A=A.json --shock B=B.json --report car.html
    """
    console = Console()
    models, records = sorted_paths(paths)
    if report and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a report ends in .html; write --report {report.with_suffix('.html')}")
    channel_map = ChannelMap.read(map_file) if map_file else None
    units = dict(pair(word, "--units") for word in unit_words)
    if is_vehicle(models):
        _refuse("vehicle", {"--configuration": configurations, "--cutoff": cutoff})
        from eightpost.commands import validate_vehicle as vehicles  # noqa: PLC0415 - shocks need none of it

        limits = vehicles.limits_of(level, limit)
        wait = _SETTLING if settling is None else settling
        car = vehicles.VehicleOptions(kinds, shock_words, against, limits, wait, units, channel_map, flip)
        ctx.exit(0 if vehicles.validate_one(console, models[0], records, car, report) else 1)
    _refuse("shock", {"--level": level, "--shock": shock_words, "--against": against, "--settling": settling})
    from eightpost.commands import validate_shock as shocks  # noqa: PLC0415 - a vehicle needs none of it

    options = shocks.ShockOptions(kinds, configurations, limit, cutoff, units, channel_map, flip)
    ctx.exit(0 if shocks.validate_shocks(console, models, records, options, report) else 1)


def _refuse(what: str, given: Mapping[str, object]) -> None:
    """Refuse options that say nothing to what is validated."""
    for option, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it says nothing to a {what}; leave it away", param_hint=option)
