"""`eightpost doctor`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from eightpost.app.options import option, verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.app.doctor_checks import Finding

#: Version of the JSON document.
SCHEMA = 1

_COLORS = {"ok": "green", "note": "yellow", "absent": "cyan", "failed": "red"}


@verb
def doctor(
    ctx: click.Context,
    as_json: bool = option("Print one JSON document, e.g. for a report of a fault.", "--json"),
) -> None:  # fmt: skip
    """Check the installation: versions, extras, caches, a coupled run, the compiler.

    A coupled run is compared with its exact solution, and if the packages and a C compiler for it are installed, an FMU
    is built, loaded and stepped. Extras that are not installed are listed with the command that installs them; they are
    no fault. Nothing is sent anywhere. The first check on a machine compiles the loop, which takes about 20 s.

    The exit code is 0 if the installation works, 1 if a check failed.

    \b
    Examples:
      eightpost doctor
      eightpost doctor --json > doctor.json
    """
    from eightpost.app.doctor_checks import State, findings

    with Console(stderr=True).status("checking the installation"):
        found = list(findings())
    works = all(finding.state is not State.FAILED for finding in found)
    if as_json:
        click.echo(json.dumps(_document(found, works), indent=1))  # ASCII, because a terminal may support nothing else
    else:
        _show(Console(), found, works)
    ctx.exit(0 if works else 1)


def _document(found: Sequence[Finding], works: bool) -> dict[str, Any]:
    from eightpost import __version__

    return {
        "kind": "doctor",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "works": works,
        "findings": [
            {
                "group": finding.group,
                "name": finding.name,
                "state": finding.state.value,
                "statement": finding.statement,
                "remedy": finding.remedy,
            }
            for finding in found
        ],
    }


def _show(console: Console, found: Sequence[Finding], works: bool) -> None:
    from eightpost.app.doctor_checks import State
    from eightpost.app.show import is_detailed, show_text

    fine = [finding for finding in found if finding.state is State.OK and not is_detailed()]
    for finding in found:
        if finding not in fine:
            state = "" if finding.state is State.OK else f"{finding.state.value} "
            remedy = f" -> {finding.remedy}" if finding.remedy else ""
            show_text(console, f"{finding.group}, {finding.name}: {state}{finding.statement}{remedy}", hanging="  ")
    if fine:
        show_text(console, f"{len(fine)} checks found nothing wrong; -v lists them")
    verdict = "[green]The installation works.[/]" if works else "[red]The installation does not work: see `failed`.[/]"
    console.print(verdict, highlight=False)
