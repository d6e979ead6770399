"""`eightpost new`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from eightpost.app.options import OutputFolder, argument, verb
from eightpost.errors import OutputError
from eightpost.examples_folder import examples_folder
from eightpost.files import atomic_path

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
