"""`eightpost build`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column, Table

from builder.build import Built
from builder.build import build as build_fmus
from builder.documents import Disclosure
from eightpost.commands.assemble import assemble_with_progress, show_assembled
from eightpost.commands.show_verdict import show_verdict
from eightpost.verdict import Verdict


@click.pass_context
def build(
    ctx: click.Context, /, sources: tuple[Path, ...], output: Path, target: str, confidential: bool, system: Path | None
) -> None:
    """Build an FMI 2.0 co-simulation FMU from each source."""
    console = Console()
    if system is not None:
        if sources or confidential or target != "native":
            raise click.UsageError("--assemble builds one system file: omit SOURCES, --confidential and --target")
        show_assembled(console, assemble_with_progress(console, system, output))
        return
    if not sources:
        raise click.UsageError("Missing argument 'SOURCES...'.")
    disclosure = Disclosure.CONFIDENTIAL if confidential else Disclosure.FULL
    verdict = show_built(console, build_with_progress(console, sources, output, target=target, disclosure=disclosure))
    ctx.exit(0 if verdict.is_acceptable else 1)


def build_with_progress(
    console: Console,
    sources: Sequence[str | Path],
    output: Path,
    *,
    target: str = "native",
    disclosure: Disclosure = Disclosure.FULL,
) -> list[Built]:
    """Build with a progress bar, because a first build compiles for all platforms."""
    columns = (TextColumn("compiling"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)
        return build_fmus(
            sources,
            output,
            target=target,
            disclosure=disclosure,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )


def show_built(console: Console, built: list[Built]) -> Verdict:
    """Print a table of the FMUs and the verdict that they carry; return the verdict."""
    table = Table(Column("FMU", overflow="fold"), "interface", "target", "inputs", "outputs", "parameters", "size")
    for item in built:
        counts = [str(len(item.interface.names(causality))) for causality in ("input", "output", "parameter")]
        kind = f"{item.interface.kind} {item.interface.version}"
        table.add_row(str(item.path), kind, item.target, *counts, f"{item.path.stat().st_size / 1024:.0f} KiB")
    console.print(table)
    for limits in dict.fromkeys(item.limits for item in built if item.limits):
        console.print(f"[yellow]note[/] {escape(limits)}")
    verdict = Verdict(
        replace(reason, origin=f"{item.path.name}: {reason.origin}")
        for item in built
        for reason in item.validity.verdict.reasons
    )
    show_verdict(console, verdict)
    return verdict
