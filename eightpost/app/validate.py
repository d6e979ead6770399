"""`eightpost validate`: fitted shocks or an identified vehicle on held-out records."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click
from rich.console import Console

from eightpost.errors import InputError

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
    keep: bool,
    cutoff: float | None,
    unit_words: tuple[str, ...],
    map_file: Path | None,
    flip: tuple[str, ...],
) -> None:
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
    from eightpost.app.validate_paths import is_vehicle, pair, sorted_paths
    from eightpost.signals import ChannelMap

    console = Console()
    models, records = sorted_paths(paths)
    if report and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a report ends in .html; write --report {report.with_suffix('.html')}")
    channel_map = ChannelMap.read(map_file) if map_file else None
    units = dict(pair(word, "--units") for word in unit_words)
    if is_vehicle(models):
        _refuse("vehicle", {"--configuration": configurations, "--cutoff": cutoff})
        from eightpost.app import validate_vehicle as vehicles

        limits = vehicles.limits_of(level, limit)
        settled = SETTLING if settling is None else settling
        car = vehicles.VehicleOptions(kinds, shock_words, against, limits, settled, units, channel_map, flip, keep)
        ctx.exit(0 if vehicles.validate_one(console, models[0], records, car, report).is_acceptable else 1)
    _refuse("shock", {"--level": level, "--shock": shock_words, "--against": against, "--settling": settling})
    from eightpost.app import validate_shock as shocks

    options = shocks.ShockOptions(kinds, configurations, limit, cutoff, units, channel_map, flip, keep)
    ctx.exit(0 if shocks.validate_shocks(console, models, records, options, report).is_acceptable else 1)


def _refuse(kind: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not apply to the kind of model."""
    for option, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it does not apply to a {kind}; omit it", param_hint=option)
