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
from dataclasses import dataclass
from pathlib import Path

from eightpost.__main__ import SECTIONS, every_verb

ROOT = Path(__file__).resolve().parents[1]
BEFORE, NOW = "before", "now"

#: Limits of a command's output: lines (of some commands others), and width.
LINES, WIDTH = 12, 80
OTHER_LINES = {"demo": 60, "doctor": 20, "reproduce": 250}  # its list is the result

#: Commands in the order in which their files are made.
COMMANDS = """
new car7
inspect examples/data/dyno_A.csv
fit examples/data/dyno_A.csv --gas included -o A.json
fit examples/data/dyno_A.csv examples/data/dyno_B.csv --law lpf1 -o AB.json
fit examples/settings/rebound.toml --law lpf1 -o clicks.json
inspect clicks.json
validate A.json examples/data/dyno_B.csv -o validation.html
report A.json examples/data/dyno_A.csv -o report.html
report --live A.json -o live.html
virtual dyno --configuration 1 --test random --set seed=1 -o dyno.parquet
virtual rig --program identification --set duration='30 s' -o rig/
virtual rig --test track --set duration='20 s' --shock demo:B --set run=1 -o lap.parquet
inspect rig/baseline.parquet
virtual rig --test single --set only=lf.road --set duration='60 s' -o single/lf.parquet
virtual rig --test single --set only=rf.road --set duration='60 s' -o single/rf.parquet
inspect single/lf.parquet single/rf.parquet
identify rig/*.parquet -o car.json
inspect car.json
validate car.json lap.parquet -o car.html
build A.json examples/car.toml -o dist/
fit examples/data/dyno_A.csv --law lpnl2 --gas included -o dist/dyno_A.json
build dist/dyno_A.json examples/car.toml examples/corner.toml -o dist/
check dist/A.fmu
inspect dist/A.fmu
inspect examples/seven_dof.toml
run examples/seven_dof.toml -o out/
run examples/seven_dof.toml -o out2/ --set verify=yes --fmu lf=dist/A.fmu
inspect out/
study compare out out2
export car.json -o car.mat
export A.json -o shock.dpr
export clicks.json --over rebound=0,14,28 -o clicks.txt
export examples/seven_dof.toml -o car.ssp
study small.toml -o study/
inspect study/
study whatif study/ --at lr --rebound +1
study sensitivity study/
study robust study/ uncertain.toml --set draws=2
study select study/ --total 4
study confirm study/ selection.csv
study compare study/ --measured selection.csv
report study/
study optimise small.toml -o search/ --evaluations 6
study shapes small.toml -o aim/ --vary rebound.low --at lr --set draws=0 --set starts=1
study clicks clicks.json --curve target.csv
drivefile start lap.parquet --car car.json -o iteration/
drivefile simulate iteration/ --passes 2
units
reproduce --list
doctor
demo
"""

#: Files that the commands need beside the examples.
FILES = {
    "small.toml": """
schema = 1
name = "three builds at the front and at the rear (synthetic data)"
families = ["ride", "numbers"]
baseline = "B/B"
alike = [["lf", "rf"], ["lr", "rr"]]
[vehicle]
fmu = "examples/identified/car.json"
[bank]
"AA/B" = "examples/bank/AA_B.json"
"B/B" = "examples/bank/B_B.json"
"C/B" = "examples/bank/C_B.json"
[[drive]]
file = "examples/identified/lap.parquet"
stop = "12 s"
[[objective]]
measure = "total tire force, RMS"
weight = 1.0
unit = "lbf"
""",
    "uncertain.toml": 'schema = 1\n[run_to_run]\n"total tire force, RMS" = "2 lbf"\n',
    "target.csv": "velocity [m/s],force [N]\n-0.2,-900\n-0.1,-600\n0,0\n0.1,400\n0.2,700\n",
}

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
    for name, text in FILES.items():
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
        run(
            checkout,
            folder,
            f"virtual rig --test track --shock build:{build} --set seed=78 --set run={number} -o {record}",
        )
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
        checkouts = {NOW: ROOT}
        if options.against:
            checkouts = {BEFORE: folder / "checkout", NOW: ROOT}
            subprocess.run(
                ["git", "-C", str(ROOT), "worktree", "add", "--detach", str(folder / "checkout"), options.against],
                check=True,
            )
        try:
            found = {
                label: measured(checkout, options.folder or folder / label, options.only)
                for label, checkout in checkouts.items()
            }
        finally:
            if options.against:
                subprocess.run(
                    ["git", "-C", str(ROOT), "worktree", "remove", "--force", str(folder / "checkout")], check=True
                )
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
