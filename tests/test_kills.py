"""A long command that is killed at any moment leaves no process and no half-written file; the next call is whole."""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest

from eightpost.corners import CORNERS
from eightpost.signals.parquet_file import read_table

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")]

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
RIG = " ".join(f"../inputs/rig/{test}.parquet" for test in ("baseline", *(f"alternate_{c}" for c in CORNERS)))
RECORD = "../inputs/lap/pass_01/record.parquet"
FMUS = "../inputs/fmus"

#: Words of each command, with the output folder `out` in the folder where it is called.
COMMANDS = {
    "identify": f"identify {RIG} -o out/car.json",
    "study": "study ../inputs/study.toml -o out --workers 2",
    "run": f"run {FMUS}/system.toml -o out --report",  # with an empty cache, so that loops are compiled
    "isolated": f"run {FMUS}/short.toml -o out --isolate",
    "fit": f"fit {EXAMPLES}/data/dyno_A.csv -o out/shock.json",
    "check": f"check --json {FMUS}/dyno_A.fmu {FMUS}/car.fmu",
    "drivefile": f"drivefile next out --record {RECORD}",
    "demo": "demo -o out",
    "build": f"build {FMUS}/dyno_A.json {EXAMPLES}/car.toml -o out",
    "virtual": "virtual rig --program identification --set duration=20s -o out",
    "simulate": "drivefile simulate out",
    "validate": f"validate {FMUS}/dyno_A.json {EXAMPLES}/data/dyno_A.csv -o out/dyno_A.html",
    "report": f"report {EXAMPLES}/data/dyno_A.csv {EXAMPLES}/data/dyno_B.csv {FMUS}/dyno_C.json -o out/report.html",
    "optimise": "study optimise ../inputs/study.toml -o out --workers 2",
    "shapes": f"study shapes {EXAMPLES}/identified/study.toml -o out --workers 2 --at lr --vary rebound.low",
}
#: Text of the seed of the moments; another one is another set of kills.
SEED = os.environ.get("EIGHTPOST_KILLS", "")
#: How a command is ended: the signal, and whether its whole group receives it.
ENDS = {
    "KILL": (signal.SIGKILL, False),
    "KILL of the group": (signal.SIGKILL, True),
    "TERM": (signal.SIGTERM, False),
    "INT of the group": (signal.SIGINT, True),
}


@dataclass(frozen=True)
class Place:
    """A folder in which a command is called, with temporary files and caches of its own."""

    path: Path

    def start(self, words: str) -> subprocess.Popen[str]:
        temporary = self.path / "temporary"
        temporary.mkdir(parents=True, exist_ok=True)
        environment = {**os.environ, "TMPDIR": str(temporary), "EIGHTPOST_TEST_PLACE": str(self.path)}
        if words.startswith(f"run {FMUS}/system"):
            environment["EIGHTPOST_CACHE"] = str(self.path / "cache")
        before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
        try:
            return subprocess.Popen(
                [sys.executable, "-m", "eightpost", *words.split()], cwd=self.path, env=environment, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
            )  # fmt: skip
        finally:
            signal.signal(signal.SIGINT, before)

    def call(self, words: str) -> tuple[str, float]:
        """Call a command to its end; return its output and its duration [s]."""
        began = time.monotonic()
        command = self.start(words)
        output, errors = command.communicate(timeout=600)
        assert command.returncode == 0, output + errors
        return output, time.monotonic() - began

    def running(self) -> list[psutil.Process]:
        """Return the processes that a command in this folder started and that still run."""
        return [process for process in psutil.process_iter() if self._runs(process)]

    def _runs(self, process: psutil.Process) -> bool:
        try:
            ours = process.environ().get("EIGHTPOST_TEST_PLACE") == str(self.path)
            return ours and process.status() != psutil.STATUS_ZOMBIE
        except psutil.Error:
            return False

    def temporary(self) -> list[str]:
        return [str(path) for path in (self.path / "temporary").rglob("*")]

    def results(self) -> dict[str, object]:
        """Return what is the same in each run for each file of the output; every file must be whole."""
        files = [path for path in sorted((self.path / "out").rglob("[!.]*")) if path.is_file()]
        found = {path.relative_to(self.path): content_of(path) for path in files}
        return {str(path): content for path, content in found.items() if "chunks" not in path.parts}

    def hidden(self) -> list[str]:
        return [str(path) for path in (self.path / "out").rglob(".*")]


def content_of(path: Path) -> object:
    """Read a file, which must be whole; return what is the same in each run."""
    content = path.read_bytes()
    if path.suffix == ".json":
        return timeless(json.loads(content))
    if path.suffix == ".parquet":
        return {name: repr(values.tolist()) for name, values in read_table(path).columns.items() if name != "seconds"}
    if path.suffix in (".fmu", ".xlsx", ".npz"):
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            return sorted(archive.namelist()) if path.suffix == ".xlsx" else content
    if path.suffix == ".html":
        assert content.rstrip().endswith(b"</html>")
        return "page"
    if path.suffix == ".png":
        assert content.endswith(b"IEND\xaeB`\x82")
    assert content.endswith(b"\n") or path.suffix == ".png", path
    return "ranking" if path.name == "ranking.csv" else content


def timeless(content: Any) -> Any:
    """Return the content of a JSON file without wall times and without the digest of what has them."""
    if isinstance(content, dict):
        return {k: timeless(v) for k, v in content.items() if not k.endswith("seconds") and k != "judged"}
    return [timeless(value) for value in content] if isinstance(content, list) else content


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the inputs of all commands."""
    root = tmp_path_factory.mktemp("kills")
    here = Place(root / "inputs")
    here.call("virtual rig --program identification --set duration=40s -o rig")
    here.call("virtual rig --test track --set duration=12s -o track.parquet")
    here.call(f"drivefile start track.parquet --car {EXAMPLES}/identified/car.json -o start")
    shutil.copytree(here.path / "start", here.path / "lap")
    command = here.start("drivefile simulate lap --passes 1")
    command.communicate(timeout=600)
    for build in "ABC":
        here.call(f"fit {EXAMPLES}/data/dyno_{build}.csv --law lpnl2 --gas included -o fmus/dyno_{build}.json")
    here.call(f"build fmus/dyno_A.json fmus/dyno_B.json fmus/dyno_C.json {EXAMPLES}/car.toml -o fmus")
    text = (EXAMPLES / "seven_dof.toml").read_text().replace("../dist/", "").replace('"data/', f'"{EXAMPLES}/data/')
    (here.path / "fmus" / "system.toml").write_text(text)
    (here.path / "fmus" / "short.toml").write_text(text.replace('stop = "30 s"', 'stop = "3 s"'))
    text = re.sub(r"\[bank\].*?\n\n", BANK, (EXAMPLES / "study.toml").read_text(), flags=re.DOTALL)
    text = text.replace("car.toml", "fmus/car.fmu").replace('"data/', f'"{EXAMPLES}/data/')
    text = text.replace('# alike = [["lf", "rf"], ["lr", "rr"]]', 'alike = [["lf", "rf"]]')
    (here.path / "study.toml").write_text(text.replace('baseline = "B/B"', 'baseline = "A"'))
    return here.path


BANK = '[bank]\nA = "fmus/dyno_A.fmu"\nB = "fmus/dyno_B.fmu"\nC = "fmus/dyno_C.fmu"\n\n'


def place_of(inputs: Path, name: str, command: str) -> Place:
    """Return a new folder beside the inputs, with the iteration if the command is that of a drive file."""
    place = Place(inputs.parent / name)
    place.path.mkdir()
    if command in ("drivefile", "simulate"):
        shutil.copytree(inputs / "start", place.path / "out")
    return place


@dataclass(frozen=True)
class Whole:
    """Results of a command that was not killed, its output, and its duration [s]."""

    results: dict[str, object]
    output: str
    seconds: float


@pytest.fixture(scope="module", params=COMMANDS)
def command(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def whole(inputs: Path, command: str) -> Iterator[Whole]:
    place = place_of(inputs, command, command)
    output, seconds = place.call(COMMANDS[command])
    results = place.results()
    shutil.rmtree(place.path)
    yield Whole(results, output, seconds)


@pytest.mark.parametrize("end", ENDS)
def test_a_killed_command_leaves_nothing_and_the_next_one_has_the_same_result(
    inputs: Path, command: str, whole: Whole, end: str
) -> None:
    number, to_group = ENDS[end]
    place = place_of(inputs, f"{command}_{end.replace(' ', '_')}", command)
    moment = random.Random(f"{command} {end}{SEED}").uniform(0.0, 0.95 * whole.seconds)
    code = 0
    while code == 0:
        killed = place.start(COMMANDS[command])
        while not place.temporary() and killed.poll() is None:  # before, Ctrl-C ends the imports as in any program
            time.sleep(0.01)
        time.sleep(moment)
        (os.killpg if to_group else os.kill)(killed.pid, number)
        output, errors = killed.communicate(timeout=60)
        assert "Traceback" not in output + errors, errors
        code, moment = killed.returncode, 0.5 * moment  # it may have been complete before
    until = time.monotonic() + 10.0
    while (left := place.running()) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left, f"after {moment:.2f} s of {whole.seconds:.2f} s: {[process.cmdline() for process in left]}"
    if number != signal.SIGKILL:  # otherwise the process that removes them may be gone, and the next command does
        assert not place.temporary(), f"after {moment:.2f} s of {whole.seconds:.2f} s"
    half = place.results()
    place.call(COMMANDS[command])
    assert not place.temporary() and not place.hidden()
    results = place.results()
    assert set(results) == set(whole.results), f"after {moment:.2f} s; left: {sorted(half)}"
    assert [name for name, content in results.items() if content != whole.results[name]] == []
    shutil.rmtree(place.path)
