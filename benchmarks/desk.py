"""Lines and width of what every command prints on the shipped examples, vs an earlier version.

    python -m benchmarks.desk [--against COMMIT] [--only WORDS] [--folder FOLDER]

Both versions run the same commands, each in a folder of its own with the examples, on a terminal of 80 columns. Prints
Markdown: the counts of commands and options, then the lines and the widest line of each command. Lines that name files
(`wrote ...`) may be wider. The exit code is 1 if a command prints more than 12 lines or a line of more than 80
columns (the demo: 60 lines). Requires git, and Linux or macOS.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

from benchmarks.table import ROOT, checked_out
from eightpost.__main__ import SECTIONS, every_verb

BEFORE, NOW = "before", "now"

#: Limits of a command's output: lines (of some commands others), and width.
LINES, WIDTH = 12, 80
OTHER_LINES = {"demo": 60, "doctor": 20, "reproduce": 250}  # its list is the result

_WRITTEN = tomllib.loads((ROOT / "benchmarks" / "desk.toml").read_text(encoding="utf-8"))
COMMANDS: str = _WRITTEN["commands"]

#: Rig runs of the setups of small.toml: the number of the setup, and its shocks on the virtual rig.
RIG_RUNS = {0: "AA/B", 4: "B/B", 8: "C/B"}


#: Lines about the progress of long work, which a terminal shows as a bar.
_PROGRESS = re.compile(r"^[a-z ]+: .*\d%")


@dataclass(frozen=True)
class Output:
    """What a command printed: its exit code, number of lines, and the widest line that names no file."""

    code: int
    lines: int
    width: int

    @classmethod
    def of(cls, code: int, text: str) -> Output:
        """Count the lines of a text."""
        lines = [line for line in text.splitlines() if not _PROGRESS.search(line)]
        return cls(code, len(lines), max((len(line) for line in lines if not line.startswith("wrote ")), default=0))

    def exceeds(self, command: str) -> bool:
        """Return whether the output of a command is beyond the limits."""
        return self.lines > OTHER_LINES.get(command.split(maxsplit=1)[0], LINES) or self.width > WIDTH


def prepare(folder: Path) -> None:
    """Lay out the files of a user, unless an earlier call did."""
    if folder.exists():
        return
    shutil.copytree(ROOT / "examples", folder / "examples")
    for name, text in _WRITTEN["files"].items():
        (folder / name).write_text(text, encoding="utf-8")


def run(checkout: Path, folder: Path, command: str) -> Output:
    """Run a command of a checkout in a folder."""
    words = [name for word in shlex.split(command) for name in (sorted(map(str, folder.glob(word))) or [word])]
    words = [word.removeprefix(f"{folder}{os.sep}") for word in words]
    environment = os.environ | {"PYTHONPATH": str(checkout), "COLUMNS": str(WIDTH), "EIGHTPOST_UNITS": "file"}
    process = [sys.executable, "-P", "-m", "eightpost", *words]
    ran = subprocess.run(process, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    with (folder / "log.txt").open("a", encoding="utf-8") as log:
        log.write(f"$ {command}\n{ran.stdout}{ran.stderr}\n")
    return Output.of(ran.returncode, ran.stdout + ran.stderr)


def measured(checkout: Path, folder: Path, only: str = "") -> dict[str, Output]:
    """Return what each command prints; rig runs are simulated before the first command that needs them."""
    prepare(folder)
    found = {}
    for command in COMMANDS.strip().splitlines():
        if only and only not in command:
            continue
        if "selection.csv" in command and not (folder / "selection.csv").exists():
            _rig_runs(checkout, folder)
        found[command] = run(checkout, folder, command)
        print(f"{found[command]} {command}", file=sys.stderr)
    return found


def _rig_runs(checkout: Path, folder: Path) -> None:
    """Simulate the rig runs, and write their list."""
    for number, build in RIG_RUNS.items():
        record = f"run_{number}.parquet"
        options = f"--shock build:{build} --set seed=78 --set run={number}"
        run(checkout, folder, f"virtual rig --test track {options} -o {record}")
    rows = [f"run_{number}.parquet,{number}" for number in RIG_RUNS]
    (folder / "selection.csv").write_text("\n".join(["file,setup", *rows]) + "\n", encoding="utf-8")


def counts() -> str:
    """Return the numbers of verbs and options as Markdown."""
    verbs = every_verb()
    options = sum(len([one for one in each.params if one.opts[0].startswith("-")]) for each in verbs.values())
    settings = sum(len(each.settings) for each in verbs.values())
    listed = sum(map(len, SECTIONS.values()))
    return f"{listed} verbs in the list, {len(verbs)} with those of groups; {options} options, {settings} settings\n"


def table(found: dict[str, dict[str, Output]]) -> str:
    """Return lines and widths of all versions as Markdown."""
    names = list(found)
    heads = [f"lines, widest line {name}" for name in names]
    lines = [f"| command | {' | '.join(heads)} |", "|---" * (len(names) + 1) + "|"]
    for command in found[NOW]:
        cells = [f"{outputs[command].lines}, {outputs[command].width}" for outputs in found.values()]
        lines.append(f"| `{command}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> int:
    """Print the table; return the exit code."""
    options = _options()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with checked_out(options.against) as before:
            checkouts = {BEFORE: before, NOW: ROOT} if before else {NOW: ROOT}
            found = {
                label: measured(checkout, options.folder or folder / label, options.only)
                for label, checkout in checkouts.items()
            }
    print(counts())
    print(table(found))
    return 1 if any(output.exceeds(command) for command, output in found[NOW].items()) else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", default="", help="earlier commit to compare with; default: none")
    parser.add_argument("--only", default="", help="text of the commands to run; default: all")
    parser.add_argument("--folder", type=Path, help="folder to run in; default: a temporary one")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
