"""`eightpost new`, `app`, `units` and `reproduce`: verbs that need no records."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

import click
from rich.console import Console

import eightpost
from eightpost.app.options import OutputFolder, argument, option, setting, verb
from eightpost.errors import InputError, OutputError
from eightpost.examples_folder import examples_folder
from eightpost.files import atomic_path, write_text
from eightpost.outputs import PAGE

#: Files of a starter folder and where they are in the examples.
FILES = {
    "README.md": "starter/README.md",
    "Makefile": "starter/Makefile",
    "car.json": "identified/car.json",
    "system.toml": "starter/system.toml",
    "study.toml": "starter/study.toml",
    "track.parquet": "identified/lap.parquet",
    "shocks/dyno_A.csv": "data/dyno_A.csv",
    "shocks/dyno_B.csv": "data/dyno_B.csv",
}


@verb
def new(folder: Path = argument("FOLDER", kind=OutputFolder())) -> None:
    """Write a starter folder, with files to be replaced by your own.

    FOLDER gets dynamometer files, a car, a system, a study, and a README with the five commands. The data are
    SYNTHETIC. No file is overwritten: if one of the names exists, nothing is written.

    \b
    Examples:
      eightpost new car7
      eightpost new .
    """
    if existing := [name for name in FILES if (folder / name).exists()]:
        raise OutputError(
            f"{folder}: {', '.join(existing)} would be overwritten; name another folder, or move what is there"
        )
    examples = examples_folder()
    for name, source in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_bytes((examples / source).read_bytes())
    console = Console()
    console.print(f"wrote {', '.join(FILES)} in {folder}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"next: read {folder / 'README.md'}; its five commands run in {folder}", highlight=False,
                  soft_wrap=True, markup=False)  # fmt: skip


@verb
def app(
    folder: Path = argument("[FOLDER]", kind=OutputFolder(), required=False),
    port: int = setting("Port on this machine; 0: a free one.", kind=click.IntRange(0, 65535), default=0),
    browser: bool = setting("Open the browser; `no` prints the link only.", default=True),
) -> None:  # fmt: skip
    """Open a window in the browser: drop dynamometer and rig files, fit, couple, and run studies.

    FOLDER receives the files that are dropped and what the commands write; default: the current folder. Only this
    machine's browser can open the window, by the link with its token. Ctrl-C ends it, and the commands that it runs.

    \b
    Examples:
      eightpost app
      eightpost app car7 --set browser=no
    """
    from eightpost.window.server import serve

    console = Console()

    def tell(link: str) -> None:
        console.print(f"eightpost is at {link}\nCtrl-C ends it.", highlight=False, soft_wrap=True, markup=False)

    serve(folder or Path(), port, browser=browser, tell=tell)


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
    from eightpost.units import CHOICE, choice_path, chosen_system

    console, path = Console(soft_wrap=True, highlight=False), choice_path()
    if system is not None:
        write_text(path, f"{system}\n")
    origin = CHOICE if os.environ.get(CHOICE) else str(path) if path.is_file() else "nothing was chosen"
    console.print(f"units of results: {chosen_system()} ({origin})", markup=False)


@verb
def reproduce(
    ctx: click.Context,
    numbers: tuple[str, ...] = argument("[NUMBER]...", required=False),
    everything: bool = option("Reproduce all items of chapters 3 to 7.", "--all"),
    listing: bool = option("List the items and their bases; compute nothing.", "--list"),
    quick: bool = option("Use short records and fewer setups; the levels differ more from print."),
    output: Path = option(
        "Folder for reproduce.html.", "-o", "--output", kind=OutputFolder({"reproduce.html": PAGE}), default=Path("out")
    ),
) -> None:  # fmt: skip
    """Reproduce the dissertation's figures, tables and equations.

    A NUMBER is that of a figure, a table or an equation (7.2 is the figure and the table), of one of them
    (table-7.2, figure-7.2, equation-6.8), or of a chapter (4). The page reproduce.html has the printed values beside
    ours and the difference in words; docs/evidence/equations.md lists the code. Measured data that were never published
    are replaced by the virtual rigs, which each such item states.

    The items are in the folder dissertation/ of a checkout of eightpost; an installed wheel does not contain them.

    The exit code is 1 if an item differs from print by more than its stated tolerance, and 2 if a number is unknown or
    there is no checkout.

    \b
    Examples:
      eightpost reproduce 4.2
      eightpost reproduce table-7.1 equation-6.8 -o out/
      eightpost reproduce --all
      eightpost reproduce --list
    """
    if not (Path(eightpost.__file__).resolve().parents[1] / "dissertation" / "command.py").is_file():
        raise InputError(
            "the reproduction of the dissertation is in the folder dissertation/ of the source distribution and the "
            "repository of eightpost, not in its wheel: download one of them and run eightpost reproduce there, after "
            "pip install -e .[all]"
        )
    command = import_module("dissertation.command")
    ctx.exit(command.run(numbers, output, everything=everything, listing=listing, quick=quick))
