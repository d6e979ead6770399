"""The options of `eightpost check`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("fmus", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--standard", "scope", flag_value="standard", default="all",
              help="Only the rules of the FMI standard.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="One JSON document instead of tables (docs/check.md).")
@body
def check() -> None:
    """Check FMUs, ours or not: the standard's rules, and what breaks imports.

    Runs fmpy validate, fmutool -check, over a hundred rules of its own, and the FMU itself. Findings are errors (the
    FMI standard), drop-in rules (what breaks imports into tools) or hints. The FMU runs in separate processes, so a
    crash is a finding. This is not a sandbox: the FMU's code can do whatever you can. Exits 0 if there are hints at
    most, 1 if there are other findings, 2 if a file is no FMU 2.0; the others are reported all the same.

    \b
    Examples:
      eightpost check dist/*.fmu
      eightpost check --standard --json supplier.fmu > supplier.json
    """
