"""`eightpost validate`: fitted shocks or an identified vehicle on held-out records."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.signals import ChannelMap

import click
from rich.console import Console

from eightpost.app.options import UNITS, Assignment, Quantity, flip_option, map_option
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
@click.option("--shock", "shocks", type=Assignment("NAME=SHOCK.json"), metavar="CORNER|NAME=SHOCK.JSON", multiple=True,
              help="Vehicles: law at a corner (lf, rf, lr, rr), or of the shock that has this name in the records. "
              "Default: the measured shock forces.")  # fmt: skip
@click.option("--against", metavar="CAR", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Vehicles: another fit (.json) or parameters (.toml) whose modes are listed for comparison; "
              "default: none.")  # fmt: skip
@click.option("--settling", metavar="TIME", type=Quantity("s", bare=True),
              help="Vehicles: settling time left out at the start of each record, at most 1/4 of the record; default "
              f"'{SETTLING:g} s'.")  # fmt: skip
@click.option("--report", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.HTML",
              help="Interactive, printable page to write (docs/validation.md); default: none.")  # fmt: skip
@click.option("--keep", is_flag=True,
              help="Write the verdict into the shock or vehicle files and replace an earlier one. FMUs built from "
              "these files carry the verdict into every run.")  # fmt: skip
@click.option("--cutoff", type=Quantity("Hz", bare=True), metavar="FREQUENCY",
              help="Shocks: cut-off frequency of the low-pass; default '50 Hz', for bumps '200 Hz'.")  # fmt: skip
@UNITS
@map_option("docs/signs_and_units.md")
@flip_option("force")
@click.pass_context
def validate(  # one parameter per option
    ctx: click.Context,
    paths: tuple[Path, ...],
    kinds: tuple[str, ...],
    configurations: tuple[str, ...],
    limit: float | None,
    level: float | None,
    shocks: tuple[tuple[str, str], ...],
    against: Path | None,
    settling: float | None,
    report: Path | None,
    keep: bool,
    cutoff: float | None,
    units: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
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
    from eightpost.app.validate_paths import is_vehicle, sorted_paths

    console = Console()
    models, records = sorted_paths(paths)
    if report and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a report ends in .html; write --report {report.with_suffix('.html')}")
    if settling is not None and settling < 0.0:
        raise InputError(f"--settling must be 0 or more, not {settling:g} s")
    if is_vehicle(models):
        _refuse("vehicle", {"--configuration": configurations, "--cutoff": cutoff})
        from eightpost.app import validate_vehicle as vehicles

        limits = vehicles.limits_of(level, limit)
        settled = SETTLING if settling is None else settling
        car = vehicles.VehicleOptions(
            kinds, dict(shocks), against, limits, settled, dict(units), channel_map, flip, keep
        )
        ctx.exit(0 if vehicles.validate_one(console, models[0], records, car, report).is_acceptable else 1)
    _refuse("shock", {"--level": level, "--shock": shocks, "--against": against, "--settling": settling})
    from eightpost.app.validate_shock import ShockOptions, validate_all

    options = ShockOptions(kinds, configurations, limit, cutoff, dict(units), channel_map, flip, keep)
    ctx.exit(0 if validate_all(console, models, records, options, report).is_acceptable else 1)


def _refuse(kind: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not apply to the kind of model."""
    for option, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it does not apply to a {kind}; omit it", param_hint=option)
