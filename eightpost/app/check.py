"""`eightpost check`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, argument, option, verb
from eightpost.errors import InputError
from eightpost.report.console import Column, Table, console_table, unbroken

if TYPE_CHECKING:
    from builder.check import CheckReport, Finding, Level, NotChecked, Scope

_COLOURS = {"error": "bold red", "drop-in": "yellow", "hint": "cyan"}


@verb
def check(
    ctx: click.Context,
    fmus: tuple[Path, ...] = argument("FMU...", kind=FilePath()),
    standard: bool = option("Report only violations of the FMI standard; default: all findings."),
    as_json: bool = option("Print one JSON document instead of tables (docs/reference/check.md).", "--json"),
) -> None:  # fmt: skip
    """Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.

    The check runs fmpy validate, fmutool -check, more than a hundred rules of its own, and the FMU itself. Findings are
    errors (violations of the FMI standard), drop-in rules (known causes of failed imports into tools) or hints.

    The FMU runs in separate processes, so a crash is a finding. This is not a sandbox: the FMU's code has all your
    permissions. The exit code is 0 if there are no findings except hints, 1 if there are other findings, and 2 if a
    file is not an FMU of FMI 2.0 or 3.0; the other files are reported nevertheless.

    \b
    Examples:
      eightpost check dist/*.fmu
      eightpost check --standard --json supplier.fmu > supplier.json
    """
    from builder.check import CheckReport, NotChecked, Scope, json_document

    scope = Scope.STANDARD if standard else Scope.ALL
    reports: list[CheckReport | NotChecked] = []
    with Console(stderr=True).status("") as status:
        for path in fmus:
            status.update(f"checking {escape(str(path))}")
            reports.append(_checked(path, scope))
    _warn(reports)
    refused = [report for report in reports if isinstance(report, NotChecked)]
    if as_json:
        click.echo(json.dumps(json_document(reports), indent=1))  # ASCII, because a terminal may support nothing else
    else:
        console = Console()
        for report in reports:
            if isinstance(report, CheckReport):
                show_report(console, report)
    for report in refused:
        Console(stderr=True, soft_wrap=True).print(f"[bold red]error:[/] {escape(report.error)}", highlight=False)
    ctx.exit(2 if refused else int(not all(report.acceptable for report in reports)))


def _warn(reports: list[CheckReport | NotChecked]) -> None:
    """Print a note that the FMUs' code was run; on stderr, so that stdout holds only tables or JSON."""
    from builder.check import CheckReport

    if any(isinstance(report, CheckReport) and set(report.groups) - {"static", "tools"} for report in reports):
        text = "check runs the FMU's code in separate processes; this is not a sandbox"
        Console(stderr=True, soft_wrap=True).print(f"note: {text}", highlight=False, style="dim")


def _checked(path: Path, scope: Scope) -> CheckReport | NotChecked:
    """Check a file; a file that cannot be read must not hide the findings in the others."""
    from builder.check import NotChecked
    from builder.check import check as check_fmu

    try:
        return check_fmu(path, scope=scope)
    except InputError as error:
        return NotChecked(path, str(error))


def show_report(console: Console, report: CheckReport, *, with_findings: bool = True) -> None:
    """Print the findings in an FMU by level, the groups that were performed or skipped, and what no check sees."""
    from builder.check import LIMITS, Level
    from eightpost.app.show import details, is_detailed, show_notes, show_text

    console.print(f"{escape(str(report.path))}: {_verdict(report)}", highlight=False, soft_wrap=True)
    more = details(console)
    if not with_findings:
        return
    if report.findings:
        more.print(_table(report))
    if not is_detailed():
        findings = [_sentence(finding) for level in Level for finding in report.of(level)]
        show_notes(console, findings, "finding", most=3)
    show_text(more, f"performed {', '.join(report.groups) or 'nothing'}", begin="  ")
    for skipped in report.skipped:
        show_text(more, f"skipped {skipped.what}: {skipped.reason}", begin="  ")
    show_text(more, LIMITS, begin="  ")


def _sentence(finding: Finding) -> str:
    """Return a finding in a sentence: rule, what is wrong and where, what to do."""
    rule = finding.rule
    return f"{rule.identifier} {rule.title}{': ' if finding.message else ''}{finding.message}; {rule.advice}"


def _verdict(report: CheckReport) -> str:
    from builder.check import Level

    counts = {level: len(report.of(level)) for level in Level}
    parts = [f"[{_COLOURS[level.value]}]{_count(level, number)}[/]" for level, number in counts.items() if number]
    return ", ".join(parts) if parts else "[bold green]clean[/]"


def _count(level: Level, number: int) -> str:
    from builder.check import Level

    names = {Level.ERROR: "error", Level.DROP_IN: "drop-in rule", Level.HINT: "hint"}
    return f"{number} {names[level]}{'' if number == 1 else 's'}"


def _table(report: CheckReport) -> Table:
    from builder.check import Level

    wide = [Column(name, overflow="fold", ratio=ratio) for name, ratio in (("finding", 3), ("what to do", 2))]
    groups = (map(_row, report.of(level)) for level in Level)
    return console_table([*unbroken("level", "rule"), *wide], *groups, expand=True)


def _row(finding: Finding) -> tuple[str, ...]:
    rule, level = finding.rule, finding.rule.level.value
    text = f"{rule.title}: {finding.message}" if finding.message else rule.title
    advice = f"{escape(rule.advice)} [dim]({rule.source})[/]"
    return (f"[{_COLOURS[level]}]{level}[/]", rule.identifier, escape(text), advice)
