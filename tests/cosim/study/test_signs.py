"""Signs of life: who is silent at work is ended, who has nothing to do is not."""

import subprocess
import sys
import time
from multiprocessing import get_context

import pytest

from cosim.study.running import signs as module
from cosim.study.running.signs import Signs, sign, take_place, working


@pytest.fixture
def pool():
    """Signs of one worker, which is a process that only waits; what is said here counts as said by it."""
    found = Signs(1, get_context("spawn"))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    take_place(*found.shared)
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


def test_a_worker_that_is_silent_at_work_is_ended(pool):
    signs, process = pool
    with working():
        assert not signs.end_silent(0.1)
        time.sleep(0.15)
        assert signs.end_silent(0.1) and ended(process)


def test_a_worker_that_gives_signs_goes_on_however_long_it_takes(pool):
    signs, process = pool
    with working():
        for _ in range(6):
            time.sleep(0.05)
            sign()
            assert not signs.end_silent(0.2)
    assert process.poll() is None


def test_a_worker_without_work_may_be_silent(pool):
    signs, process = pool
    with working():
        sign()
    signs.end_silent(0.01)
    time.sleep(0.05)
    assert not signs.end_silent(0.01)
    signs.end_working(0.0)
    assert process.poll() is None


def test_a_worker_that_nobody_waits_for_is_ended_when_its_time_is_up(pool):
    signs, process = pool
    with working():
        signs.end_working(0.1)
        assert ended(process)
