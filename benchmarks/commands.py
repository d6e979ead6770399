"""What every command prints, how long it takes and what it writes, beside an earlier version.

    python -m benchmarks.commands [--against COMMIT] [--only TEXT] [--repeat 3] [--install] [--folder FOLDER]

Both versions run the commands of commands.toml in turns, each in a folder of its own with the examples and caches that
are empty at first, on a terminal of 80 columns. Prints Markdown: the counts of commands and options, then of each
command the lines, the widest line, and the smallest processor time [s] of itself and its child processes, which is up
to twice as long on a busy machine, so the ratio is what counts. `wrote ...` lines, which name files, may be wider.
`--install` installs both versions into new environments and states their sizes, which takes minutes.

Of two versions, the files that differ are listed. Of a table, a series or a JSON file the numbers and booleans are
compared in their order, to the last bit; texts and durations are left out, so that a reworded message changes nothing.
Of a page or an FMU's modelDescription.xml, the text without dates, versions, identifiers and durations is compared.

The exit code is 1 if a file differs, or a command fails, prints more than 12 lines (the demo: 60) or a line of more
than 80 columns, or misses a target of commands.toml. Requires git, and Linux or macOS.
"""

from __future__ import annotations

import csv
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow.parquet

from benchmarks.table import OF_THIS_RUN, ROOT, checked_out, markdown, number, parser_of
from eightpost.__main__ import SECTIONS, every_verb

#: Limits of a command's output: lines (of some commands others), and width.
LINES, WIDTH = 12, 80
OTHER_LINES = {"demo": 60, "doctor": 20, "reproduce": 250, "--help": 60}  # lists are their results

_GIVEN = tomllib.loads((ROOT / "benchmarks" / "commands.toml").read_text(encoding="utf-8"))
COMMANDS: list[str] = _GIVEN["commands"].strip().splitlines()

#: Largest acceptable processor times [s] of commands, which are repeated, and sizes [MB] of installations, by extras.
SECONDS: Mapping[str, float] = _GIVEN["seconds"]
MEGABYTES: Mapping[str, float] = _GIVEN["megabytes"]

#: Begin of commands that find no kept machine code.
FIRST = "(first) "

#: Lines about the progress of long work, which a terminal shows as a bar.
_PROGRESS = re.compile(r"^[a-z ]+: .*\d%")


@dataclass(frozen=True)
class Output:
    """What a command printed, and its processor time [s]; `width` is that of the widest line that names no file."""

    code: int
    lines: int
    width: int
    seconds: float = 0.0

    @classmethod
    def of(cls, code: int, text: str, seconds: float) -> Output:
        """Count the lines of a text."""
        lines = [line for line in text.splitlines() if not _PROGRESS.search(line)]
        width = max((len(line) for line in lines if not line.startswith("wrote ")), default=0)
        return cls(code, len(lines), width, seconds)

    def exceeds(self, command: str) -> bool:
        """Return whether a command failed, or its output is beyond the limits; the exit code 1 is a verdict."""
        most = OTHER_LINES.get(command.split(maxsplit=1)[0], LINES)
        return self.code > 1 or self.lines > most or self.width > WIDTH


@dataclass(frozen=True)
class Version:
    """A checkout, and the folder in which its commands run."""

    checkout: Path
    folder: Path

    def prepare(self) -> None:
        """Lay out the files of a user, unless an earlier call did."""
        if not self.folder.exists():
            shutil.copytree(ROOT / "examples", self.folder / "examples")
            for name, text in _GIVEN["files"].items():
                (self.folder / name).write_text(text, encoding="utf-8")

    def run(self, command: str) -> Output:
        """Run a command."""
        cache, folder = self.folder.with_name(f"{self.folder.name}_cache"), self.folder
        if command.startswith(FIRST):
            shutil.rmtree(cache, ignore_errors=True)
        given = shlex.split(command.removeprefix(FIRST))
        words = [name for word in given for name in (sorted(map(str, folder.glob(word))) or [word])]
        words = [word.removeprefix(f"{folder}{os.sep}") for word in words]
        environment = os.environ | {
            "PYTHONPATH": str(self.checkout), "COLUMNS": str(WIDTH), "EIGHTPOST_UNITS": "file",
            "EIGHTPOST_CACHE": str(cache), "NUMBA_CACHE_DIR": str(cache / "numba"), "OMP_NUM_THREADS": "1",
        }  # fmt: skip
        process = [sys.executable, "-P", "-m", "eightpost", *words]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        ran = subprocess.run(process, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        with (folder / "log.txt").open("a", encoding="utf-8") as log:
            log.write(f"$ {command}\n{ran.stdout}{ran.stderr}\n")
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return Output.of(ran.returncode, ran.stdout + ran.stderr, seconds)

    def megabytes(self, extras: str) -> float:
        """Install the checkout with extras into a new environment; return its size without pip and byte code [MB]."""
        place = self.folder / "environment"
        subprocess.run([sys.executable, "-m", "venv", "--clear", "--without-pip", place], check=True)
        pip = [sys.executable, "-m", "pip", "--python", place / "bin" / "python", "install", "--quiet", "--no-compile"]
        subprocess.run([*pip, f"{self.checkout}{extras}"], check=True)
        size = sum(path.stat().st_size for path in place.rglob("*") if not path.is_symlink() and path.is_file())
        shutil.rmtree(place)
        return size / 1e6

    def written(self) -> dict[str, list[str | bytes]]:
        """Return what is compared of each file."""
        return {
            path.relative_to(self.folder).as_posix(): list(_READERS[path.suffix](path))
            for path in self.folder.rglob("*")
            if path.suffix in _READERS and "chunks" not in path.parts  # named after the folder's path
        }


#: Outputs of a command, one for each run of a version.
Outputs = Mapping[str, Sequence[Sequence[Output]]]


def measured(versions: Sequence[Version], *, only: str = "", repeat: int = 1) -> Outputs:
    """Run the commands whose text contains `only`, those with a target repeatedly, all versions in turns."""
    for version in versions:
        version.prepare()
    found = {}
    for command in (command for command in COMMANDS if only in command):
        turns = []
        for _ in range(repeat if command in SECONDS else 1):
            for version in versions:
                shutil.rmtree(version.folder / "studied", ignore_errors=True)  # a study continues
            turns.append([version.run(command) for version in versions])
        found[command] = list(zip(*turns, strict=True))
        print(f"{turns[-1]} {command}", file=sys.stderr)
    return found


def counts() -> str:
    """Return the numbers of verbs and options as Markdown."""
    verbs = every_verb()
    options = sum(len([one for one in each.params if one.opts[0].startswith("-")]) for each in verbs.values())
    settings = sum(len(each.settings) for each in verbs.values())
    listed = sum(map(len, SECTIONS.values()))
    return f"{listed} verbs in the list, {len(verbs)} with those of groups; {options} options, {settings} settings\n"


def table(found: Outputs) -> str:
    """Return lines, widths and smallest times of the versions as Markdown, this version's last."""
    rows = []
    for command, versions in found.items():
        cells = [f"{ran[-1].lines}, {ran[-1].width}, {number(fastest(ran))}" for ran in versions]
        rows.append([f"`{command}`", *cells, f"{SECONDS.get(command, '')}"])
    names = ["before", "now"][-max(map(len, found.values()), default=1) :]
    return markdown(["command", *(f"lines, widest line, s {name}" for name in names), "target [s]"], rows)


def fastest(ran: Sequence[Output]) -> float:
    """Return the smallest processor time [s]."""
    return min(output.seconds for output in ran)


def missed(found: Outputs) -> list[str]:
    """Return the commands whose output is beyond the limits, or whose target this version misses."""
    return [
        command
        for command, (*_, now) in found.items()
        if now[-1].exceeds(command) or fastest(now) > SECONDS.get(command, float("inf"))
    ]


#: Keys of JSON whose values are durations of the calculation, versions or names of this run.
_NOT_RESULTS = {"created", "version", "workers", "sources"}


def _numbers(content: Any) -> Iterator[str]:
    if isinstance(content, dict):
        for key in sorted(set(content) - _NOT_RESULTS):
            if not key.endswith("seconds"):
                yield from _numbers(content[key])
    elif isinstance(content, list):
        for item in content:
            yield from _numbers(item)
    elif isinstance(content, int | float):
        yield float(content).hex()


def _csv_numbers(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", newline="") as stream:
        for cell in chain.from_iterable(csv.reader(stream)):
            with suppress(ValueError):  # a text
                yield float(cell).hex()


def _parquet_numbers(path: Path) -> Iterator[bytes]:
    read = pyarrow.parquet.read_table(path)
    for name in read.column_names:
        if not name.endswith("seconds") and pyarrow.types.is_primitive(read[name].type):
            yield read[name].to_numpy().tobytes()


def _text(path: Path) -> Iterator[str]:
    yield OF_THIS_RUN.sub("", path.read_text(encoding="utf-8"))


def _description(path: Path) -> Iterator[str]:
    with zipfile.ZipFile(path) as archive:
        yield OF_THIS_RUN.sub("", archive.read("modelDescription.xml").decode())


_READERS: Mapping[str, Callable[[Path], Iterator[str | bytes]]] = {
    ".json": lambda path: _numbers(json.loads(path.read_text(encoding="utf-8"))),
    ".csv": _csv_numbers,
    ".parquet": _parquet_numbers,
    ".html": _text,
    ".fmu": _description,
}


def main() -> int:
    """Print the tables; return the exit code."""
    parser = parser_of(__doc__)
    parser.add_argument("--against", default="", help="earlier commit to compare with; default: none")
    parser.add_argument("--only", default="", help="text of the commands to run; default: all")
    parser.add_argument("--repeat", type=int, default=3, help="number of runs of every command with a target")
    parser.add_argument("--install", action="store_true", help="also install the versions, and compare sizes")
    parser.add_argument("--folder", type=Path, help="folder to run in; default: a temporary one")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, checked_out(options.against) as before:
        folder = options.folder or Path(name)
        versions = [Version(before, folder / "before")] if before else []
        versions.append(Version(ROOT, folder / "now"))
        found = measured(versions, only=options.only, repeat=options.repeat)
        first, last = versions[0].written(), versions[-1].written()
        differing = sorted(file for file in first | last if first.get(file) != last.get(file))
        print("\n".join([counts(), table(found), "", *(f"differs: {file}" for file in differing)]))
        late = missed(found)
        for extras, most in MEGABYTES.items() if options.install else ():
            sizes = [version.megabytes(extras) for version in versions]
            print(f"installation{extras}: {', '.join(map(number, sizes))} MB (target: {most:g})")
            late += [extras] if sizes[-1] > most else []
    return 1 if differing or late else 0


if __name__ == "__main__":
    sys.exit(main())
