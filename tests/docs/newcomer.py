"""Follow the start pages as a newcomer does: in a fresh clone, each block exactly as it is printed.

    python -m tests.docs.newcomer FOLDER

clones the last commit to FOLDER, installs it there with make, follows the five pages, each in a clone of its own with
that environment, and prints the table of docs/start/index.md.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.docs.page_blocks import ROOT, Block, blocks, commands

#: Files that a reader of each page has at its end.
RESULTS = {
    "damper_engineer": ("shocks/A.json", "shocks/B.json", "report.html", "validation.html", "dist/A.fmu"),
    "rig_engineer": ("car.json", "car.html", "dist/car.fmu", "modes/lf.tire_force.png"),
    "simulation_engineer": ("dist/dyno_A.fmu", "dist/car_with_shocks.fmu", "dist/car.ssp", "out/report.html"),
    "python_developer": ("out/shock.json", "out/shock.fmu", "out/car.fmu"),
    "researcher": ("out/reproduce.html",),
}


@dataclass(frozen=True)
class Walk:
    """A page that was followed."""

    page: str  #: Name of the page.
    commands: int  #: Number of commands and scripts.
    minutes: float  #: Duration [min].
    processor: float  #: Processor time of all commands [min].


def clone(folder: Path) -> None:
    """Clone the last commit of this repository."""
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(folder)], check=True)


def follow(page: str, folder: Path, programs: Path) -> Walk:
    """Run the blocks of a start page in a clone.

    Args:
        page: Name of the page.
        folder: Clone, in which the commands run.
        programs: Folder of `python` and `eightpost`, which is first in the search path.

    Raises:
        AssertionError: A command failed, or a result is missing.
    """
    environment = os.environ | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(folder)}
    found = [block for block in blocks(ROOT / "docs" / "start" / f"{page}.md") if block.kind == "run"]
    began, used = time.perf_counter(), _processor_time()
    for language, script in _scripts(found):
        words = ["bash", "-e", "-c", script] if language == "sh" else ["python", "-c", script]
        ran = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, f"{page}: {script}\n{ran.stdout}\n{ran.stderr}"
    count = sum(len(list(commands(block))) for block in found if block.language == "sh")
    count += sum(language == "python" for language, _ in _scripts(found))
    minutes, processor = (time.perf_counter() - began) / 60.0, (_processor_time() - used) / 60.0
    missing = [name for name in RESULTS[page] if not (folder / name).is_file()]
    assert not missing, f"{page} did not write {', '.join(missing)}"
    return Walk(page, count, minutes, processor)


def _scripts(found: list[Block]) -> Iterator[tuple[str, str]]:
    """Yield the language and the text of each script; python blocks in succession share their names, so are one."""
    language, script = "", ""
    for block in found:
        if block.language == language == "python":
            script += block.text
            continue
        if script:
            yield language, script
        language, script = block.language, block.text
    yield language, script


def _processor_time() -> float:
    """Return the processor time of all child processes that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


def main() -> None:
    """Clone, install, follow all pages, and print the table."""
    folder = Path(sys.argv[1]).resolve()
    clone(folder / "eightpost")
    began = time.perf_counter()
    subprocess.run(["make", "--silent", ".venv/.installed"], cwd=folder / "eightpost", check=True)
    print(f"installed in {(time.perf_counter() - began) / 60.0:.1f} minutes", flush=True)
    programs = folder / "eightpost" / ".venv" / "bin"
    print("| page | commands and scripts | minutes | processor minutes |\n|---|---|---|---|", flush=True)
    for page in RESULTS:
        clone(folder / page)
        walk = follow(page, folder / page, programs)
        print(f"| {page} | {walk.commands} | {walk.minutes:.1f} | {walk.processor:.1f} |", flush=True)


if __name__ == "__main__":
    main()
