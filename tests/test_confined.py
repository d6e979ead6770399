"""A library that crashes, hangs or uses too much memory gives an error message, and the next file is read."""

import os
import select
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from eightpost import confined
from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.signals import TimeSeries, read_series, write_series
from eightpost.workers import process

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits are POSIX's")


@pytest.fixture
def record(tmp_path):
    series = TimeSeries.from_channels(np.arange(100) / 100.0, {"force": ("N", np.arange(100.0))})
    write_series(series, tmp_path / "run.mat")
    return tmp_path / "run.mat"


@pytest.mark.nightly
def test_a_crash_is_a_message_and_the_next_file_is_read(record, tmp_path, monkeypatch):
    (tmp_path / "crashes.py").write_text("import os\n\n\ndef read(path):\n    os.kill(os.getpid(), 11)\n")
    monkeypatch.syspath_prepend(tmp_path)
    confined._children.clear()  # the next process has this path
    with pytest.raises(
        FileFormatError, match=r"run\.mat: not a mat file: the process that read it crashed \(SIGSEGV\)"
    ):
        read_confined("crashes:read", record, kind="a mat file")
    np.testing.assert_array_equal(read_series(record)["force"], np.arange(100.0))


@pytest.mark.nightly
def test_a_file_is_not_refused_because_an_earlier_one_damaged_the_process(record):
    """If the first process dies, a new one reads the file."""
    read_series(record)
    (child,) = confined._children
    child._process.kill()
    np.testing.assert_array_equal(read_series(record)["force"], np.arange(100.0))


@pytest.mark.nightly
def test_a_file_that_takes_too_long_is_refused(record, monkeypatch):
    monkeypatch.setattr(confined, "_TIME", 0.5)
    slow = record.with_name("slow.mat")
    slow.write_text("#!/bin/sh\nexec sleep 20\n")
    slow.chmod(0o755)
    read_confined("os:stat", slow, kind="a file")  # the process has begun
    with pytest.raises(FileFormatError, match=r"slow\.mat: not a file: the process that read it took longer than"):
        read_confined("subprocess:run", slow, kind="a file")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="the address space is Linux's")  # noqa: PTH110
def test_a_file_that_takes_too_much_memory_is_refused(record, monkeypatch):
    monkeypatch.setattr(confined, "MEMORY", 2**26)
    monkeypatch.setattr(confined, "_MEMORY_PER_BYTE", 0)
    large = record.with_name("large.mat")
    with large.open("wb") as stream:
        stream.truncate(2**28)
    with pytest.raises(FileFormatError, match=r"large\.mat: not a file: reading it needs more than 0\.1 GiB of memory"):
        read_confined("numpy:fromfile", large, kind="a file")
    np.testing.assert_array_equal(read_series(record)["force"], np.arange(100.0))


def test_an_error_of_the_library_is_reported_with_the_file_name(record):
    record.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(range(200)))
    with pytest.raises(FileFormatError, match=r"run\.mat: not a MATLAB file: \w+Error"):
        read_series(record)


def test_several_files_are_read_by_one_process(record):
    read_series(record)
    (child,) = confined._children
    for _ in range(5):
        read_series(record)
    assert confined._children == [child]


def test_a_reply_is_waited_for_as_many_milliseconds_as_the_seconds_have(monkeypatch):
    waited = []

    def poll():
        return SimpleNamespace(register=lambda *_: None, poll=lambda time: waited.append(time) or waited[1:])

    monkeypatch.setattr(process, "select", SimpleNamespace(poll=poll, POLLIN=select.POLLIN))
    wait = process._waiter(SimpleNamespace(fileno=lambda: 0))
    assert (wait(2.5), wait(0.0)) == (False, True)
    assert waited == [2500.0, 0.0]
