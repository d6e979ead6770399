"""`eightpost validate`: fitted shocks or an identified vehicle on held-out records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.commands.validate_paths import is_vehicle, pair, sorted_paths
from eightpost.errors import InputError
from eightpost.signals import ChannelMap
from eightpost.verbs.validate import SETTLING

if TYPE_CHECKING:
    from collections.abc import Mapping


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
    """Validate fitted shocks or an identified vehicle on held-out records."""
    console = Console()
    models, records = sorted_paths(paths)
    if report and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: a report ends in .html; write --report {report.with_suffix('.html')}")
    channel_map = ChannelMap.read(map_file) if map_file else None
    units = dict(pair(word, "--units") for word in unit_words)
    if is_vehicle(models):
        _refuse("vehicle", {"--configuration": configurations, "--cutoff": cutoff})
        from eightpost.commands import validate_vehicle as vehicles  # noqa: PLC0415 - shocks do not need it

        limits = vehicles.limits_of(level, limit)
        settled = SETTLING if settling is None else settling
        car = vehicles.VehicleOptions(kinds, shock_words, against, limits, settled, units, channel_map, flip, keep)
        ctx.exit(0 if vehicles.validate_one(console, models[0], records, car, report).is_acceptable else 1)
    _refuse("shock", {"--level": level, "--shock": shock_words, "--against": against, "--settling": settling})
    from eightpost.commands import validate_shock as shocks  # noqa: PLC0415 - a vehicle does not need it

    options = shocks.ShockOptions(kinds, configurations, limit, cutoff, units, channel_map, flip, keep)
    ctx.exit(0 if shocks.validate_shocks(console, models, records, options, report).is_acceptable else 1)


def _refuse(kind: str, given: Mapping[str, object]) -> None:
    """Refuse options that do not apply to the kind of model."""
    for option, value in given.items():
        if value not in (None, ()):
            raise click.BadParameter(f"it does not apply to a {kind}; omit it", param_hint=option)
