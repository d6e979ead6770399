"""Supervision of a process that calls FMUs, by another process: one that ended or hung is named, whoever made it.

An FMU in this process can end it (exit, a crash) or never return, and nothing in this process can then say so. So the
process records which FMU it is calling in memory that a second process reads: a command the process that started it,
a program of a user a process that waits for its end. A command is complete when it has recorded its own exit code.

This file runs as a program, too, without the package, so it uses only the standard library.
"""

from __future__ import annotations

import gc
import mmap
import os
import select
import signal
import struct
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, NoReturn

# ---- Time limit of a call -------------------------------------------------------------------------------------------


def _stated_limit() -> float:
    with suppress(ValueError):
        if (seconds := float(os.environ.get("EIGHTPOST_TIME_LIMIT", ""))) > 0.0:
            return min(seconds, 1e6)
    return 30.0


#: Time after which an FMU that has not returned from a call is ended [s], in this process or in one of its own.
TIME_LIMIT = _stated_limit()

# ---- Record of the FMU that is being called -------------------------------------------------------------------------

#: Size of a record [bytes].
SIZE = 1 << 16
#: Words of 64 bits: who calls, number of calls from Python, exit code + 1 of a complete command; of the loop: number of
#: calls, part that is called, time.
_WHO, _COUNT, _CODE, _CALLS, _PART, _CLOCK = range(6)
_NOBODY, _PYTHON, _LOOP = range(3)
_WORDS = 8 * 6
#: Positions and sizes of texts: call from Python, temporary folder, what remains of earlier runs, file that is being
#: read, names of the loop's parts.
_CALL, _FOLDER, _REMAINS, _FILE, _PARTS = (64, 960), (1024, 1024), (2048, 1024), (3072, 1024), (4096, SIZE - 4096)

_ADVICE = (
    "and there is no result. Run it in its own process, where this is a failed step: --isolate, or IsolatedComponent "
    "(docs/how_to/foreign_fmus.md)"
)


class _Text:
    """A text at a position of a record's memory."""

    def __init__(self, *place: int) -> None:
        self._place = place[0], place[1]

    def __get__(self, of: Record, owner: type) -> str:
        return of._read(self._place)

    def __set__(self, of: Record, text: str) -> None:
        of._write(self._place, text)


class Record:
    """The FMU that this process is calling, in memory that another process reads.

    Args:
        memory: Memory of SIZE bytes, zero at first.
    """

    #: Position of the loop's calls in the memory [bytes]: their number and the part that is called.
    calls = 8 * _CALLS
    clock = 8 * _CLOCK  #: Position of the loop's time in the memory [bytes].

    def __init__(self, memory: mmap.mmap) -> None:
        self.memory = memory
        self.owner = os.getpid()  #: Number of the process that calls.
        self._words = memoryview(memory)[:_WORDS].cast("q")

    @property
    def code(self) -> int | None:
        """Exit code of a command that is complete; None before."""
        code = self._words[_CODE]
        return code - 1 if code else None

    def complete(self, code: int) -> None:
        """Record that the command is complete."""
        self._words[_CODE] = (code & 0xFF) + 1

    @property
    def state(self) -> bytes:
        """Bytes that change with every call."""
        return self.memory[:_WORDS]

    @property
    def is_calling(self) -> bool:
        """Whether an FMU is being called."""
        return self._words[_WHO] != _NOBODY

    @contextmanager
    def calling(self, component: str, what: str) -> Iterator[None]:
        """Record a call from Python; `what` completes "it was called to ..."."""
        words = self._words
        before = words[_WHO]
        self._write(_CALL, f"{component}\n to {what}")
        words[_COUNT] += 1
        words[_WHO] = _PYTHON
        try:
            yield
        finally:
            words[_WHO] = before

    @contextmanager
    def calling_loop(self) -> Iterator[None]:
        """Record that the loop runs, which itself records the part that it calls."""
        self._words[_WHO] = _LOOP
        try:
            yield
        finally:
            self._words[_WHO] = _NOBODY

    def name_parts(self, names: Sequence[str]) -> None:
        """Write the names of the loop's parts, in the order of their numbers."""
        self._write(_PARTS, "\n".join(names))

    @property
    def called(self) -> tuple[str, str]:
        """The component that is being called, and for what, or when."""
        if self._words[_WHO] == _PYTHON:
            name, _, what = self._read(_CALL).partition("\n")
            return name, what
        names, place = self._read(_PARTS).splitlines(), self._words[_PART]
        (seconds,) = struct.unpack_from("d", self.memory, self.clock)
        return names[place] if 0 <= place < len(names) else "unknown", f" at {seconds:g} s"

    folder = _Text(*_FOLDER)  #: Folder for temporary files, which the other process removes; empty before it exists.
    remains = _Text(*_REMAINS)  #: Sentence about what remains of earlier runs if the command does not complete.
    file = _Text(*_FILE)  #: File that is being read by a library that can end the process; empty before and after.

    def end_of_process(self) -> str:
        """Return the error for the end of this process while an FMU is called."""
        name, what = self.called
        return (
            f"this process ended while component {name} was called{what}: the FMU crashed or called exit(), {_ADVICE}"
        )

    def hang(self) -> str:
        """Return the error for an FMU that does not return."""
        name, what = self.called
        return (
            f"component {name} was called{what} and did not return within {TIME_LIMIT:g} s; it was ended, {_ADVICE}. "
            "If it is only slow, set the environment variable EIGHTPOST_TIME_LIMIT to more seconds"
        )

    def _write(self, place: tuple[int, int], text: str) -> None:
        content = text.encode("utf-8", "replace")[: place[1] - 1] + b"\0"
        self.memory[place[0] : place[0] + len(content)] = content

    def _read(self, place: tuple[int, int]) -> str:
        return self.memory[place[0] : sum(place)].split(b"\0")[0].decode("utf-8", "replace")


def tell(text: str) -> None:
    """Let the other process, if there is one, print a sentence if this command does not complete."""
    if record is not None:
        record.remains = text


@contextmanager
def reading(path: str) -> Iterator[None]:
    """Let the other process, if there is one, name a file if the library that reads it ends this process."""
    if record is not None:
        record.file = path
    try:
        yield
    finally:
        if record is not None:
            record.file = ""


#: Record of this process, if another process reads it.
record: Record | None = None
#: Whether this process is a worker, which its pool supervises by heartbeats.
is_worker = False

# ---- A command, which runs in a child of the process that was started ------------------------------------------------

#: Interval at which the record is read [s], and time within which a signal to both processes reaches both [s].
_LOOK, _TOGETHER = 0.1, 0.5

#: Number of objects between two collections of cyclic garbage: a command imports and makes many objects that stay.
_ALLOCATIONS = 50_000


def supervised(work: Callable[[], object], complain: Callable[[str], None]) -> int:
    """Run a command in a child of this process, and return its exit code; in the child this does not return.

    The code is 1 if the child ended before the command was complete, or was ended because an FMU did not return.
    """
    global record  # noqa: PLW0603 -- one record per process
    if sys.platform == "win32":
        return _supervised_on_windows(work, complain)
    else:
        record = Record(mmap.mmap(-1, SIZE))
        (told, tell), (life, hold) = os.pipe(), os.pipe()
        passed = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, passed)
        gc.freeze()  # otherwise each collection in the child copies the memory that both share
        parent, child = os.getpid(), os.fork()
        if child == 0:
            os.close(told)
            os.close(hold)
            os.set_blocking(tell, False)
            signal.set_wakeup_fd(tell, warn_on_full_buffer=False)  # tells the parent which signals came here, too
            _work(work, record, life, partial(signal.pthread_sigmask, signal.SIG_SETMASK, before))
        os.close(tell)
        os.close(life)
        command = _Command(child, told, record)
        for number in passed:
            signal.signal(number, command.pass_on)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        status = command.wait()
        _remove(record.folder)
        if -status in passed and record.code is None:  # somebody ended the command: end in the same way
            signal.signal(-status, signal.SIG_DFL)
            os.kill(parent, -status)
        return _code(record, status, command.watch, complain)


def _supervised_on_windows(work: Callable[[], object], complain: Callable[[str], None]) -> int:
    """Do the same with a new process, because there is no fork."""
    if sys.platform != "win32":  # for the type checker
        raise NotImplementedError
    import subprocess  # noqa: PLC0415

    from eightpost.workers.process import python_command  # noqa: PLC0415

    global record  # noqa: PLW0603
    name = os.environ.pop("EIGHTPOST_SUPERVISED", "")
    record = Record(mmap.mmap(-1, SIZE, tagname=name or f"eightpost_{os.getpid()}"))  # type: ignore[call-arg]
    if name:
        _work(work, record)
    environment = {**os.environ, "EIGHTPOST_SUPERVISED": f"eightpost_{os.getpid()}"}
    child = subprocess.Popen(python_command("eightpost", *sys.argv[1:]), env=environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both
    watch = _Watch(record)
    while True:
        with suppress(subprocess.TimeoutExpired):
            status = child.wait(_LOOK)
            _remove(record.folder)
            return _code(record, status, watch, complain)
        if watch.is_hung():
            child.kill()


def _work(
    work: Callable[[], object], mine: Record, life: int | None = None, unblock: Callable[[], object] = lambda: None
) -> NoReturn:
    """Run a command in the child, and record its exit code when it is complete.

    This process ends with its parent, which has the other end of the pipe `life`. Signals that came before are
    received when the function `unblock` is called.
    """
    import tempfile  # noqa: PLC0415 -- none of this is needed in the parent
    import threading  # noqa: PLC0415
    from pathlib import Path  # noqa: PLC0415

    from eightpost.marks import mark, remove_left  # noqa: PLC0415

    with suppress(OSError):  # what needs the folder reports the error
        place = Path(tempfile.gettempdir())
        remove_left(place, "eightpost_")
        folder = place / f"eightpost_{mark()}"
        folder.mkdir(0o700)
        mine.folder = tempfile.tempdir = os.environ["TMPDIR"] = str(folder)  # the last one for its workers
    if life is not None:
        threading.Thread(target=_end_with_parent, args=(life, mine.folder), name="end with parent", daemon=True).start()
    gc.set_threshold(_ALLOCATIONS)
    sys.unraisablehook = _interrupt_again
    mine.owner, code = os.getpid(), 1
    interrupts = list[int]()

    def interrupt(number: int, frame: Any) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    if callable(signal.getsignal(signal.SIGINT)):  # otherwise it is ignored
        signal.signal(signal.SIGINT, interrupt)
    try:
        unblock()
        work()
        code = 0
    except (KeyboardInterrupt, ImportError):  # outside the command, or in an import that turned it into its own error
        if not interrupts:
            raise
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        raise
    finally:
        with suppress(OSError, ValueError, AttributeError):  # Python reports the error when it ends
            sys.stdout.flush()
        mine.complete(code)
    sys.exit()


def _interrupt_again(lost: Any) -> None:
    """Repeat an interrupt that a finalizer or a callback received, which Python prints and forgets."""
    if lost.exc_type is not KeyboardInterrupt or sys.platform == "win32":
        sys.__unraisablehook__(lost)
        return
    import threading  # noqa: PLC0415 -- not needed in the parent

    again = threading.Timer(_LOOK, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True  # a command that ends in the meantime was complete
    again.start()


def _end_with_parent(life: int, folder: str) -> None:
    from eightpost.workers.process import leave  # noqa: PLC0415 -- not needed in the parent

    with suppress(OSError):  # the pipe ends with the parent
        os.read(life, 1)
        leave(folder)


def _remove(folder: str) -> None:
    """Remove the temporary folder of a command, which is not empty if the command was not complete."""
    with suppress(OSError):
        if folder:
            os.rmdir(folder)  # noqa: PTH106
        return
    from pathlib import Path  # noqa: PLC0415 -- needed here only

    from eightpost.marks import remove_folder  # noqa: PLC0415

    remove_folder(Path(folder))


def _code(found: Record, status: int, watch: _Watch, complain: Callable[[str], None]) -> int:
    """Return the exit code of a command whose process has ended, and print why if the command was not complete."""
    if found.code is not None:
        return max(status, 0) or found.code
    if watch.hung:
        what = watch.hung
    elif found.is_calling:
        what = found.end_of_process()
    elif found.file:
        complain(f"{found.file}: damaged: the library that reads it ended this process; copy or write the file again")
        return 2
    else:
        how = f"with code {status}" if status >= 0 else f"by signal {-status}"
        what = f"the process of this command ended {how} before the command was complete: there is no result"
    complain(". ".join(filter(None, (what, found.remains))))
    return 1


class _Watch:
    """Time without a change while an FMU is called, or after the command was complete."""

    def __init__(self, found: Record) -> None:
        self._record, self._state, self._quiet, self._before = found, b"", 0.0, time.monotonic()
        self.hung = ""  #: Error for the FMU that does not return; empty until then.

    def is_hung(self) -> bool:
        """Return whether the process is to be ended; call this at every interval."""
        state, now = self._record.state, time.monotonic()
        since, self._before = min(now - self._before, 2.0 * _LOOK), now  # this process may have been stopped itself
        waits = self._record.is_calling or self._record.code is not None
        self._quiet, self._state = self._quiet + since if waits and state == self._state else 0.0, state
        if self._quiet > TIME_LIMIT:
            self.hung = self._record.hang()
        return bool(self.hung)


if sys.platform != "win32":

    class _Command:
        """The child that runs a command, seen from its parent.

        The pipe `told` says which signals it received.
        """

        def __init__(self, child: int, told: int, found: Record) -> None:
            self._child, self._told, self.watch = child, told, _Watch(found)
            self._arrived: dict[int, float] = {}
            self._pause = 0.001
            os.set_blocking(told, False)

        def wait(self) -> int:
            """Wait for the end of the child, and end it if it hangs; return its exit code, negative for a signal."""
            while True:
                self._listen(_LOOK)
                ended, status = os.waitpid(self._child, os.WNOHANG)
                if ended:
                    return os.waitstatus_to_exitcode(status)
                if self.watch.is_hung():
                    os.kill(self._child, signal.SIGKILL)

        def pass_on(self, number: int, _frame: Any) -> None:
            """Pass a signal on to the child, unless it was sent to both, as Ctrl-C in a terminal is."""
            began = time.monotonic()
            while self._arrived.get(number, 0.0) < began - _TOGETHER:
                if (left := began + _TOGETHER - time.monotonic()) <= 0.0:
                    with suppress(ProcessLookupError):
                        os.kill(self._child, number)
                    return
                self._listen(left)

        def _listen(self, seconds: float) -> None:
            """Wait for signals that the child received, up to some seconds."""
            if not select.select([self._told], [], [], seconds)[0]:
                return
            with suppress(BlockingIOError):  # read in a handler
                if numbers := os.read(self._told, 64):
                    self._arrived.update(dict.fromkeys(numbers, time.monotonic()))
                    return
                time.sleep(min(seconds, self._pause))  # the child has closed the pipe: as a rule, it has ended
                self._pause = min(2.0 * self._pause, _LOOK)


# ---- A program of a user: this file as a process that waits for its end ---------------------------------------------


def _wait_for_end(file: str) -> None:
    """Print an error if the process that holds the standard input of this one ends while an FMU is called."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdin.buffer.read()
    with open(file, "r+b") as stream:  # noqa: PTH123 -- pathlib takes long to load
        found = Record(mmap.mmap(stream.fileno(), SIZE))
    os.unlink(file)  # noqa: PTH108
    if found.is_calling:
        sys.stderr.write(f"error: {found.end_of_process()}\n")


if __name__ == "__main__":
    _wait_for_end(sys.argv[1])
