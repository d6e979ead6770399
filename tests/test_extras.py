"""`pip install eightpost` runs FMUs and fits shocks without dynamics; all else says which extra installs it."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from eightpost.extras import EXTRAS, REQUIRED, MissingExtraError, is_installed, missing, needs, packages

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
OURS = ("builder", "cosim", "eightpost")

#: Packages of extras that FMPy and rich install too.
WITH_REQUIRED = {"jinja2", "lxml", "markdown_it"}

#: Packages of the extra app: its modules are imported by eightpost.window.server, inside `needs`.
WINDOW = {"fastapi", "nicegui", "starlette", "uvicorn"}

#: Runs commands in a process in which the packages of all extras cannot be imported, as after `pip install eightpost`.
MINIMAL = """
import json, sys
absent, commands = json.loads(sys.argv[1])

class Without:
    # a finder that does not find the absent packages

    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        return None if name.partition(".")[0] in absent else self.finder.find_spec(name, path, target)

sys.meta_path[:] = map(Without, sys.meta_path)
from click.testing import CliRunner
from eightpost.__main__ import main
shown = [CliRunner().invoke(main, command, env={"COLUMNS": "400"}) for command in commands]
loaded = sorted({name.partition(".")[0] for name in sys.modules} & set(absent))
print(json.dumps([[[one.exit_code, f"{one.output}{one.exception!r}"] for one in shown], loaded]))
"""


@pytest.fixture(scope="module")
def minimal(quarter_car_system, fmus, tmp_path_factory):
    """Exit code and output of each command without any extra, and the packages of extras that were imported."""
    folder = tmp_path_factory.mktemp("minimal")
    (folder / "system.toml").write_text(quarter_car_system, encoding="utf-8")
    shock, record = EXAMPLES / "bank" / "B_B.json", EXAMPLES / "data" / "dyno_A.csv"
    (folder / "table.xlsx").write_bytes(b"PK")
    commands = {
        "run": ["run", folder / "system.toml", "-o", folder / "out"],
        "run --report": ["run", folder / "system.toml", "-o", folder / "out", "--report"],
        "new": ["new", folder / "starter"],
        "compare": ["study", "compare", folder / "out", folder / "starter" / ".." / "out"],
        "fit": ["fit", record, "--law", "polylinear", "-o", folder / "shock.json"],
        "fit --plot": [
            "fit",
            record,
            "--law",
            "polylinear",
            "-o",
            folder / "shock.json",
            "--plot",
            folder / "shock.png",
        ],
        "fit a law with dynamics": ["fit", record, "-o", folder / "shock.json"],
        "virtual dyno": ["virtual", "dyno", "--configuration", "1", "--test", "random", "-o", folder / "dyno.parquet"],
        "virtual rig": ["virtual", "rig", "--program", "identification", "-o", folder / "rig"],
        "doctor": ["doctor"],
        "inspect": ["inspect", record],
        "inspect a car": ["inspect", EXAMPLES / "identified" / "car.json"],
        "app": ["app"],
        "inspect a spreadsheet": ["inspect", folder / "table.xlsx"],
        "build": ["build", shock, "-o", folder],
        "check": ["check", fmus["lpf1"]],
        "study": ["study", EXAMPLES / "study.toml", "-o", folder / "study"],
    }
    absent = sorted({name for extra in EXTRAS for name in packages(extra)} - WITH_REQUIRED)
    request = json.dumps([absent, [list(map(str, command)) for command in commands.values()]])
    ran = subprocess.run(
        [sys.executable, "-c", MINIMAL, request],
        capture_output=True,
        text=True,
        encoding="utf-8",
        cwd=ROOT,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    shown, loaded = json.loads(ran.stdout.splitlines()[-1])
    return dict(zip(commands, shown, strict=True)), loaded, folder


def test_without_extras_fmus_run_and_nothing_else_is_imported(minimal):
    shown, loaded, folder = minimal
    code, text = shown["run"]
    assert code == 0, text
    assert {"series.parquet", "series.csv", "result.json"} <= {path.name for path in (folder / "out").iterdir()}
    assert not loaded


@pytest.mark.parametrize("verb", ["compare", "doctor", "fit", "inspect", "inspect a car", "new"])
def test_a_verb_that_neither_draws_nor_compiles_needs_no_extra(minimal, verb):
    code, text = minimal[0][verb]
    assert code == 0, text


@pytest.mark.parametrize(
    ("verb", "extra"),
    [
        ("run --report", "report"),
        ("fit --plot", "report"),
        ("fit a law with dynamics", "fit"),
        ("virtual dyno", "fit"),
        ("virtual rig", "fit"),
        ("inspect a spreadsheet", "files"),
        ("check", "check"),
        ("build", "build"),
        ("study", "build"),
        ("app", "app"),
    ],
)
def test_a_verb_without_its_extra_names_package_and_extra(minimal, verb, extra):
    code, text = minimal[0][verb]
    assert code == 2, text
    package = re.search(r"needs (\S+), which is not installed: ", text)
    assert package and package[1] in packages(extra).values()
    assert f'installed: pip install "eightpost[{extra}]"' in text


@pytest.mark.parametrize("verb", ["app", "build", "virtual dyno", "virtual rig"])
def test_the_error_begins_with_the_command_that_needs_the_extra(minimal, verb):
    assert f"error: {verb}: " in minimal[0][verb][1]


# ---- The extras are those of pyproject.toml, and every imported package is declared ----------------------------------


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def plain(requirement: str) -> str:
    return requirement.partition(";")[0].partition(">")[0].strip().lower()


def test_the_table_of_extras_is_that_of_pyproject():
    stated = {name: set(map(plain, listed)) for name, listed in project()["optional-dependencies"].items()}
    kept = {name: listed for name, listed in stated.items() if not name.startswith(("host-", "test", "docs"))}
    (all_of_them,) = kept.pop("all")
    assert set(re.split(r"[\[\],]", all_of_them)[1:-1]) == set(kept) - {"aim", "build-local", "notebook"}
    table = {
        name: {*extra.packages.values(), *(f"eightpost[{other}]" for other in extra.contains)}
        for name, extra in EXTRAS.items()
    }
    assert table == kept
    assert set(REQUIRED.values()) == set(map(plain, project()["dependencies"]))


def brought(requirements: Iterable[str]) -> set[str]:
    """Return the distributions that requirements install on this machine, with all that they require."""
    found, waiting = set[tuple[str, str]](), [(Requirement(text), "") for text in requirements]
    while waiting:
        one, asked = waiting.pop()
        if one.marker and not one.marker.evaluate({"extra": asked}):
            continue
        for extra in {"", *one.extras} - {extra for name, extra in found if name == canonicalize_name(one.name)}:
            found.add((canonicalize_name(one.name), extra))
            waiting += ((Requirement(text), extra) for text in importlib.metadata.requires(one.name) or ())
    return {name for name, _ in found}


def megabytes(distributions: Iterable[str]) -> float:
    """Return the size of installed distributions without byte code [MB], as their lists of files state it."""
    files = (path for name in distributions for path in importlib.metadata.files(name) or () if path.suffix != ".pyc")
    return sum(path.size or 0 for path in files) / 1e6


def test_an_installation_without_extras_has_at_most_350_megabytes() -> None:
    distributions = brought(project()["dependencies"])
    assert not distributions & {"llvmlite", "matplotlib", "numba", "pandas", "pyarrow"}
    assert {"arro3-core", "fmpy", "numpy", "scipy"} <= distributions
    own = sum(path.stat().st_size for folder in (*OURS, "fmus", "examples") for path in (ROOT / folder).rglob("*.*")
              if path.is_file() and path.suffix != ".pyc") / 1e6  # fmt: skip
    assert megabytes(distributions) + own <= 350.0


def imports(tree: ast.AST, guards: tuple[str, ...] = ()) -> Iterator[tuple[str, tuple[str, ...], int]]:
    """Yield the package, the extras of the enclosing `with needs(...)` and the line of each import."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        inside = guards
        if isinstance(node, ast.With):
            calls = [item.context_expr for item in node.items if isinstance(item.context_expr, ast.Call)]
            inside += tuple(call.args[0].value for call in calls if ast.unparse(call.func) == "needs")
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], guards, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.partition(".")[0], guards, node.lineno
        yield from imports(node, inside)


@pytest.mark.nightly
def test_every_import_of_an_optional_package_names_the_extra_that_installs_it():
    free = {*sys.stdlib_module_names, *OURS, *(name.partition(".")[0] for name in REQUIRED)}
    faults = []
    for path in sorted(path for package in OURS for path in (ROOT / package).rglob("*.py")):
        found = list(imports(ast.parse(path.read_text(encoding="utf-8"))))
        guarded = {package for package, guards, _ in found for extra in guards if package in packages(extra)}
        beside = {other.stem for other in path.parent.iterdir()}  # a law in an FMU imports the files beside it
        known = free | guarded | beside | (WINDOW if path.parent.name == "window" else set())
        faults += [f"{path}:{line}: {package}" for package, _, line in found if package not in known]
    assert not faults


def test_the_error_is_an_import_error_with_the_name_of_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "lief", None)
    with pytest.raises(MissingExtraError, match="checking needs lief") as caught, needs("check", "checking"):
        importlib.import_module("lief")
    assert isinstance(caught.value, ImportError) and (caught.value.name, caught.value.extra) == ("lief", "check")
    assert not is_installed("lief") and "lief" in missing("check")


def test_an_outer_block_names_the_extra_that_contains_the_inner_one(monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly", None)
    with (
        pytest.raises(MissingExtraError, match=r'building needs plotly.*eightpost\[build\]"'),
        needs("build", "building"),
        needs("report", "drawing"),
    ):
        importlib.import_module("plotly")


def test_a_module_that_no_extra_installs_stays_python_s_own_error():
    with pytest.raises(ModuleNotFoundError, match="no_such_module") as caught, needs("report", "drawing"):
        importlib.import_module("no_such_module")
    assert not isinstance(caught.value, MissingExtraError)
