"""Child processes end with their parent, and what a killed command leaves is removed by the next one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from eightpost import marks
from eightpost.files import atomic_path
from eightpost.object_code.stored import compiled_by
from eightpost.workers.process import Child, EndedError, python_command, usable_processors

# ---- The end of the parent ------------------------------------------------------------------------------------------

#: A parent with a child of its own kind, which has one too.
NESTED = """
import subprocess, sys, time
from eightpost.workers.process import python_command
depth = int(sys.argv[1])
print("begun", flush=True)
child = depth and subprocess.Popen(python_command("nested", str(depth - 1)))
time.sleep(600)
"""

ORPHANED = """
import os, sys, time
from eightpost.workers.process import end_with
end_with(os.getppid() + int(sys.argv[1]))
time.sleep(2.0)
"""


def gone(processes: list[psutil.Process], seconds: float) -> bool:
    """Whether processes end within some seconds; the others are ended then."""
    _, alive = psutil.wait_procs(processes, timeout=seconds)
    for process in alive:
        process.kill()
    return not alive


def test_children_and_grandchildren_end_when_the_parent_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "nested.py").write_text(NESTED)
    monkeypatch.syspath_prepend(str(tmp_path))
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "nested.py"), "2"], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        for _ in range(3):
            assert parent.stdout.readline() == "begun\n"
        children = psutil.Process(parent.pid).children(recursive=True)
        assert len(children) == 2
        parent.kill()
    assert gone(children, 5.0)


@pytest.mark.parametrize(("other", "code"), [(0, 0), (1, 1)], ids=["the parent lives", "the parent has ended before"])
def test_a_process_ends_early_only_without_its_parent(other: int, code: int) -> None:
    began = time.monotonic()
    ran = subprocess.run([sys.executable, "-c", ORPHANED, str(other)], check=False)
    assert ran.returncode == code
    assert (time.monotonic() - began > 2.0) == (code == 0)


# ---- What is left ---------------------------------------------------------------------------------------------------

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="there, they stay")


def ended():
    """Return the number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@POSIX
@pytest.mark.parametrize(
    ("machine", "process", "remains"),
    [("own", "ended", False), ("own", "running", True), ("other", "ended", True)],
)
def test_what_is_left_is_removed_if_its_process_ended_on_this_machine(tmp_path, machine, process, remains):
    number = ended() if process == "ended" else os.getpid()
    name = f"{marks._machine() if machine == 'own' else '0123abcd'}-{number}-01234567"
    (tmp_path / f"x_{name}").mkdir()
    (tmp_path / f"x_{name}" / "file").write_text("")
    (tmp_path / f".out.{name}.csv").write_text("")
    marks.remove_left(tmp_path, "x_")
    marks.remove_left(tmp_path, ".out.", ".csv")
    assert len(list(tmp_path.iterdir())) == 2 * remains


def test_a_folder_is_removed_while_others_still_write_into_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, remove, late = tmp_path / "eightpost_x", shutil.rmtree, ["file"]
    folder.mkdir()

    def disturbed(path: Path, **options: bool) -> None:
        assert not folder.exists()  # nothing can be created in it by its name
        remove(path, **options)
        if late:  # a process whose working folder it is
            path.mkdir()
            (path / late.pop()).touch()

    monkeypatch.setattr(shutil, "rmtree", disturbed)
    marks.remove_folder(folder)
    assert not late and not [*tmp_path.iterdir()]


@POSIX
def test_the_ctrl_c_of_a_terminal_does_not_reach_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "leader.py").write_text("import os; print(os.getpgrp() == os.getpid())")
    monkeypatch.syspath_prepend(tmp_path)
    assert compiled_by("leader", b"") == b"True\n"


@POSIX
def test_other_files_stay(tmp_path):
    names = [".out.csv", ".out.0123.csv", f".other.{marks._machine()}-{ended()}-01234567.csv", "out.csv"]
    for name in names:
        (tmp_path / name).write_text("")
    marks.remove_left(tmp_path, ".out.", ".csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


@POSIX
def test_a_mark_is_that_of_a_running_process(tmp_path):
    (tmp_path / f"x_{marks.mark()}").write_text("")
    marks.remove_left(tmp_path, "x_")
    assert len(list(tmp_path.iterdir())) == 1


@POSIX
def test_a_file_that_is_written_again_has_no_unfinished_one_beside_it(tmp_path):
    left = tmp_path / f".out.{marks._machine()}-{ended()}-01234567.csv"
    left.write_text("half")
    with atomic_path(tmp_path / "out.csv") as temporary:
        temporary.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


@POSIX
def test_the_folder_of_a_killed_command_is_removed_by_the_next_one(tmp_path):
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = python_command("eightpost", "doctor")
    killed = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True)
    end = time.monotonic() + 30.0
    while not list(tmp_path.glob("eightpost_*")):
        assert time.monotonic() < end
        time.sleep(0.01)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.wait()
    left = list(tmp_path.glob("eightpost_*"))
    assert left
    command = python_command("eightpost", "inspect", "missing.csv")
    subprocess.run(command, env=environment, capture_output=True, check=False)
    assert not [path for path in left if path.exists()]


# ---- Processors that may be used ------------------------------------------------------------------------------------


def test_only_the_processors_that_this_process_may_use_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 7}, raising=False)
    assert usable_processors() == 3


@pytest.mark.parametrize(("counted", "usable"), [(4, 4), (None, 1)])
def test_all_processors_count_if_the_system_does_not_report_usable_ones(
    monkeypatch: pytest.MonkeyPatch, counted: int | None, usable: int
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    assert usable_processors() == usable


def test_no_other_file_asks_the_system() -> None:
    root = Path(__file__).parents[1]
    asking = [
        path.name
        for package in ("eightpost", "builder", "cosim", "benchmarks")
        for path in (root / package).rglob("*.py")
        if any(word in path.read_text(encoding="utf-8") for word in ("sched_getaffinity", "cpu_count"))
    ]
    assert asking == ["process.py"]


# ---- A child that is asked ------------------------------------------------------------------------------------------

#: A child that replies with twice a number, after notices; a text is run in it.
ASKED = """
import os, signal, sys, time
from eightpost.workers.process import ParentChannel
channel = ParentChannel(sys.argv[1])
def answer(request):
    channel.notify("noticed")
    if isinstance(request, str):
        exec(request)
    return 2 * request if request else lambda: 0
channel.serve(answer, lambda error: "no data")
"""


@pytest.fixture
def child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Child]:
    (tmp_path / "asked.py").write_text(ASKED)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    made = Child("asked", starting=60.0)
    yield made
    made.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="the signals are those of POSIX")
@pytest.mark.parametrize(
    ("request_", "message", "code"),
    [
        ("os._exit(0)", "crashed (its process ended with code 0)", 0),
        ("os._exit(3)", "crashed (its process ended with code 3)", 3),
        ("os.kill(os.getpid(), signal.SIGKILL)", "crashed (SIGKILL)", -9),
    ],
)
def test_a_child_that_ends_in_a_request_is_told_with_its_code(
    request_: str, message: str, code: int, child: Child
) -> None:
    noticed: list[object] = []
    assert (child.ask(21, 30.0, noticed.append), child.ask(0, 30.0)) == (42, "no data")
    assert noticed == ["noticed"]
    with pytest.raises(EndedError) as raised:
        child.ask(request_, 30.0)
    assert (str(raised.value), raised.value.code, raised.value.hung, child.alive) == (message, code, False, False)


def test_a_child_that_does_not_reply_in_time_is_ended(child: Child) -> None:
    assert child.ask(1, 30.0) == 2
    began = time.monotonic()
    with pytest.raises(EndedError, match=r"did not respond within 0\.2 s and was ended") as raised:
        child.ask("time.sleep(60)", 0.2)
    assert 0.2 <= time.monotonic() - began < 20.0
    assert (raised.value.code, raised.value.hung, child.alive) == (None, True, False)
