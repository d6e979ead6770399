"""Time limit of the tasks of a Dask cluster."""

from __future__ import annotations

import pytest

pytest.importorskip("distributed", reason="needs the extra dask")

from cosim.study.running import dask_workers
from cosim.study.running.dask_workers import TimeLimit

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
