"""Heartbeats: a worker that is not responding is ended, an idle one is not."""

import subprocess
import sys
import time
from multiprocessing import get_context

import pytest

from eightpost.workers import pool as module
from eightpost.workers.pool import _Heartbeats, heartbeat, register_worker, working


@pytest.fixture
def pool():
    """Heartbeats of one worker: a process that only waits; this process sends its heartbeats."""
    found = _Heartbeats(1, get_context("spawn"))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    register_worker(*found.shared)
    found.shared[1][0] = process.pid
    yield found, process
    module._own.clear()
    process.kill()
    process.communicate()


def ended(process):
    try:
        return process.wait(5.0) != 0
    except subprocess.TimeoutExpired:
        return False


def test_a_working_worker_without_heartbeats_is_ended(pool):
    heartbeats, process = pool
    with working():
        assert not heartbeats.end_unresponsive(0.1)
        time.sleep(0.15)
        assert heartbeats.end_unresponsive(0.1) and ended(process)


def test_a_worker_with_heartbeats_may_work_for_any_time(pool):
    heartbeats, process = pool
    with working():
        for _ in range(6):
            time.sleep(0.05)
            heartbeat()
            assert not heartbeats.end_unresponsive(0.2)
    assert process.poll() is None


def test_an_idle_worker_needs_no_heartbeats(pool):
    heartbeats, process = pool
    with working():
        heartbeat()
    heartbeats.end_unresponsive(0.01)
    time.sleep(0.05)
    assert not heartbeats.end_unresponsive(0.01)
    heartbeats.end_working(0.0)
    assert process.poll() is None


def test_a_worker_whose_result_is_not_needed_is_ended_after_the_grace_time(pool):
    heartbeats, process = pool
    with working():
        heartbeats.end_working(0.1)
        assert ended(process)
