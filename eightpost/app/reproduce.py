"""`eightpost reproduce`: finds `dissertation/`, which is part of a checkout and of no wheel, and runs it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import click

import eightpost
from eightpost.app.options import OutputFolder, argument, option, verb
from eightpost.errors import InputError
from eightpost.outputs import PAGE


@verb
def reproduce(
    ctx: click.Context,
    numbers: tuple[str, ...] = argument("[NUMBER]...", required=False),
    everything: bool = option("Reproduce all items of chapters 3 to 7.", "--all"),
    listing: bool = option("List the items and their bases; compute nothing.", "--list"),
    quick: bool = option("Use short records and fewer setups; the levels differ more from print."),
    output: Path = option(
        "Folder for reproduce.html.", "-o", "--output", kind=OutputFolder({"reproduce.html": PAGE}), default=Path("out")
    ),
) -> None:  # fmt: skip
    """Reproduce the dissertation's figures, tables and equations.

    A NUMBER is that of a figure, a table or an equation (7.2 is the figure and the table), of one of them
    (table-7.2, figure-7.2, equation-6.8), or of a chapter (4). The page reproduce.html has the printed values beside
    ours and the difference in words; docs/evidence/equations.md lists the code. Measured data that were never published
    are replaced by the virtual rigs, which each such item states.

    The items are in the folder dissertation/ of a checkout of eightpost; an installed wheel does not contain them.

    The exit code is 1 if an item differs from print by more than its stated tolerance, and 2 if a number is unknown or
    there is no checkout.

    \b
    Examples:
      eightpost reproduce 4.2
      eightpost reproduce table-7.1 equation-6.8 -o out/
      eightpost reproduce --all
      eightpost reproduce --list
    """
    if not (Path(eightpost.__file__).resolve().parents[1] / "dissertation" / "command.py").is_file():
        raise InputError(
            "the reproduction of the dissertation is in the folder dissertation/ of the source distribution and the "
            "repository of eightpost, not in its wheel: download one of them and run eightpost reproduce there, after "
            "pip install -e .[all]"
        )
    command = import_module("dissertation.command")
    ctx.exit(command.run(numbers, output, everything=everything, listing=listing, quick=quick))
