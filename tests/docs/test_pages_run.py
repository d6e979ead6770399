"""The code blocks of the pages run, one after the other, in a folder with the reader's files."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.signals import read_series
from tests.docs.given import GIVEN, SHARED, Given
from tests.docs.page_blocks import ROOT, blocks, commands, pages

EXAMPLES = ROOT / "examples"

RUN = {
    path: found
    for page in pages()
    if (found := [block for block in blocks(page) if block.kind == "run"])
    for path in [page.relative_to(ROOT).as_posix()]
}

#: Study of two setups of 21 s instead of 2401 of 30 s.
_FEW = '[corners]\nlf = ["B/B", "C/C"]\nrf = ["B/B"]\nlr = ["B/B"]\nrr = ["B/B"]\n'


def lay_out(folder: Path) -> None:
    """Copy the examples to a folder, with short runs and a study of two setups."""
    shutil.copytree(EXAMPLES, folder / "examples")
    case = folder / "examples" / "seven_dof.toml"
    case.write_text(case.read_text().replace('stop = "30 s"', 'stop = "5 s"'))
    study = folder / "examples" / "study.toml"
    text = study.read_text().replace('stop = "30 s"', 'stop = "21 s"')
    text, count = re.subn(r"^# \[corners\].*\n# lf = .*\n", _FEW, text, flags=re.MULTILINE)
    assert count == 1
    study.write_text(text)


def call(line: str | list[str], codes: tuple[int, ...] = (0,)) -> str:
    """Run a command of eightpost in the current folder; return what it printed."""
    words = shlex.split(line) if isinstance(line, str) else line
    matched = [path for word in words for path in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]
    ran = CliRunner().invoke(main, matched)
    assert ran.exit_code in codes, f"eightpost {' '.join(words)}\n{ran.output}\n{ran.exception!r}"
    return ran.output


class Reader:
    """The folder of a page's reader, and the names of its python blocks."""

    def __init__(self, folder: Path, given: Given, take: Callable[..., None]) -> None:
        self.folder, self.given = folder, given
        self.names: dict[str, Any] = {
            "__name__": "page", "Path": Path, "shutil": shutil, "call": call, "take": take, "record": self.record,
        }  # fmt: skip
        exec(given.before, self.names)

    @staticmethod
    def record(name: str, *paths: str) -> None:
        """Copy a shipped dynamometer record."""
        for path in paths:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(EXAMPLES / "data" / f"{name}.csv", path)

    def python(self, text: str, place: str) -> None:
        """Run a python block in the names of the blocks before it."""
        exec(compile(text, place, "exec"), self.names)

    def command(self, words: list[str]) -> None:
        """Run a command of an sh block."""
        if words[0] == "eightpost":
            line = " ".join(map(shlex.quote, words))
            for long, short in self.given.shorter.items():
                line = line.replace(long, short)
            call([word.strip("'") if "*" in word else word for word in shlex.split(line)][1:], self.given.codes)
        else:
            subprocess.run(words, check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of what several pages need; each is made when the first page takes it."""
    folder = tmp_path_factory.mktemp("shared")
    lay_out(folder)
    text = (folder / "examples" / "seven_dof.toml").read_text()
    (folder / "system.toml").write_text(text.replace('"../dist', '"dist').replace('"data/', '"examples/data/'))
    return folder


@pytest.fixture
def take(shared: Path) -> Callable[..., None]:
    """Function that brings a shared file or folder to the current folder, under its own or another name."""

    def brought(name: str, wanted: str = "") -> None:
        here = Path.cwd()
        if not (shared / name).exists():
            if name == "car.json" and not (shared / "rig").exists():
                brought("rig", str(shared / "rig"))
            os.chdir(shared)
            try:
                for line in SHARED[name]:
                    call(line)
            finally:
                os.chdir(here)
        source, target = shared / name, here / (wanted or name)
        if source == target:
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        else:
            shutil.copy(source, target)
            for beside in (".fit.json", ".response.npz"):  # what `identify` writes beside the car
                if source.with_suffix(beside).exists():
                    shutil.copy(source.with_suffix(beside), target.with_suffix(beside))

    return brought


def check_python_developer(names: dict[str, Any]) -> None:
    assert names["fit"].percent < 4.0
    assert 500.0 < names["force"].std() < 1500.0
    assert abs(names["result"].energy["car.lf"].relative) < 1e-2


def check_simulation_engineer(names: dict[str, Any]) -> None:
    assert names["difference"] < 1e-6
    series = read_series("out/series.parquet")
    assert series.time[-1] == pytest.approx(5.0)
    assert 0.02 < series["car.lf.velocity"].std() < 0.3


#: What pages promise beyond commands that succeed.
PROMISES = {
    "docs/start/python_developer.md": check_python_developer,
    "docs/start/simulation_engineer.md": check_simulation_engineer,
}


@pytest.mark.nightly
@pytest.mark.usefixtures("all_platforms")  # pages check their FMUs, and a missing platform is a finding
@pytest.mark.parametrize("page", sorted(RUN))
def test_the_blocks_of_a_page_run_and_give_what_it_promises(page, tmp_path, monkeypatch, take):
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    reader = Reader(tmp_path, GIVEN.get(page, Given()), take)
    for block in RUN[page]:
        if block.language == "python":
            reader.python(block.text, block.place)
        else:
            for words in commands(block):
                reader.command(words)
    if page in PROMISES:
        PROMISES[page](reader.names)


def test_the_preparations_are_those_of_pages_with_blocks():
    assert set(GIVEN) <= set(RUN), "the page has moved, or has no block that is run"
    assert set(PROMISES) <= set(RUN)
