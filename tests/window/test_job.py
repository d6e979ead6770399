"""Commands that the window runs: their progress, their end, and how they are cancelled."""

import sys
import time

import pytest

from eightpost.window import parts as module
from eightpost.window.parts import Job

Window = pytest.importorskip("eightpost.window.parts").Window


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Start a job whose commands are Python programs."""
    monkeypatch.setattr(module, "python_command", lambda _name, *words: [sys.executable, "-u", "-c", *words])
    jobs = []

    def start(*programs):
        jobs.append(Job("work", [[program] for program in programs], tmp_path, tmp_path))
        return jobs[-1]

    yield start
    for job in jobs:
        job.close()


def _until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize(("code", "state"), [(0, "done"), (1, "not acceptable"), (2, "failed")])
def test_the_state_at_the_end_follows_the_exit_code(run, code, state):
    job = run(f"raise SystemExit({code})")
    _until(lambda: job.code is not None)
    assert job.state == state


def test_commands_run_one_after_the_other_until_one_fails(run):
    job = run("print('first')", "raise SystemExit(2)", "print('third')")
    _until(lambda: job.code is not None)
    assert (job.state, job.log) == ("failed", "first")


def test_the_last_line_of_progress_is_shown_and_is_no_part_of_the_log(run):
    lines = ["setups: 120 of 2401, 5%, about 0:01:10 left", "identifying: 40%", "error: 3 % is bad: no"]
    job = run(f"print({chr(10).join(lines)!r})")
    _until(lambda: job.code is not None)
    assert job.progress == (0.4, "identifying: 40%")
    assert job.log == "error: 3 % is bad: no"


def test_a_command_without_progress_has_none(run):
    job = run("print('x')")
    assert job.progress == (None, "")


def test_a_cancelled_command_is_interrupted_as_by_ctrl_c(run):
    job = run(
        "import time\ntry:\n    print('ready')\n    time.sleep(60)\nexcept KeyboardInterrupt:\n    print('stopped')",
        "print('never')",
    )
    _until(lambda: "ready" in job.log)
    assert job.state == "running"
    job.cancel()
    _until(lambda: job.code is not None)
    assert job.state == "cancelled"
    assert job.log.splitlines() == ["ready", "stopped"]


def test_a_command_that_does_not_stop_is_killed(run, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", 0.2)
    job = run("import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); print('ready'); time.sleep(60)")
    _until(lambda: "ready" in job.log)
    job.cancel()
    assert job.state == "stopping"
    _until(lambda: job.state == "cancelled")


def test_closing_the_window_ends_the_command(run):
    job = run("import time; time.sleep(60)")
    process = job._process
    job.close()
    assert process.poll() is not None


def test_commands_go_on_while_nobody_looks_at_them(run):
    window = Window(None)
    window.jobs["x"] = job = run("print('first')", "print('second')")
    end = time.monotonic() + 20.0
    while "second" not in job.log:
        assert time.monotonic() < end
        window.advance()
        time.sleep(0.01)
