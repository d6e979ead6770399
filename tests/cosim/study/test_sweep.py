"""Exhaustive study: results agree with the master's, independent of interruptions and workers."""

import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest

import cosim
from cosim.study import Build, Constraint, Drive, Measure, StudyResult, Term
from cosim.study.definition import read_drive
from cosim.study.running.evaluator import Evaluator, coupling_of, traces
from cosim.study.running.sweep import Sweep, run_study
from cosim.study.running.workers import ProcessWorkers
from eightpost.corners import CORNERS
from eightpost.errors import FileFormatError, InputError
from eightpost.signals import Drivefile
from eightpost.workers.pool import Heartbeats

from .conftest import WorkersHere

#: What may differ between two runs of the same study.
CLOCK = "seconds"


def table(result: StudyResult):
    return result.table.drop_columns([CLOCK])


@pytest.fixture(scope="module")
def whole(small_study, tmp_path_factory):
    """Return the folder and the result of a study that ran without interruption."""
    folder = tmp_path_factory.mktemp("sweep") / "whole"
    return folder, run_study(small_study(), folder, WorkersHere())


@pytest.fixture
def finished(whole, tmp_path):
    """Return that result, with a copy of its folder in tmp_path / "whole"."""
    folder, result = whole
    shutil.copytree(folder, tmp_path / "whole")
    return result


def test_every_setup_has_a_row_with_all_columns(finished):
    columns = ["setup", *CORNERS, "front ride height, RMS", "total tire force, RMS", "status", "message",
               "coupling_error_percent", "marks", "seconds", "coupling error of front ride height, RMS",
               "coupling error of total tire force, RMS"]  # fmt: skip
    assert finished.table.column_names == columns
    assert finished.setups.tolist() == list(range(16)) and finished.done.all() and not finished.partial
    assert finished.table.schema.field("front ride height, RMS").metadata == {
        b"unit": b"m", b"display": b"in", b"label": b"front ride height, RMS"
    }  # fmt: skip


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
    assert table(again).equals(table(finished))


@pytest.mark.nightly
def test_ctrl_c_leaves_a_partial_result(small_study, here, finished, tmp_path):
    def press(done, _total):
        if done == 8:
            signal.raise_signal(signal.SIGINT)

    partial = run_study(small_study(), tmp_path / "stopped", here, press)
    assert partial.partial and len(partial) == 8
    assert StudyResult.load(tmp_path / "stopped" / "results.parquet").partial
    whole = run_study(small_study(), tmp_path / "stopped", here)
    assert not whole.partial and table(whole).equals(table(finished))


def test_objective_and_constraints_may_change_without_a_new_run(small_study, here, finished, tmp_path):
    here.ran.clear()
    bound = float(np.median(finished.values("total tire force, RMS")))
    other = small_study(
        name="another name",
        objective=(Term("front ride height, RMS", 2.0, "in"), Term("total tire force, RMS", 0.01, "lbf")),
        constraints=(Constraint("total tire force, RMS", at_most=bound),),
    )
    result = run_study(other, tmp_path / "whole", here)
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
    run_study(small_study(settling=1.5), tmp_path / "whole", here)
    assert len(here.ran) == 16


@pytest.mark.nightly
def test_setups_that_fail_are_listed_and_the_rest_is_kept(small_study, here, fmus, tmp_path, finished):
    study = small_study()
    bad = Build(fmus["lpnl2"], {"lag_full_force": 2000.0, "lag_zero_force": 1000.0})
    study = small_study(bank={**study.bank, "bad": bad}, corners=study.corners | {"rr": ("soft", "stiff", "bad")})
    result = run_study(study, tmp_path / "failing", here)
    failed = ~result.done
    assert failed.sum() == 8 and all(b == "bad" for b in np.array(result.builds("rr"))[failed])
    assert all("lag_zero_force" in text for text in np.array(result.table["message"].to_pylist())[failed])
    assert np.isnan(result.values("total tire force, RMS")[failed]).all()
    assert not set(result.ranking()) & set(np.flatnonzero(failed))


def test_setups_beyond_a_shocks_fitted_range_are_marked(small_study, here, fmus, tmp_path):
    study = small_study()
    narrow = Build(fmus["lpnl2"], {"curve.compression_speed": 0.05, "curve.rebound_speed": 0.05})
    corners = dict.fromkeys(CORNERS, ("stiff",)) | {"lf": ("stiff", "narrow")}
    result = run_study(small_study(bank={**study.bank, "narrow": narrow}, corners=corners), tmp_path, here)
    plain, marked = result.table["marks"].to_pylist()
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
    assert several.done.all() and table(several).equals(table(alone))


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
    end = Heartbeats.end_unresponsive

    def patient(heartbeats, patience):
        hung = any((tmp_path / f"hung_{process}").exists() for process in heartbeats._processes[:])
        return end(heartbeats, patience if hung else 300.0)

    monkeypatch.setattr(Heartbeats, "end_unresponsive", patient)
    workers = ProcessWorkers(1, patience=2.0)
    try:
        sweep = Sweep(small_study(corners=corners, measures=(own,)), tmp_path / "hanging")
        found = sweep.run(workers, coupling_of(plain))
    finally:
        workers.close()
    hung = levels > levels.mean()
    assert (found.done == ~hung).all()
    assert found.values("own")[~hung] == pytest.approx(levels[~hung], rel=1e-12)
    (message,) = np.array(found.table["message"].to_pylist())[hung]
    assert len(list(tmp_path.glob("hung_*"))) == 2, "in a chunk, and alone"
    assert "not responding for 2 s" in message and "hangs" in message


def test_a_result_is_read_back_from_its_file(finished, tmp_path):
    path = tmp_path / "whole" / "results.parquet"
    loaded = StudyResult.load(path)
    assert loaded.table.equals(finished.table) and loaded.study == finished.study
    assert loaded.provenance == finished.provenance
    guids = set(loaded.provenance.guids.values())
    assert len(guids) == 2 and all(guid.startswith("{") for guid in guids)
    assert all(len(digest) == 64 for digest in loaded.provenance.digests.values())


def test_a_file_that_is_not_a_result_is_refused(finished, tmp_path):
    with pytest.raises(FileFormatError, match="no such file"):
        StudyResult.load(tmp_path / "none.parquet")
    with pytest.raises(FileFormatError, match="no eightpost header"):
        StudyResult.load(next((tmp_path / "whole").glob("chunks/*/*.parquet")))
    (tmp_path / "text.parquet").write_text("text")
    with pytest.raises(FileFormatError, match="not a readable Parquet file"):
        StudyResult.load(tmp_path / "text.parquet")


def test_a_run_may_use_its_drive_file_from_the_first_to_the_last_sample_and_no_more(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("time [s],lf.road [m]\n" + "".join(f"{2.0 + 0.25 * k},{0.5 * k}\n" for k in range(13)))
    drive = Drive("part", path, stop=3.0, start=2.0)  # the file contains 2 to 5 s
    assert read_drive(drive).sample(np.array([2.0, 4.0, 5.0])).tolist() == [[0.0, 4.0, 6.0]]
    for beyond in (replace(drive, start=1.9), replace(drive, stop=3.1)):
        with pytest.raises(InputError, match="which contains 2 to 5 s; change stop or start"):
            read_drive(beyond)
