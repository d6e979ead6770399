"""`eightpost units`."""

from __future__ import annotations

from rich.console import Console

from eightpost.app.options import argument, verb


@verb
def units(
    system: str | None = argument("[us|si]", kind=("us", "si", "file"), required=False),
) -> None:
    """Choose the units of all results once: us or si.

    us: lbf, in, lbf.s/in. si: N, mm, N.s/m. file: those of each file, as before any choice. Without a word, the present
    choice is printed. The environment variable EIGHTPOST_UNITS counts before it. All commands, pages and pictures
    follow; the files of this project are in SI units in any case.

    \b
    Examples:
      eightpost units si
      eightpost units
    """
    Console().print(system)
