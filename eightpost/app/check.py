"""`eightpost check`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, argument, option, verb
from eightpost.errors import InputError
from eightpost.report.console import Column, Table, console_table, print_error, unbroken

if TYPE_CHECKING:
    from builder.check import CheckReport, Finding, Level, NotChecked, Scope
    from cosim.study.host_steps import HostSteps

_COLOURS = {"error": "bold red", "drop-in": "yellow", "hint": "cyan"}


@verb
def check(
    ctx: click.Context,
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath()),
    standard: bool = option("Report only violations of the FMI standard; default: all findings."),
    as_json: bool = option("Print one JSON document instead of tables (docs/reference/check.md).", "--json"),
) -> None:  # fmt: skip
    """Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.

    A FILE may also be a system file (.toml) with one vehicle and its shocks: then the result is the largest steps of a
    simulator that integrates the vehicle and imports the shocks, for each loop of docs/how_to/hosts.md.

    The check runs fmpy validate, fmutool -check, more than a hundred rules of its own, and the FMU itself. Findings are
    errors (violations of the FMI standard), drop-in rules (known causes of failed imports into tools) or hints.

    The FMU runs in separate processes, so a crash is a finding. This is not a sandbox: the FMU's code has all your
    permissions. The exit code is 0 if there are no findings except hints, 1 if there are other findings, and 2 if a
    file is not an FMU of FMI 2.0 or 3.0; the other files are reported nevertheless.

    \b
    Examples:
      eightpost check dist/*.fmu
      eightpost check examples/seven_dof.toml
      eightpost check --standard --json supplier.fmu > supplier.json
    """
    from builder.check import CheckReport, NotChecked, Scope, json_document

    fmus = [path for path in files if path.suffix != ".toml"]
    systems = {str(path): _host_steps(path) for path in files if path.suffix == ".toml"}
    scope = Scope.STANDARD if standard else Scope.ALL
    reports: list[CheckReport | NotChecked] = []
    with Console(stderr=True).status("") as status:
        for path in fmus:
            status.update(f"checking {escape(str(path))}")
            reports.append(_checked(path, scope))
    _warn(reports)
    refused = [report for report in reports if isinstance(report, NotChecked)]
    if as_json:
        document = json_document(reports)
        if systems:
            document["host_steps"] = {path: asdict(steps) for path, steps in systems.items()}
        click.echo(json.dumps(document, indent=1))  # ASCII, because a terminal may support nothing else
    else:
        console = Console()
        for report in reports:
            if isinstance(report, CheckReport):
                show_report(console, report)
        for name, steps in systems.items():
            _show_host_steps(console, name, steps)
    for report in refused:
        print_error(report.error)
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


def _host_steps(path: Path) -> HostSteps:
    from cosim.study.host_steps import host_steps
    from cosim.system_file import read_case
    from eightpost.api.reading import existing_toml

    with Console(stderr=True).status(f"finding the steps for {escape(str(path))}"):
        return host_steps(read_case(existing_toml(path, "system")))


def _show_host_steps(console: Console, name: str, found: HostSteps) -> None:
    """Print the largest steps of each loop for a host that integrates the car."""
    from cosim.study.host_steps import LIMITS, LOOPS
    from eightpost.app.show import show_table, show_text

    def milliseconds(step: float) -> str:
        return f"{1e3 * step:.3g} ms" if step else "below 0.1 ms"

    show_text(
        console,
        f"{name}: largest steps of a host that integrates {found.car} with Runge-Kutta, for errors of the "
        f"{found.quantity} in {found.seconds:g} s of the drive",
    )
    rows = [(loop, milliseconds(found.stable[loop]), *map(milliseconds, found.steps[loop])) for loop in LOOPS]
    show_table(console, console_table(["loop", "stable to", *(f"{limit:g} %" for limit in LIMITS)], rows))
    show_text(console, "loops of docs/how_to/hosts.md; friction at the vehicle's ports is left out", begin="  ")


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
