"""`eightpost whatif`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import WORKERS, FilePath, Quantity, Verb
from eightpost.app.study import saved
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from cosim.study.choice.sensitivity import MeasureChange


@click.command(cls=Verb)
@click.argument("folder", metavar="STUDY", type=FilePath())
@click.option("--at", "corners", multiple=True, required=True, metavar="CORNER",
              help="Corner whose shock changes, e.g. lr; may be repeated.")  # fmt: skip
@click.option("--rebound", type=int, default=0, metavar="CLICKS",
              help="Clicks of the rebound adjuster, e.g. +1; default: 0.")  # fmt: skip
@click.option("--compression", type=int, default=0, metavar="CLICKS",
              help="Clicks of the compression adjuster, e.g. -2; default: 0.")  # fmt: skip
@click.option("--click", "share", type=Quantity("1", positive=True), default="5 %", show_default=True, metavar="SHARE",
              help="Change of the slope that counts as a click, for shocks without a fitted adjuster.")  # fmt: skip
@click.option("--speeds", type=click.Choice(["low", "high", "all"]), default="low", show_default=True,
              help="Speeds at which the slope changes, for shocks without a fitted adjuster; low and high overlap near "
              "0.1 m/s.")  # fmt: skip
@click.option("--setup", type=int, metavar="NUMBER",
              help="Setup to change; default: the baseline, or else the best setup.")  # fmt: skip
@WORKERS
def whatif(
    folder: Path,
    corners: tuple[str, ...],
    rebound: int,
    compression: int,
    share: float,
    speeds: str,
    setup: int | None,
    workers: int | None,
) -> None:
    """Show what a click more or less at a corner would do to every measure of a study.

    STUDY is a folder that `eightpost study` wrote. The setup is run with and without the change. A shock that was
    fitted over its adjusters (`eightpost settings`) changes its setting, counted as in its file; for others a click
    changes the slope of the curve on that side by a stated share, and + is stiffer. Changes that are within the
    coupling error of a run are in brackets.

    \b
    Examples:
      eightpost whatif out/ --at lr --rebound +1
      eightpost whatif out/ --at lf --at rf --compression -2 --click '10 %' --speeds high
    """
    console = Console()
    clicks = {side: count for side, count in (("rebound", rebound), ("compression", compression)) if count}
    study = saved(console, folder, workers)
    console.print(effect_table(study.what_if(corners, clicks, share=share, speeds=speeds, setup=setup)))


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
