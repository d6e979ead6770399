"""The options of `eightpost demo`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("demo"), show_default=True,
              help="Folder for everything that the demo makes.")  # fmt: skip
@body
def demo() -> None:
    """Run the whole line on shipped data: fit, build, check, couple, swap a shock, measure, try every setup.

    The dynamometer records and the track are SYNTHETIC: examples/make_demo_data.py computes them.
    """
