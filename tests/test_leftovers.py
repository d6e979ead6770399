"""What a killed command leaves in the temporary folder and beside its outputs is removed by the next one."""

import os
import signal
import subprocess
import sys
import time

import pytest

from eightpost import marks
from eightpost.files import atomic_path
from eightpost.workers.process import python_command

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there, they stay")


def ended():
    """Return the number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


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


def test_other_files_stay(tmp_path):
    names = [".out.csv", ".out.0123.csv", f".other.{marks._machine()}-{ended()}-01234567.csv", "out.csv"]
    for name in names:
        (tmp_path / name).write_text("")
    marks.remove_left(tmp_path, ".out.", ".csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_a_mark_is_that_of_a_running_process(tmp_path):
    (tmp_path / f"x_{marks.mark()}").write_text("")
    marks.remove_left(tmp_path, "x_")
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_that_is_written_again_has_no_unfinished_one_beside_it(tmp_path):
    left = tmp_path / f".out.{marks._machine()}-{ended()}-01234567.csv"
    left.write_text("half")
    with atomic_path(tmp_path / "out.csv") as temporary:
        temporary.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


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
