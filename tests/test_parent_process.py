"""Child processes end when their parent ends or is killed, and not before."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

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
