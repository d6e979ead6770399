"""The same study on a cluster: the same table, files by what is in them, workers that may die."""

import os
import signal
import warnings
from pathlib import Path

import pytest

from cosim.study.running.digest import file_digests, study_digest
from cosim.study.running.sweep import Sweep, run_study
from eightpost.errors import InputError

distributed = pytest.importorskip("distributed", reason="needs the extra dask")

from cosim.study import Study  # noqa: E402 -- after the skip
from cosim.study.running import dask_workers  # noqa: E402

CORNERS = ("lf", "rf", "lr", "rr")


@pytest.fixture
def cluster(tmp_path):
    """Two worker processes of one thread each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, local_directory=str(tmp_path)
        )
        with made:
            yield made


def test_a_study_travels_as_digests_and_is_the_same_where_it_arrives(small_study, tmp_path, monkeypatch):
    monkeypatch.setattr(dask_workers, "_folder", lambda: tmp_path / "there")
    study = small_study()
    contents = {digest: Path(path).read_bytes() for path, digest in file_digests(study).items()}
    text = dask_workers.by_digest(study, file_digests(study)).to_json()
    assert str(study.vehicle.fmu) not in text
    there = Study.from_json(dask_workers.unpacked(text, contents))
    assert len(list((tmp_path / "there").iterdir())) == len(contents) == 3
    assert study_digest(there, file_digests(there)) == study_digest(study, file_digests(study))


@pytest.mark.slow
def test_a_cluster_gives_the_table_of_one_process_though_a_worker_is_killed(small_study, here, cluster, tmp_path):
    study = small_study(corners={**dict.fromkeys(CORNERS[:3], ("soft", "stiff")), "rr": ("soft",)})
    alone = run_study(study, tmp_path / "alone", here)
    sweep = Sweep(study, tmp_path / "cluster")
    workers = dask_workers.DaskWorkers(cluster.scheduler_address)

    def kill(done, _total):
        if done == 2:
            os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

    try:
        together = sweep.run(workers, here.choose(study), kill)
    finally:
        workers.close()
    assert together.table.drop_columns(["seconds"]).equals(alone.table.drop_columns(["seconds"]))


def test_a_scheduler_that_does_not_answer_is_said():
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        dask_workers.DaskWorkers("tcp://127.0.0.1:9", patience=0.5)
