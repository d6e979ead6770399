"""`eightpost study` on a Dask cluster whose processes are killed: complete tables, clear messages, resumed studies."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.study.running.sweep import run_study
from cosim.study.study_file import read_study
from cosim.study.table import StudyResult
from eightpost import __version__

pytest.importorskip("distributed", reason="needs the extra dask")

from .conftest import TRACK
from .constructed import cells
from .dask_processes import PATIENCE, ROOT, Cluster, cluster, kill, wait_until

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")]

TEXT = """
name = "slow setups"
settling = "1 s"
{corners}

[vehicle]
fmu = "{car}"
means = "trusted"

[bank]
{bank}

[[drive]]
file = "{track}"
stop = "3 s"

[[measure]]
name = "total tire force"
channels = ["car.lf.tire_force", "car.rf.tire_force", "car.lr.tire_force", "car.rr.tire_force"]
statistic = "rms"

{more}
"""

#: A measure that takes a tenth of a second, so that there is time to kill a worker in the middle of a chunk.
SLOW = """
[[measure]]
name = "slow"
channels = ["car.lf.tire_force"]
function = "slow.py:slow"
unit = "N"
"""

FUNCTION = """
import time

def slow(response):
    time.sleep(0.1)
    return response.total.std()
"""


@pytest.fixture
def file(tmp_path: Path, fmus) -> Path:
    """Return a study file with 64 setups whose slow measure takes 6 s of worker time."""
    return written(tmp_path / "given", fmus, builds=4, more=SLOW)


def written(folder: Path, fmus, *, builds: int, more: str = "") -> Path:
    folder.mkdir()
    bank = "\n".join(
        f'b{k} = {{ fmu = "{fmus["lpnl2"]}", parameters = {{ rebound_scale = {0.7 + 0.1 * k:g} }} }}'
        for k in range(builds)
    )
    (folder / "slow.py").write_text(FUNCTION)
    path = folder / "study.toml"
    text = TEXT.format(car=fmus["seven_dof"], track=TRACK, bank=bank, more=more, corners='alike = [["lr", "rr"]]')
    path.write_text(text)
    return path


@pytest.fixture
def expected(file: Path, here, tmp_path: Path) -> dict[str, list[Any]]:
    """Return the table of the same study in one process."""
    return table(run_study(read_study(file), tmp_path / "alone", here))


def table(result: StudyResult) -> dict[str, list[Any]]:
    return cells(result.table, "seconds")


def start(file: Path, out: Path, address: str, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "eightpost", "study", str(file), "-o", str(out), "--workers", address]
    return subprocess.Popen(
        [*command, "--set", "certainty=no", *options],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def wait_for_chunk(out: Path, main: subprocess.Popen[str]) -> None:
    wait_until(lambda: any(out.glob("chunks/*/chunk_*.parquet")) or main.poll() is not None)
    assert main.poll() is None, main.communicate(timeout=PATIENCE)[0]


def load(out: Path) -> StudyResult:
    return StudyResult.load(out / "results.parquet")


def test_a_worker_that_stops_responding_is_ended_and_its_setups_run_elsewhere(file, expected, tmp_path):
    with cluster(tmp_path, 2) as (made, workers):
        made.wait_for_workers(2)
        main = start(file, tmp_path / "out", made.address, "--set", "patience=3 s")
        wait_for_chunk(tmp_path / "out", main)
        os.kill(workers[0].pid, signal.SIGSTOP)  # it keeps its connection and its chunk
        output = main.communicate(timeout=PATIENCE)[0]
        assert main.returncode == 0, output
    assert "was not responding for more than 3 s and is ended" in " ".join(output.split())
    found = load(tmp_path / "out")
    assert not found.partial and table(found) == expected


#: Hangs in one setup, once the coupling is chosen.
HANGS = """
import time
from pathlib import Path
from typing import Any

def slow(response):
    while abs(response.total.std() / {level!r} - 1.0) < 1e-9 and [*Path({out!r}).rglob("coupling.json")]:
        time.sleep(1.0)
    return 1.0
"""


def test_a_setup_that_hangs_fails_alone_and_workers_with_a_nanny_come_back(fmus, here, tmp_path):
    path = written(tmp_path / "given", fmus, builds=2, more=SLOW)
    alone = run_study(read_study(path), tmp_path / "alone", here)
    lost = len(alone) // 2
    level = float(alone.values("slow")[lost])
    (path.parent / "slow.py").write_text(HANGS.format(level=level, out=str(tmp_path / "out")))
    with cluster(tmp_path, 0) as (made, _):
        made.start_worker(nanny=True)
        made.wait_for_workers(1)
        main = start(path, tmp_path / "out", made.address, "--set", "patience=15 s")
        output = main.communicate(timeout=PATIENCE)[0]
        assert main.returncode == 1, output
    found = load(tmp_path / "out")
    assert np.flatnonzero(~found.done).tolist() == [lost] and "failed" in output


@pytest.mark.parametrize(("lost", "words"), [
    ("workers", ("there are no workers; waiting 2 s for some",
                 "Completed chunks are kept; run the study again to resume when there are workers")),
    ("scheduler", ("the Dask scheduler has ended", "run the study again to resume")),
])  # fmt: skip
def test_without_workers_or_scheduler_the_partial_table_is_kept_and_others_complete_it(
    file, expected, tmp_path, lost, words
):
    with cluster(tmp_path, 2) as (made, workers):
        made.wait_for_workers(2)
        main = start(file, tmp_path / "out", made.address, "--set", "patience=2 s")
        wait_for_chunk(tmp_path / "out", main)
        for process in workers if lost == "workers" else [made.scheduler]:
            kill(process)
        output = main.communicate(timeout=PATIENCE)[0]
        assert main.returncode == 1 and all(text in output for text in words), output
        part = load(tmp_path / "out")
        assert part.partial and 0 < len(part) < 64
        if lost == "scheduler":
            made.start_scheduler()
        made.start_worker()
        again = start(file, tmp_path / "out", made.address)
        assert f"{64 - len(part)} to be run" in again.communicate(timeout=PATIENCE)[0]
    assert table(load(tmp_path / "out")) == expected


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_study_has_a_partial_table_and_resumes_on_this_machine(file, expected, here, tmp_path, number):
    with cluster(tmp_path, 1) as (made, _):
        main = start(file, tmp_path / "out", made.address)
        wait_for_chunk(tmp_path / "out", main)
        main.send_signal(number)
        output = main.communicate(timeout=PATIENCE)[0]
        assert main.returncode == 1, output
    part = load(tmp_path / "out")
    assert part.partial and 0 < len(part) < 64 and "partial: run it again with the same folder" in output
    assert table(run_study(read_study(file), tmp_path / "out", here)) == expected
    assert len(here.ran) == 64 + 64 - len(part), "the reference ran all setups, the resumed study the others"


# ---- Workers that differ --------------------------------------------------------------------------------------------


def test_a_worker_with_another_version_of_the_program_is_named(file, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    for package in ("cosim", "eightpost", "builder", "fmus"):
        shutil.copytree(ROOT / package, other / package, ignore=shutil.ignore_patterns("__pycache__"))
    changed = other / "cosim" / "study" / "table.py"
    changed.write_text(changed.read_text() + "\n# another version\n")
    with cluster(tmp_path, 0) as (made, _):
        made.start_worker(path=other)
        main = start(file, tmp_path / "out", made.address)
        output = " ".join(main.communicate(timeout=PATIENCE)[0].split())
    assert main.returncode == 1, output
    assert f"has eightpost {__version__} with other sources, but the same ones are required" in output
    assert "install the same one on it, or stop it" in output


#: Preloaded by a worker: a processor with fewer instructions, or a machine without a compiler.
OLD = "from eightpost.machine import car\ncar.instruction_set = lambda: ''\n"
BARE = """
from eightpost.errors import FmuError
from eightpost.machine import run

def compiled(*arguments, **options):
    raise FmuError("no C compiler was found")

run.compiled = compiled
"""


def run_mixed(made: Cluster, folder: Path, study: Path, preload: str) -> tuple[StudyResult, str]:
    """Choose the coupling on this machine, and run all setups on a worker that differs from it."""
    (folder / "preload.py").write_text(preload)
    made.start_worker("--preload", str(folder / "preload.py"))
    output = start(study, folder / "out", made.address).communicate(timeout=PATIENCE)[0]
    return load(folder / "out"), " ".join(output.split())


@pytest.mark.parametrize(
    ("preload", "reported", "apart"), [(OLD, False, 1e-12), (BARE, True, 1e-4)], ids=["old processor", "no compiler"]
)
def test_another_processor_differs_in_the_last_digits_and_a_worker_without_compiler_is_reported(
    fmus, here, tmp_path, preload, reported, apart
):
    study = written(tmp_path / "given", fmus, builds=2)
    alone = run_study(read_study(study), tmp_path / "alone", here)
    assert alone.provenance.settings["coupling"]["machine"] is not None
    coupling = next((tmp_path / "alone").glob("chunks/*/coupling.json"))
    other = tmp_path / "out" / "chunks" / coupling.parent.name
    other.mkdir(parents=True)
    shutil.copy(coupling, other)
    with cluster(tmp_path, 0) as (made, _):
        found, output = run_mixed(made, tmp_path, study, preload)
    assert ("runs its setups through the FMUs, whose measures differ within the" in output) is reported, output
    assert ("no C compiler was found" in output) is reported
    assert 0.0 < found.column("coupling_error_percent").max() < 1.0  # known for every setup, also through the FMUs
    assert found.values("total tire force") == pytest.approx(alone.values("total tire force"), rel=apart)
