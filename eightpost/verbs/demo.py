"""Options of `eightpost demo`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("demo"), show_default=True,
              help="Output folder for all files of the demo.")  # fmt: skip
@body
def demo() -> None:
    """Run the whole workflow on shipped data: fit, build, check, couple, swap a shock, measure, run every setup.

    The dynamometer records and the track are SYNTHETIC: examples/make_demo_data.py computes them.
    """
