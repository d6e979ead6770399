"""A command's parent notices how it ended, whatever the FMU that it called did, and signals reach it once."""

from __future__ import annotations

import mmap
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import arro3.core as arrow
import psutil
import pytest

from eightpost.signals.parquet_file import write_arrow
from eightpost.workers import supervision
from eightpost.workers.process import ROOT
from eightpost.workers.supervision import SIZE, Record

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the commands below are those of POSIX")

#: A command whose work is given: in the call of an FMU if it begins with "call:".
COMMAND = """
import atexit, ctypes, os, signal, sys, tempfile, time
from eightpost.workers import supervision
def work():
    record, text = supervision.record, sys.argv[1]
    names = {**globals(), "record": record}
    if text.startswith("call:"):
        with record.calling("'odd' (odd.fmu)", "step"):
            exec(text.removeprefix("call:"), names)
    else:
        exec(text, names)
sys.exit(supervision.supervised(work, lambda text: sys.stderr.write(text + "\\n")))
"""


def start(work: str, limit: float = 30.0, **options: Any) -> subprocess.Popen[str]:
    environment = {**os.environ, "EIGHTPOST_TIME_LIMIT": str(limit)} | options.pop("env", {})
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment}
    return subprocess.Popen([sys.executable, "-c", COMMAND, work], **pipes, **options)


def ended(work: str, limit: float = 30.0, **options: Any) -> tuple[int, str, str]:
    command = start(work, limit, **options)
    output, errors = command.communicate(timeout=60)
    return command.returncode, output, errors


@pytest.fixture
def record() -> Record:
    return Record(mmap.mmap(-1, SIZE))


def test_long_texts_of_a_record_are_cut_and_leave_the_others_as_they_are(record: Record) -> None:
    record.complete(7)
    long = "x" * (2 * SIZE)
    for _ in range(2):
        record.folder, record.remains = f"folder {long}", f"remains {long}"
        record.name_parts(["one", "two", long])
        with record.calling(f"component {long}", "step"):
            assert record.called == (f"component {long}"[:959], "")
            assert record.is_calling
    assert (len(record.folder), len(record.remains)) == (1023, 1023)
    assert record.folder.startswith("folder x") and record.remains.startswith("remains x")
    assert record.code == 7 and not record.is_calling


def test_the_loop_is_told_by_its_part_and_time(record: Record) -> None:
    record.name_parts(["car", "lf", "rf"])
    assert record.code is None
    states = {record.state}
    with record.calling_loop():
        for part, name in enumerate(("car", "lf", "rf", "unknown")):
            struct.pack_into("q", record.memory, record.calls, part + 1)
            struct.pack_into("q", record.memory, record.calls + 8, part)
            struct.pack_into("d", record.memory, record.clock, 0.25 * part)
            assert record.called == (name, f" at {0.25 * part:g} s")
            states.add(record.state)
        assert record.is_calling
        with record.calling("'odd'", "start"):
            assert record.called == ("'odd'", " to start")
            states.add(record.state)
        assert record.called[0] == "unknown"
        assert "component unknown was called at 0.75 s and did not return within" in record.hang()
    assert not record.is_calling and len(states) == 6


@pytest.mark.parametrize("code", [0, 1, 2, 130, 255])
def test_a_complete_command_has_its_exit_code(code: int, record: Record) -> None:
    record.complete(code)
    assert record.code == code


@pytest.mark.parametrize(
    "work",
    ["os._exit(0)", "ctypes.CDLL(None).exit(3)", "ctypes.string_at(0)"],
)
def test_an_fmu_that_ends_the_process_is_named_and_the_exit_code_is_1(work: str) -> None:
    code, _, errors = ended(f"call:{work}")
    assert code == 1
    assert errors.count("this process ended while component 'odd' (odd.fmu) was called to step") == 1
    assert "there is no result" in errors and "--isolate" in errors


def test_a_library_that_lists_what_is_left_at_the_end_prints_nothing() -> None:
    """The bindings of lief, which checks read binaries with, list all objects that the end did not collect."""
    assert ended("import lief") == (0, "", "")


@pytest.mark.parametrize(("work", "how"), [("os._exit(0)", "with code 0"), ("os.abort()", "by signal 6")])
def test_a_command_that_does_not_complete_never_ends_with_0(work: str, how: str) -> None:
    code, _, errors = ended(work)
    assert (code, "'odd'" in errors) == (1, False)
    assert f"the process of this command ended {how} before the command was complete" in errors


def test_a_file_whose_library_ends_the_process_is_named_while_it_is_read_and_the_exit_code_is_2() -> None:
    code, _, errors = ended("with supervision.reading('odd.parquet'): os.abort()")
    assert (code, errors.startswith("odd.parquet: damaged")) == (2, True)
    code, _, errors = ended("try:\n with supervision.reading('odd.parquet'): 1 / 0\nexcept ArithmeticError: os.abort()")
    assert (code, "odd.parquet" in errors) == (1, False)


def test_a_parquet_file_whose_page_ends_the_process_is_named_without_the_words_of_the_library(tmp_path: Path) -> None:
    write_arrow(arrow.Table.from_pydict({"a": arrow.Array([1.0], arrow.DataType.float64())}), tmp_path / "odd.parquet")
    work = f"""
import arro3.io
from eightpost.signals.parquet_file import read_table
class Reader:
    schema = ()
    def __next__(self):
        os.write(2, b"panic")
        os.abort()
arro3.io.read_parquet = lambda *given, **options: Reader()
read_table({str(tmp_path / "odd.parquet")!r})
"""
    code, _, errors = ended(work)
    assert (code, errors.startswith(f"{tmp_path}/odd.parquet: damaged")) == (2, True)


@pytest.mark.parametrize(
    ("work", "code"),
    [
        ("sys.exit()", 0),
        ("sys.exit(2)", 2),
        ("sys.exit('words')", 1),
        ("1 / 0", 1),
        ("atexit.register(os._exit, 0); sys.exit(1)", 1),  # what libraries do after the end changes no failure
        ("atexit.register(os._exit, 7); sys.exit(0)", 7),
        ("atexit.register(os.abort); print('all'); sys.exit(0)", 0),
    ],
)
def test_the_exit_code_of_a_complete_command_is_its_own(work: str, code: int) -> None:
    found, output, errors = ended(work)
    assert found == code
    assert ("words" in errors, "ZeroDivisionError" in errors) == ("words" in work, "/" in work)
    assert "no result" not in errors and output == ("all\n" if "all" in work else "")


def test_an_fmu_that_does_not_return_is_ended_after_the_time_limit_and_named() -> None:
    began = time.monotonic()
    code, _, errors = ended("call:\nwhile True: pass", 0.5)
    assert code == 1 and 0.5 < time.monotonic() - began < 30.0
    assert "component 'odd' (odd.fmu) was called to step and did not return within 0.5 s" in errors
    assert "EIGHTPOST_TIME_LIMIT" in errors


SLOW = {
    "many calls": "for _ in range(7):\n    with record.calling('a', 'b'): time.sleep(0.3)",
    "no call": "time.sleep(2.0)",
    "a loop": """
import struct
with record.calling_loop():
    for k in range(7):
        struct.pack_into("q", record.memory, record.calls, k)
        time.sleep(0.3)
""",
}


@pytest.mark.parametrize("work", SLOW.values(), ids=SLOW)
def test_a_command_that_is_only_slow_is_not_ended(work: str) -> None:
    assert ended(work, 1.5) == (0, "", "")


def test_a_process_that_does_not_end_after_its_command_is_ended_with_the_command_s_code() -> None:
    code, _, errors = ended("atexit.register(time.sleep, 60.0); sys.exit(3)", 0.5)
    assert (code, errors) == (3, "")


COUNT = """
count = []
signal.signal(signal.SIGINT, lambda *_: count.append(1))
print("ready", flush=True)
until = time.monotonic() + 1.0
while time.monotonic() < until: time.sleep(0.05)
print(len(count))
"""


@pytest.mark.parametrize("to_group", [True, False], ids=["to the group, as a terminal does", "to the parent"])
def test_an_interrupt_reaches_the_command_once(to_group: bool) -> None:
    command = start(COUNT, process_group=0)
    assert command.stdout is not None and command.stdout.readline() == "ready\n"
    (os.killpg if to_group else os.kill)(command.pid, signal.SIGINT)
    assert command.communicate(timeout=60) == ("1\n", "")
    assert command.returncode == 0


FINALIZER = """
class Slow: __del__ = lambda self: (print("ready", flush=True), time.sleep(60.0))
try: Slow(); time.sleep(60.0)
except KeyboardInterrupt: sys.exit(7)
"""


#: A module at whose import the program receives Ctrl-C, and whether an extension turns that into an ImportError.
INTERRUPTED = """
import os, signal, sys
class Finder:
    def find_spec(name, path=None, target=None):
        if name == "{module}":
            try:
                os.kill(os.getpid(), signal.SIGINT)  # received later where it is blocked
            except KeyboardInterrupt:
                raise {error}
sys.meta_path.insert(0, Finder)
"""


@pytest.mark.parametrize(("module", "error"), [
    ("click", "KeyboardInterrupt"), ("eightpost.marks", "KeyboardInterrupt"), ("numpy", "KeyboardInterrupt"),
    ("numpy", "ImportError"),
])  # fmt: skip
def test_ctrl_c_while_a_command_starts_ends_it_with_1_and_without_a_traceback(
    module: str, error: str, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED.format(module=module, error=error), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
    try:
        ran = subprocess.run([sys.executable, "-m", "eightpost", "inspect", "x.csv"], cwd=ROOT, env=environment,
                             capture_output=True, text=True, check=False)  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)
    assert (ran.returncode, ran.stdout, ran.stderr.replace("Aborted!", "").strip()) == (1, "", "")


def test_an_interrupt_in_a_finalizer_ends_the_command() -> None:
    command = start(FINALIZER)
    assert command.stdout is not None and command.stdout.readline() == "ready\n"
    command.send_signal(signal.SIGINT)
    assert command.communicate(timeout=60) == ("", "") and command.returncode == 7


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_command_that_a_signal_ends_leaves_no_process_and_no_temporary_file(
    number: signal.Signals, tmp_path: Path
) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # a process started by nohup ignores SIGHUP
    command = start("tempfile.mkdtemp(); print('ready', flush=True); time.sleep(60.0)", env={"TMPDIR": str(tmp_path)})
    signal.signal(number, before)
    assert command.stdout is not None and command.stdout.readline() == "ready\n"
    children = psutil.Process(command.pid).children()
    assert len(children) == 1 and len([*tmp_path.glob("*/*")]) == 1
    command.send_signal(number)
    assert command.communicate(timeout=60) == ("", "") and command.returncode == -number
    assert not psutil.wait_procs(children, 5.0)[1] and not [*tmp_path.iterdir()]


def test_a_command_ends_with_its_parent(tmp_path: Path) -> None:
    command = start("tempfile.mkdtemp(); print('ready', flush=True); time.sleep(60.0)", env={"TMPDIR": str(tmp_path)})
    assert command.stdout is not None and command.stdout.readline() == "ready\n"
    (child,) = psutil.Process(command.pid).children()
    command.kill()
    command.communicate(timeout=60)
    until = time.monotonic() + 5.0
    while child.is_running() and child.status() != psutil.STATUS_ZOMBIE and time.monotonic() < until:
        time.sleep(0.02)
    assert not child.is_running() or child.status() == psutil.STATUS_ZOMBIE  # if process 1 does not wait for orphans
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("work", ["pass", "call:ctypes.string_at(0)"])
def test_no_temporary_file_remains_however_a_command_ends(work: str, tmp_path: Path) -> None:
    before, made = work[: work.index(":") + 1] if ":" in work else "", "open(tempfile.mkdtemp() + '/a', 'w').close(); "
    ended(before + made + work.removeprefix("call:"), env={"TMPDIR": str(tmp_path)})
    assert not [*tmp_path.iterdir()]


def test_a_command_without_a_temporary_folder_runs(tmp_path: Path) -> None:
    assert ended("tempfile.tempdir is None or sys.exit(5)", env={"TMPDIR": str(tmp_path)})[0] == 5


def test_a_command_and_its_workers_have_one_temporary_folder(tmp_path: Path) -> None:
    asked = "print(__import__('tempfile').gettempdir(), flush=True)"
    work = f"{asked}; __import__('subprocess').run([sys.executable, '-c', {asked!r}])"
    _, shown, _ = ended(work, env={"TMPDIR": str(tmp_path)})
    first, second = shown.split()
    assert first == second and Path(first).parent == tmp_path


@pytest.mark.parametrize(
    ("stated", "limit"), [("", 30.0), ("7.5", 7.5), ("0", 30.0), ("-1", 30.0), ("soon", 30.0), ("inf", 1e6)]
)
def test_the_time_limit_is_30_s_or_that_of_the_environment(
    stated: str, limit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EIGHTPOST_TIME_LIMIT", stated)
    assert supervision._stated_limit() == limit
