"""Write docs/development/architecture.md and its picture from the code: `python docs/make/make_architecture.py`.

The picture has a box for each folder, above the folders that it imports. The list of calls is that of a traced
`eightpost run` of the quarter car. The recipes name files, and the script fails if one of
them does not exist.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from pathlib import Path
from types import FrameType
from typing import Any

import matplotlib as mpl

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.structure import PACKAGES, Source, importers, sources  # noqa: E402

#: Connections that are not imports: the builder compiles C sources, the engine calls the functions of FMUs.
_BEYOND_PYTHON = (("builder", "fmus"), ("cosim.engine", "fmus"))

#: What can be added: the files to open, and the page that describes it.
_RECIPES = (
    (
        "law of a shock",
        ("eightpost/shock/lpf1.py", "fmus/shock_lpf1/model.c", "fmus/shock_lpf1/interface.toml"),
        "development/add_a_law.md",
    ),
    ("measure of a study", ("cosim/study/measures.py",), "how_to/study.md"),
    (
        "static rule of `check`",
        ("builder/check/rules.txt", "builder/check/description.py"),
        "reference/check.md",
    ),
    (
        "dynamic rule of `check`",
        ("builder/check/rules.txt", "builder/check/probes/instances.py"),
        "reference/check.md",
    ),
    ("file format of signals", ("eightpost/signals/formats.py", "eightpost/signals/csv_file.py"), "reference/files.md"),
    (
        "coupling scheme",
        ("cosim/systems/algorithm.py", "cosim/engine/sweep.py", "cosim/engine/march.py"),
        "explanation/coupling.md",
    ),
)

#: Steps of a study in their order, each with its module.
_STUDY = (
    ("one method for each verb", "eightpost/api/study_folder.py"),
    ("the study file", "cosim/study/study_file.py"),
    ("setups in chunks, with their cached results", "cosim/study/running/sweep.py"),
    ("setups on the machine, or through their FMUs", "cosim/study/running/evaluator.py"),
    ("the table of results", "cosim/study/table.py"),
    ("how sure the choice is", "cosim/study/choice/assess.py"),
    ("setups for the rig, and their records", "cosim/study/choice/rig_day.py"),
    ("verdict; page, ranking and workbook", "cosim/study/page.py"),
)

_INTRODUCTION = """# Architecture

`python docs/make/make_architecture.py` writes this page from the code.

`eightpost` is the library. `builder` turns its models into FMUs and checks FMUs of any maker; `fmus` has the sources
that these contain. `cosim` simulates coupled FMUs and knows no physics. The commands (`eightpost.app`) use all of these
and contain none of the work. Imports run downwards only; the `__init__.py` of a folder says what it contains.

![folders and their imports](../pictures/architecture.png)

"""


def main() -> None:
    """Write the page and the picture to their places in docs/, or to the folder that is the argument."""
    given = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    files = sources(ROOT)
    draw(folders(files), (given or ROOT / "docs" / "pictures") / "architecture.png")
    ((given or ROOT / "docs" / "development") / "architecture.md").write_text(page(traced_run()), encoding="utf-8")


# ---- The picture --------------------------------------------------------------------------------------------------


def folder_of(module: str) -> str:
    """Return the folder in the picture that a module belongs to: `package.folder`, or the package of a single file."""
    if module == "eightpost.__main__":
        return "eightpost.app"
    package, _, rest = module.partition(".")
    folder = f"{package}.{rest.partition('.')[0]}"
    is_folder = bool(rest) and (ROOT / folder.replace(".", "/")).is_dir() and package != "fmus"
    return folder if is_folder else package


def folders(files: list[Source]) -> dict[str, set[str]]:
    """Return the folders that each folder imports, without those that are reached through another of them."""
    direct: dict[str, set[str]] = {folder_of(file.module): set() for file in files}
    for module, by in importers(files).items():
        for importer in by:
            direct[folder_of(importer)].add(folder_of(module))
    for one, other in _BEYOND_PYTHON:
        direct[one].add(other)
    direct = {name: below - {name} for name, below in direct.items()}
    TopologicalSorter(direct).prepare()  # raises an error if folders import each other
    return {name: {other for other in below if not _indirect(direct, name, other)} for name, below in direct.items()}


def _indirect(direct: Mapping[str, set[str]], start: str, end: str) -> bool:
    """Return whether a folder imports another one through a third one."""
    seen, left = {start}, [other for other in direct[start] if other != end]
    while left:
        name = left.pop()
        if name == end:
            return True
        if name not in seen:
            seen.add(name)
            left.extend(direct[name])
    return False


def levels(below: Mapping[str, set[str]]) -> dict[str, int]:
    """Return the row of each folder, from 0 for those that import nothing."""
    found: dict[str, int] = {}
    for name in TopologicalSorter(below).static_order():
        found[name] = 1 + max((found[other] for other in below[name]), default=-1)
    return found


def draw(below: Mapping[str, set[str]], path: Path) -> None:
    """Draw a box for each folder and an arrow for each import."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 -- after the choice of the backend

    places = _places(below)
    rows = 1 + max(row for _, row in places.values())
    figure, axes = plt.subplots(figsize=(11.0, 0.85 * rows), layout="constrained")
    colours = {"eightpost": "#dbe9f6", "builder": "#e5f2dd", "cosim": "#fde8d3", "fmus": "#e8e3f1"}
    for name, (x, y) in places.items():
        box = {"boxstyle": "round,pad=0.35", "facecolor": colours[name.split(".")[0]], "edgecolor": "#555555"}
        axes.text(x, y, name, ha="center", va="center", fontsize=9, bbox=box, zorder=2)
        for other in below[name]:
            dashed = (name, other) in _BEYOND_PYTHON
            style = {"arrowstyle": "-|>", "color": "#777777", "lw": 0.8, "ls": "--" if dashed else "-"}
            axes.annotate("", places[other], (x, y), arrowprops=style | {"shrinkA": 9, "shrinkB": 11}, zorder=1)
    axes.set_xlim(-0.08, 1.08)
    axes.set_ylim(-0.6, rows - 0.4)
    axes.axis("off")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _places(below: Mapping[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Return the place of each folder: packages side by side, rows by level."""
    centre = {"builder": 0.12, "eightpost": 0.5, "cosim": 0.86, "fmus": 0.0}
    rows: defaultdict[tuple[int, str], list[str]] = defaultdict(list)
    for name, level in sorted(levels(below).items()):
        rows[level, name.split(".")[0]].append(name)
    places = {}
    for (level, package), names in rows.items():
        for k, name in enumerate(names):
            places[name] = (centre[package] + 0.16 * (k - 0.5 * (len(names) - 1)), float(level))
    return places


# ---- One run ------------------------------------------------------------------------------------------------------


@dataclass
class Trace:
    """First call into each folder of a run, and the deepest stack of own functions.

    Attributes:
        calls: Depth, module and function of the first call into each folder, in order.
        deepest: Largest number of own functions that were active at once.
    """

    calls: list[tuple[int, str, str]] = field(default_factory=list)
    deepest: int = 0
    _depth: int = 0
    _importing: int = 0
    _seen: set[str] = field(default_factory=set)

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        """Record a call or a return (sys.setprofile)."""
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(str(ROOT)):
            return
        if code.co_name == "<module>":
            self._importing += 1 if event == "call" else -1
        module = frame.f_globals.get("__name__", "")
        if self._importing or code.co_name.startswith("<") or module.split(".")[0] not in PACKAGES:
            return
        if event == "return":
            self._depth -= 1
            return
        self._depth += 1
        self.deepest = max(self.deepest, self._depth)
        if folder_of(module) not in self._seen:
            self._seen.add(folder_of(module))
            self.calls.append((self._depth, module, code.co_name))


def traced_run() -> Trace:
    """Return the calls of `eightpost run` of the quarter car, the second time on this machine: with full caches."""
    from eightpost.__main__ import main as command  # noqa: PLC0415 -- not needed for the picture

    trace = Trace()
    with tempfile.TemporaryDirectory() as name:
        arguments = ["run", str(_quarter_car(Path(name))), "-o", f"{name}/out"]
        subprocess.run([sys.executable, "-m", "eightpost", *arguments], check=True, stdout=subprocess.DEVNULL)
        sys.setprofile(trace)
        try:
            command(arguments, standalone_mode=False)
        finally:
            sys.setprofile(None)
    return trace


#: Program that builds FMUs for this platform alone: a sixth of the work, and only their run is traced.
_BUILD = """
from builder import toolchain
from eightpost.__main__ import main
here = toolchain.this_platform()
if here.name in toolchain.PLATFORMS:
    toolchain.Zig.platforms = (here,)
main()
"""


def _quarter_car(folder: Path) -> Path:
    """Build the FMUs of examples/quarter_car.toml in a folder; return the system file there."""
    examples, system = ROOT / "examples", folder / "system.toml"
    sources_of = {"../dist/corner.fmu": examples / "corner.toml", "../dist/dyno_A.fmu": examples / "bank" / "B_B.json"}
    command = [sys.executable, "-c", _BUILD, "build", *map(str, sources_of.values()), "-o", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    text = (examples / "quarter_car.toml").read_text(encoding="utf-8")
    for named, source in sources_of.items():
        text = text.replace(named, f"{source.stem}.fmu")
    system.write_text(text.replace("data/track", f"{examples}/data/track"), encoding="utf-8")
    return system


# ---- The page -----------------------------------------------------------------------------------------------------


def page(trace: Trace) -> str:
    """Return the text of the page."""
    return _INTRODUCTION + _run_section(trace) + _study_section() + _recipes()


def _run_section(trace: Trace) -> str:
    lines = [
        "## One run, from the command to C and back",
        "",
        "The first call into each folder while `eightpost run` runs the quarter car, indented by the number of own",
        f"functions that are active; at most {trace.deepest} are. The compiled loop gets arrays and addresses of C",
        "functions, and returns at the end of the run.",
        "",
    ]
    calls = [f"{'  ' * (depth - 1)}{module}: {function}()" for depth, module, function in trace.calls]
    return "\n".join([*lines, "```text", *calls, "```"]) + "\n\n"


def _study_section() -> str:
    rows = ["## One study, from the file to the page", "", "| what | module |", "|---|---|"]
    for what, path in _STUDY:
        if not (ROOT / path).is_file():
            raise FileNotFoundError(f"{path}: the steps of a study name it, but there is no such file")
        rows.append(f"| {what} | `{path}` |")
    return "\n".join(rows) + "\n\n"


def _recipes() -> str:
    rows = ["## Where to add something", "", "| to add a | open | page |", "|---|---|---|"]
    for what, paths, document in _RECIPES:
        for path in (*paths, f"docs/{document}"):
            if not (ROOT / path).is_file():
                raise FileNotFoundError(f"{path}: the recipe for a {what} names it, but there is no such file")
        opened = ", ".join(f"`{path}`" for path in paths)
        rows.append(f"| {what} | {opened} | [{Path(document).name}]({_from_here(document)}) |")
    return "\n".join(rows) + "\n"


def _from_here(document: str) -> str:
    """Return the link from the page of the architecture to another page of docs/."""
    return document.removeprefix("development/") if document.startswith("development/") else f"../{document}"


if __name__ == "__main__":
    main()
