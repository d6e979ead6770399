"""`eightpost clicks`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import Assignment, FilePath, OutputFile, Quantity, Verb
from eightpost.errors import InputError
from eightpost.outputs import PICTURE

if TYPE_CHECKING:
    from eightpost.ident.shock.clicks import Level


@click.command(cls=Verb)
@click.argument("shock_file", metavar="SHOCK", type=FilePath())
@click.option("--curve", required=True, type=FilePath(), metavar="FILE",
              help="Target: a table with the columns velocity and force and their units, or a shock file.")  # fmt: skip
@click.option("--fix", multiple=True, type=Assignment("ADJUSTER=CLICKS"), metavar="ADJUSTER=CLICKS",
              help="Setting of an adjuster that is not searched, e.g. rebound=12; may be repeated.")  # fmt: skip
@click.option("--temperature", type=Quantity("K"), metavar="TEMPERATURE",
              help="Temperature at which the target is to be reached, e.g. '60 degC'; default: the "
              "reference.")  # fmt: skip
@click.option("--speeds", nargs=2, type=Quantity("m/s"), metavar="LOW HIGH",
              help="Lowest and highest speed that count, e.g. '0 m/s' '0.2 m/s'; default: all measured "
              "speeds.")  # fmt: skip
@click.option("--level", type=click.Choice(["free", "kept"]), default="kept", show_default=True,
              help="Treatment of a constant force over all speeds, such as gas force. kept: it counts as an error. "
              "free: it does not.")  # fmt: skip
@click.option("--count", type=click.IntRange(1, 100), default=5, show_default=True, metavar="N",
              help="Number of settings to list.")  # fmt: skip
@click.option("--plot", type=OutputFile(PICTURE),
              help="Picture of the target and the best setting; no default: none is written.")  # fmt: skip
def clicks(  # one parameter per option
    shock_file: Path,
    curve: Path,
    fix: tuple[tuple[str, str], ...],
    temperature: float | None,
    speeds: tuple[float, float] | None,
    level: Level,
    count: int,
    plot: Path | None,
) -> None:
    """Find the clicks at which a shock comes closest to a target curve.

    SHOCK is a shock file of `eightpost settings`. All combinations of whole clicks are compared with the target. The
    list shows the remaining error in each range of speeds, and which settings are equal within the band of the model.

    \b
    Examples:
      eightpost clicks shock.json --curve target.csv
      eightpost clicks shock.json --curve other_shock.json --speeds '0 m/s' '0.2 m/s' --plot target.png
      eightpost clicks shock.json --curve target.csv --fix compression=8
    """
    from eightpost.ident.shock.clicks import best_clicks, read_target
    from eightpost.ident.shock.plots import answer_table, plot_answer
    from eightpost.shock import read_shock

    console = Console()
    shock, target = read_shock(shock_file), read_target(curve)
    fixed = {name: _number(name, text) for name, text in fix}
    if temperature is not None:
        fixed["temperature"] = temperature
    answer = best_clicks(shock, target, fixed=fixed, speeds=speeds, level=level, count=count)
    console.print(answer_table(answer))
    for note in answer.notes:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    if answer.is_reachable:
        console.print(f"[green]the target can be reached[/]: {escape(answer.best.text)}", highlight=False)
    for sentence in answer.unreachable:
        console.print(f"[yellow]not reached[/] {escape(sentence)}", highlight=False, soft_wrap=True)
    if plot is not None:
        plot_answer(shock, target, answer, plot)
        console.print(f"wrote {plot}", soft_wrap=True, highlight=False)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--fix {name}={text}: {text!r} is not a number of clicks") from None
