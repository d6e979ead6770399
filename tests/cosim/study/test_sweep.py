"""Exhaustive study: results agree with the master's, independent of interruptions and workers."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cosim
from cosim.study import Build, Constraint, Drive, Measure, Term
from cosim.study.definition import read_drive
from cosim.study.running.evaluator import Coupling, Evaluator, coupling_of, traces
from cosim.study.running.sweep import BATCH, ChunkFolder, Cutter, Sweep, gaps, run_study
from cosim.study.running.workers import Chunk, ProcessWorkers
from cosim.study.table import StudyResult, study_schema
from eightpost.corners import CORNERS
from eightpost.errors import FileFormatError
from eightpost.outputs import recorded
from eightpost.signals import Drivefile
from eightpost.signals.parquet_file import joined
from eightpost.workers.pool import _Heartbeats
from tests.unchanged import refusals

from .conftest import WorkersHere
from .constructed import cells, result

#: What may differ between two runs of the same study.
CLOCK = "seconds"


def clockless(result: StudyResult) -> dict[str, list[Any]]:
    return cells(result.table, CLOCK)


@pytest.fixture(scope="module")
def whole_study(small_study, tmp_path_factory):
    """Return the folder and the result of a study that ran without interruption."""
    folder = tmp_path_factory.mktemp("sweep") / "whole_study"
    return folder, run_study(small_study(), folder, WorkersHere())


@pytest.fixture
def finished(whole_study, tmp_path):
    """Return that result, with a copy of its folder in tmp_path / "whole_study"."""
    folder, result = whole_study
    shutil.copytree(folder, tmp_path / "whole_study")
    return result


def test_every_setup_has_a_row_with_all_columns(finished):
    columns = ["setup", *CORNERS, "front ride height, RMS", "total tire force, RMS", "status", "message",
               "coupling_error_percent", "marks", "seconds", "coupling error of front ride height, RMS",
               "coupling error of total tire force, RMS"]  # fmt: skip
    assert list(finished.table.columns) == columns
    assert finished.setups.tolist() == list(range(16)) and finished.done.all() and not finished.partial
    assert finished.table.schema.field("front ride height, RMS").metadata == {
        b"unit": b"m", b"display": b"in", b"label": b"front ride height, RMS"
    }  # fmt: skip
    guids, digests = (one.values() for one in (finished.provenance.guids, finished.provenance.digests))
    assert len({*guids}) == 2 and all(guid.startswith("{") for guid in guids) and {len(d) for d in digests} == {64}


def test_a_row_equals_the_masters_result_for_that_setup(finished, fmus):
    study, row = finished.study, 0b0110
    builds = finished.setup(row).builds
    assert builds == {"lf": "soft", "rf": "stiff", "lr": "stiff", "rr": "soft"}
    system = cosim.System.load(
        {"car": fmus["seven_dof"], **dict.fromkeys(CORNERS, fmus["lpnl2"])},
        [cosim.Bond.between(f"car.{corner}", corner) for corner in CORNERS],
        parameters={corner: study.bank[build].parameters for corner, build in builds.items()},
    )
    scenario = cosim.Scenario(4.0, Drivefile.read(study.drives[0].file), record_step=4e-3, settling=1.0)
    coupling = finished.provenance.settings["coupling"]
    run = cosim.run(system, scenario, algorithm=cosim.GaussSeidel(values="parabolic"), step=coupling["step"])
    expected = np.std(run.settled()["car.front.ride_height"])
    assert finished.values("front ride height, RMS")[row] == pytest.approx(expected, rel=1e-4)
    trace = traces(finished, [row])[row]
    assert trace["car.front.ride_height"] == pytest.approx(run.series["car.front.ride_height"], abs=2e-3 * expected)


def test_the_coupling_error_of_rows_bounds_the_error_found_at_an_eighth_of_the_step(finished):
    """The errors of the measures are checked."""
    study, space = finished.study, finished.study.space

    coupling, evaluator = coupling_of(finished), Evaluator(study)
    assert study.measures
    for row in (0, 5, 15):
        fine = evaluator.row(space.setup(row), replace(coupling, step=coupling.step / 8))
        for measure in study.measures:
            found = finished.values(measure.name)[row]
            assert abs(found / fine[measure.name] - 1.0) < 0.01 * study.accuracy


@pytest.mark.slow
def test_a_study_that_was_killed_resumes_with_the_same_result(small_study, here, finished, tmp_path):
    sweep = Sweep(small_study(), tmp_path / "killed")
    coupling = sweep.coupling(here)

    def kill(done, _total):
        if done == 8:
            raise RuntimeError("the machine went down")

    here.ran.clear()
    with pytest.raises(RuntimeError):
        sweep.run(here, coupling, kill)
    assert not sweep.path.exists() and sweep.left == 8
    again = run_study(small_study(), tmp_path / "killed", here)
    assert sorted(here.ran) == list(range(16)), "nothing is lost, nothing is done twice"
    assert clockless(again) == clockless(finished)


def test_objective_and_constraints_may_change_without_a_new_run(small_study, here, finished, tmp_path):
    here.ran.clear()
    bound = float(np.median(finished.values("total tire force, RMS")))
    other = small_study(
        name="another name",
        objective=(Term("front ride height, RMS", 2.0, "in"), Term("total tire force, RMS", 0.01, "lbf")),
        constraints=(Constraint("total tire force, RMS", at_most=bound),),
    )
    result = run_study(other, tmp_path / "whole_study", here)
    assert here.ran == []
    expected = 2.0 * finished.values("front ride height, RMS") / 0.0254
    expected += 0.01 * finished.values("total tire force, RMS") / 4.4482216152605
    assert result.objective == pytest.approx(expected)
    ranked = result.ranking()
    assert (result.values("total tire force, RMS")[ranked] <= bound).all() and 0 < ranked.size < 16
    assert (np.diff(result.objective[ranked]) >= 0.0).all()


@pytest.mark.nightly
def test_a_changed_study_is_run_again(small_study, here, tmp_path, finished):
    here.ran.clear()
    run_study(small_study(settling=1.5), tmp_path / "whole_study", here)
    assert len(here.ran) == 16


def test_setups_beyond_a_shocks_fitted_range_are_marked(small_study, here, fmus, tmp_path):
    study = small_study()
    narrow = Build(fmus["lpnl2"], {"curve.compression_speed": 0.05, "curve.rebound_speed": 0.05})
    corners = dict.fromkeys(CORNERS, ("stiff",)) | {"lf": ("stiff", "narrow")}
    result = run_study(small_study(bank={**study.bank, "narrow": narrow}, corners=corners), tmp_path, here)
    plain, marked = result.table["marks"]
    assert "lf beyond its fitted velocities" in marked and "lf beyond" not in plain


@pytest.mark.nightly
def test_several_processes_and_one_that_is_killed_give_the_same_table(small_study, here, tmp_path):
    """A measure kills the worker, as an FMU that crashes would."""
    (tmp_path / "mine.py").write_text(
        "import os, pathlib\n"
        "HERE = pathlib.Path(__file__).parent\n"
        "def rms(response):\n"
        "    if (HERE / 'armed').exists():\n"
        "        (HERE / 'armed').unlink()\n"
        "        os._exit(1)\n"
        "    return response.total.std()\n"
    )
    own = Measure("own", ("car.rear.ride_height",), function=f"{tmp_path}/mine.py:rms")
    study = small_study(
        measures=(own,), corners=dict.fromkeys(CORNERS[:2], ("soft", "stiff")) | {"lr": ("soft",), "rr": ("soft",)}
    )
    alone = run_study(study, tmp_path / "alone", here)
    (tmp_path / "armed").touch()
    workers = ProcessWorkers(2)
    try:
        sweep = Sweep(study, tmp_path / "pool")
        several = sweep.run(workers, coupling_of(alone))
    finally:
        workers.close()
    assert not (tmp_path / "armed").exists()
    assert several.done.all() and clockless(several) == clockless(alone)


@pytest.mark.nightly
def test_a_setup_that_hangs_is_ended_and_listed_and_the_rest_is_kept(small_study, here, tmp_path, monkeypatch):
    """A measure hangs the worker, as an FMU that hangs would.

    Only a worker that hangs has two seconds: loading the loop takes longer on a busy machine.
    """
    corners = dict.fromkeys(CORNERS, ("stiff",)) | {"lf": ("soft", "stiff")}
    plain = run_study(small_study(corners=corners), tmp_path / "plain", here)
    levels = plain.values("front ride height, RMS")
    (tmp_path / "mine.py").write_text(
        "import os, pathlib, time\n"
        "HERE = pathlib.Path(__file__).parent\n"
        "def rms(response):\n"
        f"    while response.total.std() > {levels.mean()}:\n"
        "        (HERE / f'hung_{os.getpid()}').touch()\n"
        "        time.sleep(60.0)\n"
        "    return response.total.std()\n"
    )
    own = Measure("own", ("car.front.ride_height",), function=f"{tmp_path}/mine.py:rms")
    end = _Heartbeats.end_unresponsive

    def patient(heartbeats, patience):
        hung = any((tmp_path / f"hung_{process}").exists() for process in heartbeats._processes[:])
        return end(heartbeats, patience if hung else 300.0)

    monkeypatch.setattr(_Heartbeats, "end_unresponsive", patient)
    workers = ProcessWorkers(1, patience=2.0)
    try:
        sweep = Sweep(small_study(corners=corners, measures=(own,)), tmp_path / "hanging")
        found = sweep.run(workers, coupling_of(plain))
    finally:
        workers.close()
    hung = levels > levels.mean()
    assert (found.done == ~hung).all()
    assert found.values("own")[~hung] == pytest.approx(levels[~hung], rel=1e-12)
    (message,) = found.table["message"][hung]
    assert len(list(tmp_path.glob("hung_*"))) == 2, "in a chunk, and alone"
    assert "not responding for 2 s" in message and "hangs" in message


def test_a_run_may_use_its_drive_file_from_the_first_to_the_last_sample_and_no_more(tmp_path, unchanged):
    path = tmp_path / "drive.csv"
    path.write_text("time [s],lf.road [m]\n" + "".join(f"{2.0 + 0.25 * k},{0.5 * k}\n" for k in range(13)))
    drive = Drive("part", path, stop=3.0, start=2.0)  # the file contains 2 to 5 s
    assert read_drive(drive).sample(np.array([2.0, 4.0, 5.0])).tolist() == [[0.0, 4.0, 6.0]]
    unchanged(refusals({"earlier": lambda: read_drive(replace(drive, start=1.9)),
                        "later": lambda: read_drive(replace(drive, stop=3.1))}))  # fmt: skip


# ==== Chunks of a study: every setup once, whatever was completed before; a result that is never half of one =========

RANGES = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 20)).map(lambda p: range(8 * p[0], 8 * sum(p))))


# ---- Which setups are run -------------------------------------------------------------------------------------------


@pytest.mark.nightly
@given(done=RANGES, count=st.integers(0, 700), cost=st.floats(1e-5, 10.0), workers=st.integers(0, 64))
def test_every_setup_that_is_not_completed_is_in_one_chunk(done, count, cost, workers):
    numbers = 3 * np.arange(count)
    cutter = Cutter(numbers, done, lambda: workers)
    completed = set().union(*done) if done else set()
    expected = [3 * k for k in range(count) if k not in completed]
    assert cutter.left == len(expected)
    found = []
    for chunk in cutter:
        assert numbers[chunk.number] == chunk.indices[0]
        assert chunk.number % BATCH == 0, "a batch is not divided"
        found += chunk.indices
        cutter.learn([{"seconds": cost}] * len(chunk.indices))
    assert found == expected and cutter.left == 0


@given(done=RANGES, count=st.integers(0, 700))
def test_gaps_and_completed_ranges_cover_everything_once(done, count):
    open_ = [k for part in gaps(done, count) for k in part]
    assert open_ == [k for k in range(count) if not any(k in part for part in done)]


@pytest.mark.parametrize(("cost", "largest"), [(1e-4, 1024), (0.02, 96), (0.1, 16), (10.0, 8)])
def test_chunks_take_some_seconds_and_all_workers_end_together(cost, largest):
    cutter, sizes = Cutter(np.arange(20_000), (), lambda: 4), []
    for chunk in cutter:
        sizes.append(len(chunk.indices))
        cutter.learn([{"seconds": cost}] * len(chunk.indices))
    assert sizes[0] == BATCH and max(sizes) == largest
    assert sizes[-1] <= BATCH and all(size * cost <= 2.5 or size == BATCH for size in sizes)


def test_chunks_of_one_worker_grow_and_the_last_one_has_what_is_left():
    cutter, sizes = Cutter(np.arange(1000), (), lambda: 1), []
    for chunk in cutter:
        sizes.append(len(chunk.indices))
        cutter.learn([{"seconds": 1e-4}] * len(chunk.indices))
    assert sizes == [8, 32, 128, 512, 320]


# ---- Files of the chunks, and the result ----------------------------------------------------------------------------


@pytest.fixture
def whole() -> StudyResult:
    """Return a result of 2401 setups of which one failed and two are marked."""
    return result(
        {"a": lambda digits: digits @ (4.0, 3.0, 2.0, 1.0), "b": lambda digits: -digits[:, 0] + 0.01 * digits[:, 3]},
        marks={3: "coupling error 1 %", 9: "lf beyond its fitted velocities"},
        failed=(5,),
        baseline=dict.fromkeys(("lf", "rf", "lr", "rr"), "B/B"),
    )


@pytest.fixture
def folder(whole, tmp_path) -> ChunkFolder:
    """Return a folder with all setups in chunks of 100, and one chunk that repeats 50 of them."""
    found = ChunkFolder(tmp_path, "0" * 64, study_schema(whole.study, whole.provenance.measure_units))
    rows = whole.table.rows()
    for first in range(0, len(rows), 100):
        found.write(Chunk(first, ()), rows[first : first + 100])
    found.write(Chunk(150, ()), rows[150:200])
    return found


def test_a_resumed_command_completes_the_coupling_that_it_has_read(folder: ChunkFolder) -> None:
    for step in (1e-3, 2e-3):
        with recorded([]):
            before = folder.coupling()
            folder.keep_coupling(Coupling("gauss-seidel", step))
    assert before == Coupling("gauss-seidel", 1e-3) and folder.coupling() == Coupling("gauss-seidel", 2e-3)


def test_joined_chunks_are_the_table(folder: ChunkFolder, whole: StudyResult) -> None:
    assert cells(joined(folder.tables(), whole.table.schema)) == cells(whole.table)
    folder.clear()
    assert folder.completed == () and list(folder.tables()) == []


def test_a_result_that_cannot_be_completed_leaves_the_old_one(folder, whole, tmp_path):
    path = tmp_path / "results.parquet"
    whole.save(path)
    before = path.read_bytes()
    (damaged,) = tmp_path.glob("chunks/*/chunk_0001200_100.parquet")
    damaged.write_bytes(damaged.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=r"chunk_0001200_100\.parquet.*delete the file to run its setups again"):
        StudyResult.join(path, whole.study, folder.tables(), whole.provenance, partial=False)
    assert path.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir() if one.is_file()] == ["results.parquet"]


# ---- A study whose process is killed --------------------------------------------------------------------------------

#: A study that kills its own process when half of its setups are completed, and prints how many are.
MAIN = """
import os, signal, sys
from pathlib import Path
from cosim.study import Study
from cosim.study.running.sweep import run_study
from tests.cosim.study.conftest import WorkersHere

def kill(done, total):
    if total / 2 <= done < total:
        print(done, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)

run_study(Study.from_json(Path(sys.argv[1]).read_text()), sys.argv[2], WorkersHere(), kill)
"""


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_study_that_is_killed_loses_nothing_and_runs_nothing_twice(small_study, here, tmp_path: Path) -> None:
    bank = {f"{name} {k}": build for name, build in small_study().bank.items() for k in range(2)}
    corners = {**dict.fromkeys(small_study().corners, tuple(bank)), "rr": ("soft 0",)}
    made = small_study(bank=bank, corners=corners)
    (tmp_path / "study.json").write_text(made.to_json())
    command = [sys.executable, "-c", MAIN, str(tmp_path / "study.json"), str(tmp_path / "out")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[3]), *sys.path])}
    killed = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()[-2000:]
    assert not (tmp_path / "out" / "results.parquet").exists()
    found = run_study(made, tmp_path / "out", here)
    assert here.ran == list(range(int(killed.stdout), 64)), "the others were completed before"
    assert found.setups.tolist() == list(range(64)) and not found.partial
    again = run_study(made, tmp_path / "whole", here)
    assert clockless(found) == clockless(again)


def test_files_and_tables_that_are_no_result_are_refused(folder, whole, tmp_path, unchanged):
    (tmp_path / "text.parquet").write_text("text")
    (one,) = tmp_path.glob("chunks/*/chunk_0000300_100.parquet")

    def joined(*first):
        parts = [whole.table.take(np.arange(*first)), whole.table.take(np.arange(3, 13))]
        return StudyResult.join(tmp_path / "out.parquet", whole.study, parts, whole.provenance, partial=False)

    unchanged(refusals({
        "no file": lambda: StudyResult.load(tmp_path / "none.parquet"), "a chunk": lambda: StudyResult.load(one),
        "a text": lambda: StudyResult.load(tmp_path / "text.parquet"),
        "swapped": lambda: joined(10, 20), "overlapping": lambda: joined(0, 5),
        "other rows than the name states": lambda: list(folder.tables()) if one.rename(
            one.with_name("chunk_0000300_200.parquet")) else None,
    }))  # fmt: skip
    assert not (tmp_path / "out.parquet").exists()
