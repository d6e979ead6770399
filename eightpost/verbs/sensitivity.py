"""Options of `eightpost sensitivity`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False),
              help="Output table of all terms (.parquet); default: sensitivity.parquet in the folder of the "
              "study.")  # fmt: skip
@body
def sensitivity() -> None:
    """Show which corner matters for which measure of a study: main effects and first-order interactions.

    STUDY is a folder that `eightpost study` wrote. The table shows shares of each measure's variance over all setups.
    The shares are exact if every setup was run; if setups are missing, they are fitted by least squares.

    \b
    Example:
      eightpost sensitivity out/
    """
