"""`eightpost settings`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, LawName, OutputFile, Quantity, Verb
from eightpost.outputs import PICTURE, SHOCK

if TYPE_CHECKING:
    from eightpost.ident.shock.settings import SettingsFit


@click.command(cls=Verb)
@click.argument("table", metavar="TABLE|DYNO...", nargs=-1, required=True, type=FilePath())
@click.option("-o", "--output", type=OutputFile(SHOCK, default=lambda given: Path(f"{given['table'][0].stem}.json")),
              help="Output shock file; default: the name of TABLE with the suffix .json, in the current "
              "folder.")  # fmt: skip
@click.option("--law", type=LawName(), help="Shock law to fit; default: that of TABLE, else hysteresis.")
@click.option("--segment", nargs=2, type=Quantity("s"), metavar="START STOP",
              help="Start and end of the part of each record to fit; default '1 s' '10 s'.")  # fmt: skip
@click.option("--cutoff", type=Quantity("Hz"), metavar="FREQUENCY",
              help="Cut-off frequency of the low-pass on model and data; default '50 Hz'.")  # fmt: skip
@click.option("--plot", type=OutputFile(PICTURE, default=lambda given: given["output"].with_suffix(".png")),
              help="Picture of the click map; default: the output file with the suffix .png.")  # fmt: skip
@click.pass_context
def settings(  # one parameter per option
    ctx: click.Context,
    table: tuple[Path, ...],
    output: Path,
    law: str | None,
    segment: tuple[float, float] | None,
    cutoff: float | None,
    plot: Path,
) -> None:
    """Fit a shock over its adjusters and temperature: one model from the files of several settings.

    TABLE is a TOML file that lists dynamometer files with the clicks of each adjuster, the valving or the temperature
    (docs/how_to/settings.md). Without a table, the settings are read from the names of the files DYNO (2clicks.csv,
    1.5A.csv). All files are fitted together. The FMU of the shock has the clicks and the temperature as
    parameters. The exit code is 1 if the shock is not usable (docs/reference/verdict.md).

    \b
    Examples:
      eightpost settings rebound.toml -o shock.json
      eightpost settings 0.3A.csv 0.9A.csv 1.6A.csv -o shock.json
      eightpost settings rebound.toml --law lpf1 -o shock.json --plot click_map.png
      eightpost build shock.json -o dist/
    """
    from eightpost.ident.shock.plots import plot_click_map
    from eightpost.ident.shock.settings import fit_settings
    from eightpost.ident.shock.settings_table import read_settings_table, settings_of_names
    from eightpost.shock import write_shock

    console = Console()
    if len(table) == 1 and table[0].suffix.lower() == ".toml":
        given = read_settings_table(table[0], cutoff=cutoff)
    else:
        given = settings_of_names(table, cutoff=cutoff)
    for note in given.notes:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    fit = fit_settings(given, law=law, segment=segment, cutoff=cutoff)
    _show(console, fit)
    write_shock(fit.shock, output)
    plot_click_map(fit.shock, plot)
    console.print(f"wrote {output}, {plot}", soft_wrap=True, highlight=False)
    ctx.exit(0 if fit.verdict.is_acceptable else 1)


def _show(console: Console, fit: SettingsFit) -> None:
    """Print the errors of each setting, the changes and the verdict."""
    from eightpost.app.show import show_verdict
    from eightpost.ident.shock.settings import settings_table

    console.print(settings_table(fit))
    for change in fit.shock.fit["changes"]:
        console.print(f"[yellow]changed[/] {escape(change)}", highlight=False, soft_wrap=True)
    show_verdict(console, fit.verdict)
