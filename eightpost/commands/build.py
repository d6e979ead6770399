"""`eightpost build`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Column, Table

from builder.build import TARGETS, Built
from builder.build import build as build_fmus


@click.command()
@click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("dist"), show_default=True,
              help="Folder for the FMUs.")  # fmt: skip
@click.option("--target", type=click.Choice(TARGETS), default="python", show_default=True,
              help="python: needs a Python host with numpy and scipy; the readable reference.")  # fmt: skip
def build(sources: tuple[Path, ...], output: Path, target: str) -> None:
    """Build an FMI 2.0 co-simulation FMU from each source.

    SOURCES are shock files (eightpost fit) and vehicle files: parameters (.toml) or an identified state space (.json).
    An FMU is named after its source; the same source gives the same bytes.

    \b
    Example:
      eightpost build shock.json car.toml -o dist/
    """
    show_built(Console(), build_fmus(sources, output, target=target))


def show_built(console: Console, built: list[Built]) -> None:
    """Print a table of what was built."""
    table = Table(Column("FMU", overflow="fold"), "interface", "inputs", "outputs", "parameters", "size")
    for item in built:
        counts = [str(len(item.interface.names(causality))) for causality in ("input", "output", "parameter")]
        kind = f"{item.interface.kind} {item.interface.version}"
        table.add_row(str(item.path), kind, *counts, f"{item.path.stat().st_size / 1024:.0f} KiB")
    console.print(table)
