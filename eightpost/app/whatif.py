"""`eightpost study whatif`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, Quantity, argument, option, setting, verb
from eightpost.app.study import saved
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from cosim.study.choice.sensitivity import MeasureChange


@verb
def whatif(
    folder: Path = argument("STUDY", kind=FilePath()),
    corners: tuple[str, ...] = option(
        "Corner whose shock changes, e.g. lr; may be repeated.",
        "--at", default=..., metavar="CORNER",
    ),
    rebound: int = option("Clicks of the rebound adjuster, e.g. +1; default: 0.", default=0, metavar="CLICKS"),
    compression: int = option("Clicks of the compression adjuster, e.g. -2; default: 0.", default=0, metavar="CLICKS"),
    setup: int | None = option("Setup to change; default: the baseline, or else the best setup.", metavar="NUMBER"),
    share: float = setting(
        "Change of the slope that counts as a click, for shocks without a fitted adjuster.",
        "click", kind=Quantity("1", positive=True), default="5 %",
    ),
    speeds: str = setting(
        "Speeds at which the slope changes, for shocks without a fitted adjuster; low and high overlap near 0.1 m/s.",
        kind=("low", "high", "all"), default="low",
    ),
    workers: int | None = setting("Number of processes that run setups; default: 1.", kind=click.IntRange(min=1)),
) -> None:  # fmt: skip
    """Show what a click more or less at a corner would do to every measure of a study.

    STUDY is a folder that `eightpost study` wrote. The setup is run with and without the change. A shock that was
    fitted over its adjusters (docs/how_to/settings.md) changes its setting, counted as in its file; for others a click
    changes the slope of the curve on that side by a stated share, and + is stiffer. Changes that are within the
    coupling error of a run are in brackets.

    \b
    Examples:
      eightpost study whatif out/ --at lr --rebound +1
      eightpost study whatif out/ --at lf --at rf --compression -2 --set click='10 %' --set speeds=high
    """
    from eightpost.app.show import show_table

    clicks = {side: count for side, count in (("rebound", rebound), ("compression", compression)) if count}
    study = saved(console := Console(), folder, workers)
    show_table(console, effect_table(study.what_if(corners, clicks, share=share, speeds=speeds, setup=setup)))


def effect_table(effects: Sequence[MeasureChange]) -> Table:
    """Return a table of effects; a change that is within the coupling error is in brackets."""
    rows = []
    for one in effects:
        change = f"{one.change:+.3g}"
        relative = "" if one.before == 0.0 else f"{100.0 * one.relative:+.2f} %"
        shown = (change, relative) if one.is_clear else (f"({change})", f"({relative})" if relative else "")
        name = f"{one.measure} [{one.unit}]" if one.unit else one.measure
        rows.append((escape(name), f"{one.before:.5g}", f"{one.after:.5g}", *shown, f"{one.noise:.1g}"))
    return console_table(["measure", "before", "after", "change", "relative", "coupling error"], rows)
