"""`eightpost new` writes a folder whose five commands run; it overwrites nothing."""

import re
import shlex

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.app.start import FILES


def call(*words):
    shown = CliRunner().invoke(main, list(map(str, words)), env={"COLUMNS": "200"})
    return shown.exit_code, shown.output


def commands(text):
    """Return the commands of a README's only block of code."""
    (block,) = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    return block.splitlines()


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "car7"
    code, text = call("new", path)
    assert code == 0, text
    return path


def run(lines, folder, monkeypatch):
    monkeypatch.chdir(folder)
    for line in lines:
        program, *words = shlex.split(line)
        code, text = call(*words)
        assert (program, code) == ("eightpost", 0), f"{line}\n{text}"


@pytest.mark.nightly
def test_the_five_commands_of_the_readme_succeed(folder, monkeypatch):
    run(commands((folder / "README.md").read_text(encoding="utf-8")), folder, monkeypatch)
    for product in ("shocks/dyno_A.json", "fmus/car.fmu", "run/report.html", "study/report.html"):
        assert (folder / product).is_file()


def test_the_makefile_has_the_same_commands(folder):
    recipes = [line[1:] for line in (folder / "Makefile").read_text(encoding="utf-8").splitlines() if line[:1] == "\t"]
    fits = [recipes[0].replace("$<", f"shocks/dyno_{x}.csv").replace("$@", f"shocks/dyno_{x}.json") for x in "AB"]
    build = recipes[1].replace("$^", "shocks/dyno_A.json shocks/dyno_B.json car.json")
    assert [*fits, build, *recipes[2:4]] == commands((folder / "README.md").read_text(encoding="utf-8"))


def test_every_file_that_the_readme_names_is_there(folder):
    rows = re.findall(r"^\| (`.*?`) \|", (folder / "README.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([^`]+)`", row)}
    assert named == set(FILES) - {"README.md", "Makefile"}
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} == set(FILES)


def test_a_folder_with_one_of_the_files_is_left_alone(tmp_path):
    (tmp_path / "car.json").write_text("my car")
    code, text = call("new", tmp_path)
    assert code == 2
    assert "car.json would be overwritten" in text
    assert [path.name for path in tmp_path.iterdir()] == ["car.json"]
    assert (tmp_path / "car.json").read_text() == "my car"


def test_a_folder_with_other_files_gets_the_starter(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert call("new", tmp_path)[0] == 0
    assert {"notes.txt", "study.toml"} <= {path.name for path in tmp_path.iterdir()}
