"""Every verb finds the installed packages, whatever files the user's folder contains."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from eightpost.name_clash import THIRD_PARTY, _clashing_files
from eightpost.workers.process import ROOT, _import_path

NAMES = ("builder", "cosim", "numpy", "json", "fmpy", "logging", "eightpost_", "click", "subprocess", "ziglang")


def environment(*path):
    """Return an environment with these folders in PYTHONPATH; the packages are found in any case."""
    rest = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    return rest | {"PYTHONPATH": os.pathsep.join([*map(str, path), str(ROOT)])}


@pytest.fixture
def crowded(tmp_path):
    """A folder with a file of each name, and each of them ends the process that imports it."""
    folder = tmp_path / "mine"
    folder.mkdir()
    for name in NAMES:
        (folder / f"{name}.py").write_text("raise SystemExit('a file of the user was imported')\n", encoding="utf-8")
    return folder


def ran(folder, *words, path=(), start=("-m", "eightpost")):
    line = [sys.executable, *start, *map(str, words)]
    return subprocess.run(line, cwd=folder, env=environment(*path), capture_output=True, text=True, check=False)


@pytest.mark.nightly  # every change: the last test starts processes with the same command as the probes of a check
def test_check_passes_an_fmu_from_a_folder_with_clashing_names(fmus, crowded):
    """The files in the folder affect neither the check nor its probes, including the rebuild."""
    shown = ran(crowded, "check", "--json", fmus["lpnl2"])
    (report,) = json.loads(shown.stdout)["reports"]
    assert report["findings"] == []
    assert shown.returncode == 0
    assert {"simulation", "state", "surroundings"} <= set(report["groups"])
    assert sorted(path.name for path in crowded.iterdir()) == sorted(f"{name}.py" for name in NAMES)


@pytest.mark.repeated
@pytest.mark.parametrize("verb", ["fit", "study"])
def test_a_verb_starts_in_a_folder_with_clashing_names(verb, crowded):
    shown = ran(crowded, verb, "--help")
    assert (shown.returncode, shown.stderr) == (0, "")


@pytest.mark.parametrize(
    "name", ["builder", "json", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("cosim", "numpy", "fmpy"))]
)
def test_a_clash_that_remains_is_an_error_that_names_the_file(name, tmp_path):
    (tmp_path / f"{name}.py").write_text("", encoding="utf-8")
    for start in (("-m", "eightpost"), (script(tmp_path),)):
        shown = ran(tmp_path, "check", "x.fmu", path=[tmp_path], start=start)
        assert shown.returncode == 2
        assert str(tmp_path / f"{name}.py") in shown.stderr and "rename the file" in shown.stderr
        assert "Traceback" not in shown.stderr


def script(folder):
    """The console script as an installer writes it."""
    path = Path(folder, "bin", "eightpost")
    path.parent.mkdir(exist_ok=True)
    path.write_text("from eightpost.__main__ import main\nmain()\n", encoding="utf-8")
    return path


def test_a_package_of_the_same_name_is_a_clash_and_a_folder_of_that_name_is_not(tmp_path):
    (tmp_path / "builder").mkdir()
    assert _clashing_files([str(tmp_path), *sys.path]) == []
    (tmp_path / "builder" / "__init__.py").touch()
    assert _clashing_files([str(tmp_path), str(ROOT)]) == [str(tmp_path / "builder" / "__init__.py")]
    assert _clashing_files([str(ROOT), str(tmp_path)]) == []


def test_the_third_party_packages_are_folders_and_are_all_that_the_project_needs():
    project = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    needed = [
        *project["dependencies"],
        *(
            line
            for name, lines in extras.items()
            if name not in ("test", "docs") and "host" not in name
            for line in lines
        ),
    ]
    module = {"arro3-core": "arro3", "arro3-io": "arro3", "fmu-manipulation-toolbox": "fmu_manipulation_toolbox",
              "markdown-it-py": "markdown_it", "pillow": "PIL", "python-calamine": "python_calamine"}  # fmt: skip
    names = {name.partition(">")[0].partition("[")[0].strip() for name in needed}
    files = {"eightpost", "ipykernel", "lvm_read", "threadpoolctl", "typing-extensions"}  # no folders, or not imported
    assert {module.get(name, name) for name in names} - files <= set(THIRD_PARTY)


def test_a_child_searches_where_this_process_does_but_not_in_the_current_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), "relative", str(ROOT)])
    monkeypatch.chdir(tmp_path)
    assert _import_path() == [str(tmp_path / "relative"), str(ROOT)]


SYSTEM = """
schema = 1
name = "a quarter car"
[components]
corner = {{ fmu = "{car}", inputs = {{ aero_force = 0.0 }} }}
shock = {{ fmu = "{shock}" }}
[[bond]]
between = ["corner", "shock"]
[scenario]
drivefile = "{root}/examples/data/track.parquet"
stop = "0.1 s"
[scenario.targets]
"lf.road" = "corner.road"
"""


@pytest.mark.nightly
def test_an_isolated_fmu_runs_from_a_folder_with_clashing_names(fmus, crowded):
    files = {"car": fmus["quarter_car"].as_posix(), "shock": fmus["lpnl2"].as_posix(), "root": ROOT.as_posix()}
    (crowded / "system.toml").write_text(SYSTEM.format(**files), encoding="utf-8")
    shown = ran(crowded, "run", "system.toml", "--isolate", "-o", "out")
    said = shown.stderr + shown.stdout
    assert "was imported" not in said and "Traceback" not in said
    assert (crowded / "out").is_dir() and shown.returncode in (0, 1), said
