"""`eightpost units`."""

from __future__ import annotations

import os

from rich.console import Console

from eightpost.app.options import argument, verb


@verb
def units(system: str | None = argument("[us|si|file]", kind=("us", "si", "file"), required=False)) -> None:
    """Choose the units of all results once: us or si.

    us: lbf, in, psi. si: N, mm, bar. file: those of the first file that a command reads, as before any choice.
    Without a word, the present choice is printed. All commands, pages and pictures follow it; the environment variable
    EIGHTPOST_UNITS counts before it. The files that eightpost writes are in SI units in any case.

    \b
    Examples:
      eightpost units si
      eightpost units
    """
    from eightpost.files import write_text
    from eightpost.units import CHOICE, choice_path, chosen_system

    console, path = Console(soft_wrap=True, highlight=False), choice_path()
    if system is not None:
        write_text(path, f"{system}\n")
    origin = CHOICE if os.environ.get(CHOICE) else str(path) if path.is_file() else "nothing was chosen"
    console.print(f"units of results: {chosen_system()} ({origin})", markup=False)
