"""`eightpost study clicks`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.app.options import Assignment, FilePath, OutputFile, Quantity, argument, option, setting, verb
from eightpost.errors import InputError
from eightpost.outputs import PICTURE

if TYPE_CHECKING:
    from eightpost.ident.shock.clicks import Level


@verb
def clicks(
    shock_file: Path = argument("SHOCK", kind=FilePath()),
    curve: Path = option(
        "Target: a table with the columns velocity and force and their units, or a shock file.",
        kind=FilePath(), default=..., metavar="FILE",
    ),
    fix: tuple[tuple[str, str], ...] = option(
        "Setting of an adjuster that is not searched, e.g. rebound=12; may be repeated.",
        kind=Assignment("ADJUSTER=CLICKS"), metavar="ADJUSTER=CLICKS",
    ),
    plot: Path | None = option(
        "Picture of the target and the best setting; no default: none is written.",
        kind=OutputFile(PICTURE),
    ),
    temperature: float | None = setting(
        "Temperature at which the target is to be reached, e.g. '60 degC'; default: the reference.",
        kind=Quantity("K"),
    ),
    speeds: tuple[float, float] | None = setting(
        "Lowest and highest speed that count, e.g. speeds='0 m/s, 0.2 m/s'; default: all measured speeds.",
        kind=Quantity("m/s"), nargs=2,
    ),
    level: Level = setting(
        "Treatment of a constant force over all speeds, such as gas force. kept: it counts as an error. free: it does "
        "not.",
        kind=("free", "kept"), default="kept",
    ),
    count: int = setting("Number of settings to list.", kind=click.IntRange(1, 100), default=5),
) -> None:  # fmt: skip
    """Find the clicks at which a shock comes closest to a target curve.

    SHOCK is a shock that `eightpost fit` fitted over its settings. All combinations of whole clicks are compared with
    the target. The list shows the remaining error in each range of speeds, and which settings are equal within the band
    of the model.

    \b
    Examples:
      eightpost study clicks shock.json --curve target.csv
      eightpost study clicks shock.json --curve other_shock.json --set speeds='0 m/s, 0.2 m/s' --plot target.png
      eightpost study clicks shock.json --curve target.csv --fix compression=8
    """
    from eightpost.app.show import show_files, show_notes, show_table, show_text
    from eightpost.ident.shock.clicks import best_clicks, read_target
    from eightpost.ident.shock.plots import answer_table, plot_answer
    from eightpost.shock import read_shock

    console = Console()
    shock, target = read_shock(shock_file), read_target(curve)
    fixed = {name: _number(name, text) for name, text in fix}
    if temperature is not None:
        fixed["temperature"] = temperature
    answer = best_clicks(shock, target, fixed=fixed, speeds=speeds, level=level, count=count)
    show_table(console, answer_table(answer), most=min(count, 5))
    show_notes(console, answer.notes, most=1)
    if answer.is_reachable:
        show_text(console, f"the target can be reached: {answer.best.text}", style="green")
    show_notes(console, answer.unreachable, "not reached", most=1)
    if plot is not None:
        plot_answer(shock, target, answer, plot)
        show_files(console, [plot])


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--fix {name}={text}: {text!r} is not a number of clicks") from None
