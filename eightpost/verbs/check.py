"""Options of `eightpost check`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("fmus", metavar="FMU...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--standard", "scope", flag_value="standard", default="all",
              help="Report only violations of the FMI standard; default: all findings.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document instead of tables (docs/check.md).")
@body
def check() -> None:
    """Check FMUs of any maker: the rules of the FMI standard, and known causes of failed imports.

    The check runs fmpy validate, fmutool -check, more than a hundred rules of its own, and the FMU itself. Findings are
    errors (violations of the FMI standard), drop-in rules (known causes of failed imports into tools) or hints.

    The FMU runs in separate processes, so a crash is a finding. This is not a sandbox: the FMU's code has all your
    permissions. The exit code is 0 if there are no findings except hints, 1 if there are other findings, and 2 if a
    file is not an FMI 2.0 FMU; the other files are reported nevertheless.

    \b
    Examples:
      eightpost check dist/*.fmu
      eightpost check --standard --json supplier.fmu > supplier.json
    """
