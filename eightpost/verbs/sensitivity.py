"""The options of `eightpost sensitivity`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False),
              help="Every term as a table (.parquet); default sensitivity.parquet in the study's folder.")  # fmt: skip
@body
def sensitivity() -> None:
    """Show which corner matters for which measure of a study: main effects and first-order interactions.

    STUDY is a folder that `eightpost study` wrote. What is shown are shares of each measure's variance over all setups;
    they are exact where every setup was run, and fitted by least squares where some are missing.

    \b
    Example:
      eightpost sensitivity out/
    """
