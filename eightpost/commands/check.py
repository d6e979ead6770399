"""`eightpost check`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from builder.check import CheckReport
from builder.check import check as check_fmu


@click.command()
@click.argument("fmus", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.pass_context
def check(ctx: click.Context, fmus: tuple[Path, ...]) -> None:
    """Check FMUs, ours or not: fmpy validate, fmutool -check, and a short simulation.

    Exits 1 if anything is found.

    \b
    Example:
      eightpost check dist/*.fmu
    """
    reports = [check_fmu(path) for path in fmus]
    console = Console(soft_wrap=True)
    for report in reports:
        show_report(console, report)
    ctx.exit(1 if any(report.findings for report in reports) else 0)


def _count(number: int) -> str:
    return "1 finding" if number == 1 else f"{number} findings"


def show_report(console: Console, report: CheckReport) -> None:
    """Print what was done to an FMU and what was found."""
    verdict = f"[bold red]{_count(len(report.findings))}[/]" if report.findings else "[bold green]clean[/]"
    console.print(f"{escape(str(report.path))}: {verdict}")
    for what in report.done:
        console.print(f"  did    {escape(what)}", highlight=False)
    for finding in report.findings:
        console.print(f"  [red]found[/]  {finding.source}: {escape(finding.message)}", highlight=False)
