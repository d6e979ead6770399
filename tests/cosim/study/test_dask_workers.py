"""Time limit of the tasks of a Dask cluster."""

from __future__ import annotations

import os
import signal
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cosim.study import Measure, Study
from cosim.study.running.sweep import Sweep, file_digests, run_study, study_digest
from cosim.study.running.workers import program
from cosim.study.table import StudyResult
from eightpost.corners import CORNERS
from eightpost.errors import InputError

from .constructed import cells

distributed = pytest.importorskip("distributed", reason="needs the extra dask")

import dask  # noqa: E402 -- after the skip

from cosim.study.running import dask_workers  # noqa: E402
from cosim.study.running.dask_workers import TimeLimit  # noqa: E402

PATIENCE = 10.0


class FakeClient:
    """A cluster that states what its workers are doing, and whose workers can be ended."""

    def __init__(self) -> None:
        self.doing: dict[str, tuple[str, ...]] = {}
        self.ended: list[str] = []

    def processing(self):
        return self.doing

    def run_on_scheduler(self, _function, address):
        self.ended.append(address)
        del self.doing[address]


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(dask_workers.time, "monotonic", lambda: now[0])
    return now


def after(limit, clock, seconds, tasks):
    """Check every second until a time."""
    while clock[0] < seconds:
        clock[0] += 1.0
        limit.check(tasks)


def test_only_the_worker_whose_task_takes_too_long_is_ended(clock):
    client, heard = FakeClient(), []
    client.doing = {"tcp://a": ("one",), "tcp://b": ("two",)}
    limit = TimeLimit(client, PATIENCE, heard.append)
    limit.learn(0.1)
    assert limit.of(8) == pytest.approx(18.0)  # 10 s, and ten times the 0.8 s of eight setups
    after(limit, clock, 10.0, {"one": 8, "two": 8})
    client.doing["tcp://b"] = ("three",)  # the second one goes on
    after(limit, clock, 18.0, {"one": 8, "three": 8})
    assert client.ended == []
    clock[0] += 2.0
    assert limit.check({"one": 8, "three": 8}) == {"one"}
    assert client.ended == ["tcp://a"]
    (text,) = heard
    assert "worker tcp://a was not responding for more than 10 s" in text


def test_a_task_that_another_worker_runs_again_has_its_whole_time_there(clock):
    client = FakeClient()
    client.doing = {"tcp://a": ("one",)}
    limit = TimeLimit(client, PATIENCE, lambda _text: None)
    limit.learn(0.1)
    after(limit, clock, 11.0, {"one": 1})
    client.doing = {"tcp://b": ("one",)}
    after(limit, clock, 22.0, {"one": 1})
    assert client.ended == []
    after(limit, clock, 25.0, {"one": 1})
    assert client.ended == ["tcp://b"]


def test_tasks_of_other_studies_and_of_files_have_no_limit(clock):
    client = FakeClient()
    client.doing = {"tcp://a": ("file", "other")}
    limit = TimeLimit(client, PATIENCE, lambda _text: None)
    after(limit, clock, 1000.0, {"one": 1})
    assert client.ended == []


def test_before_any_setup_has_run_each_may_take_as_long_as_the_choice_of_the_coupling():
    limit = TimeLimit(FakeClient(), PATIENCE, lambda _text: None)
    assert limit.of(8) == 10.0 + 8 * 10.0  # nothing is known: the patience
    limit.expect(4.0)
    assert limit.of(8) == 10.0 + 8 * 4.0
    limit.learn(2.0)
    limit.learn(1.0)
    assert limit.of(8) == 10.0 + 10.0 * 2.0 * 8


# ==== A study on a Dask cluster: the same table, files by digest, workers that may die ===============================

#: A measure that ends its worker in the one setup where it is large.
DEADLY = """
import os, signal
def deadly(response):
    size = response.total.std()
    if size > {limit!r} and os.getpid() != {here}:
        os.kill(os.getpid(), signal.SIGKILL)
    return size
"""


@pytest.fixture
def cluster(request, tmp_path):
    """Two worker processes of one thread each; the test sets how many of them may die in a task, by default 3."""
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": getattr(request, "param", 3)}),
        # By default a LocalCluster gives up a killed worker that is not back after 15 s, as on a busy machine.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "300s"}),
        warnings.catch_warnings(),
    ):
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
    there = Study.from_json(dask_workers.unpack(text, contents))
    assert len(list((tmp_path / "there").iterdir())) == len(contents) == 3
    assert study_digest(there, file_digests(there)) == study_digest(study, file_digests(study))


def kill_all(cluster, client):
    """Kill every worker that has started, at least one; the cluster starts others."""
    killed = 0
    while not killed:
        client.wait_for_workers(1, timeout=60)
        for worker in list(cluster.workers.values()):
            with suppress(ProcessLookupError, TypeError):  # it was killed before, or has not started
                os.kill(worker.pid, signal.SIGKILL)
                killed += 1


def without_seconds(result: StudyResult) -> dict[str, list[Any]]:
    return cells(result.table, "seconds")


@pytest.fixture
def eight_setups(small_study):
    """Two builds at three corners."""
    return small_study(corners={**dict.fromkeys(CORNERS[:3], ("soft", "stiff")), "rr": ("soft",)})


@pytest.mark.nightly  # every change: one worker is killed in the next test
def test_workers_that_are_killed_at_any_moment_lose_no_setup(eight_setups, here, cluster, tmp_path):
    """All workers are killed: before and after files are on the cluster, while rows come, and after the last row."""
    alone = run_study(eight_setups, tmp_path / "alone", here)
    sweep, workers = Sweep(eight_setups, tmp_path / "cluster"), dask_workers.DaskWorkers(cluster.scheduler_address)

    left = {0, 2, 8}

    def kill(done, _total):
        if done in left:  # the same number is reported several times
            left.remove(done)
            kill_all(cluster, workers._client)

    try:
        kill_all(cluster, workers._client)
        workers._parcel(eight_setups)
        kill_all(cluster, workers._client)
        coupling = workers.choose(eight_setups)
        assert coupling == here.choose(eight_setups)
        together = sweep.run(workers, coupling, kill)
    finally:
        workers.close()
    assert without_seconds(together) == without_seconds(alone)


@pytest.mark.nightly
@pytest.mark.parametrize("cluster", [0], indirect=True)
def test_only_the_setup_that_kills_its_worker_fails(eight_setups, here, cluster, tmp_path):
    size = Measure("size", ("car.lf.tire_force",), "rms", "N")
    study = replace(eight_setups, measures=(size,))
    alone = without_seconds(run_study(study, tmp_path / "alone", here))
    *_, second, largest = sorted(alone["size"])
    (tmp_path / "deadly.py").write_text(DEADLY.format(limit=0.5 * (second + largest), here=os.getpid()))
    deadly = replace(study, measures=(replace(size, function=f"{tmp_path / 'deadly.py'}:deadly"),))
    workers = dask_workers.DaskWorkers(cluster.scheduler_address)
    try:
        together = without_seconds(Sweep(deadly, tmp_path / "cluster").run(workers, here.choose(study)))
    finally:
        workers.close()
    lost = alone["size"].index(largest)
    assert [k for k, word in enumerate(together["status"]) if word == "failed"] == [lost]
    found, expected = ({n: row[:lost] + row[lost + 1 :] for n, row in one.items()} for one in (together, alone))
    # A function of the user gets the series; the measure of the other study is summed in the batch.
    assert found["size"] == pytest.approx(expected["size"], rel=1e-12)
    assert all(found[name] == expected[name] for name in found if "size" not in name)


def test_a_program_differs_in_its_version_its_sources_or_its_libraries():
    own = program()
    assert own.difference(own) == "" and own.other_libraries(own) == ""
    assert "eightpost 0.0.1, but" in replace(own, version="0.0.1").difference(own)
    assert "with other sources" in replace(own, code="0").difference(own)
    other = replace(own, libraries={**own.libraries, "numpy": "1.0"})
    assert other.difference(own) == "" and other.other_libraries(own).startswith("numpy 1.0 instead of ")


def test_a_scheduler_that_does_not_answer_is_reported():
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        dask_workers.DaskWorkers("tcp://127.0.0.1:9", patience=0.5)
