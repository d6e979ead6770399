"""Component in its own process: a crash of its FMU is an error that names the component."""

from __future__ import annotations

import contextlib
import ctypes
import itertools
import logging
import mmap
import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from cosim.components.component import Callbacks, FunctionTable
from cosim.components.fmu_component import FmuComponent, State
from cosim.components.fmu_file import FmuFile
from cosim.components.watch import ComponentLog, OpenedFmu
from eightpost.errors import EightpostError, FmuError, InputError, StepError, TerminatedError
from eightpost.workers.process import Child, EndedError, ParentChannel, leave
from eightpost.workers.supervision import TIME_LIMIT

# ==== Component in its own process: a crash of its FMU is an error that names the component ==========================

_STARTING = 60.0  # s: for Python and fmpy, without the FMU
_PRINTED = 65536  # bytes of the FMU's output per run that are passed on
_ERRORS: dict[str, type[EightpostError]] = {kind.__name__: kind for kind in (StepError, TerminatedError, FmuError)}

_Call = tuple[Any, ...]

_CRASHED = (
    "check whether these inputs are in its range, try a smaller coupling step, and report the fault to its maker; it "
    "can be started again, in a new process"
)
_HUNG = (
    "if it is only slow, increase the time limit (IsolatedComponent(..., time_limit=...)); otherwise check whether "
    "these inputs are in its range, try a smaller coupling step, and report the fault to its maker"
)
_CALLS = {
    "begin": "begin",
    "end_initialization": "leave initialization",
    "set": "set inputs",
    "set_derivatives": "set input derivatives",
    "get": "get outputs",
    "derive": "give directional derivatives",
    "save": "save its state",
    "restore": "restore a state",
    "free": "free a state",
    "finish": "terminate",
}


class IsolatedComponent(OpenedFmu):
    """One instance of an FMU in a child process with its own working folder.

    An FMU that this project did not build gets a new process and an empty folder for each run, so that no state outside
    its instance survives.

    Inputs, slopes and saved states are sent with the next step, and the variables that were read after the last step
    are returned with it, so a step needs one request and one reply. If an input is refused, that step or reading
    reports it. Every call of a run raises StepError if the component is not running, or the FMU refuses it, crashes or
    hangs. Values are in the FMU's own units.

    Args:
        path: FMU file (.fmu).
        name: Name of the component.
        time_limit: Time limit for each reply of the FMU [s], after which the process is ended; by default 30 s, or
            the environment variable EIGHTPOST_TIME_LIMIT.
        compile_missing: Whether to compile the FMU's sources if it has no binary for this platform.

    Raises:
        FmuError: The file cannot be used; see FmuComponent.
        InputError: The time limit is not positive.
    """

    def __init__(
        self, path: str | Path, name: str, *, time_limit: float = TIME_LIMIT, compile_missing: bool = False
    ) -> None:
        if not time_limit > 0.0:
            raise InputError(f"component {name!r}: the time limit must be positive, not {time_limit!r} s")
        self._time_limit = time_limit
        self._folder = tempfile.mkdtemp(prefix="fmu_")
        self._processes: list[_Process] = []
        # close() ends the process and removes the folder: on call, or when the component or the interpreter ends.
        self.close = weakref.finalize(self, _release, self._processes, self._folder, os.getpid())
        self._log = ComponentLog(name)
        fmu = FmuFile.unpack(path, Path(self._folder, "fmu"), compile_missing=compile_missing)
        super().__init__(fmu, name, self._log.messages)
        self._numbers = itertools.count()
        self._states = set[State]()
        self._pending: list[_Call] = []
        self._asked: dict[tuple[str, ...], None] = {}
        self._known: dict[tuple[str, ...], list[float]] = {}
        self._running = False
        self._process = self._start()

    def functions(self) -> FunctionTable:
        """Return the addresses of callbacks that call the child process, for the loop."""
        return Callbacks(self).table()

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call that failed without an error of its own; for arguments see FmuComponent."""
        self._stand(time, self._inputs | dict(inputs))
        return self._failure(f"failed to {what}", f"it returned {status}.")

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Begin a run as FmuComponent does; in a new process if the last one has ended."""
        self.finish()
        self._log.messages.clear()
        self._asked.clear()
        self._stand(start, {})
        if not self._process.alive:
            self._process = self._start()
        self._running = True
        self._do(("begin", start, stop, dict(parameters)))

    def end_initialization(self) -> None:
        """Leave initialization mode."""
        self._do(("end_initialization",))

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set real inputs (N,) to values (N,) in the FMU's own units, with the next step or reading."""
        numbers = tuple(map(float, values))
        self._inputs.update(zip(names, numbers, strict=True))
        self._later(("set", tuple(names), numbers))

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set first derivatives (N,) of real inputs (N,), in the FMU's own units per second, with the next step."""
        self._later(("set_derivatives", tuple(names), tuple(map(float, values))))

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the values (N,) of real variables (N,), in the FMU's own units.

        Variables that were read after the last step are available without a call."""
        key = tuple(names)
        self._asked[key] = None
        if key not in self._known:
            (*_, values) = self._do(("get", key))
            self._known[key] = values
        return list(self._known[key])

    def derive(self, outputs: Sequence[str], inputs: Sequence[str], changes: Sequence[float]) -> list[float]:
        """Return how real outputs (N,) change, without delay, with small changes (M,) of real inputs (M,)."""
        (*_, effects) = self._do(("derive", tuple(outputs), tuple(inputs), tuple(changes)))
        return list(effects)

    def step(self, time: float, step: float) -> None:
        """Make one step from `time` by `step` [s], and read the variables that were read after the last one."""
        self._time = time
        requested, self._asked = tuple(self._asked), {}
        results = self._do(("step", float(time), float(step)), *(("get", names) for names in requested))
        self._time = time + step
        self._known = dict(zip(requested, results[len(results) - len(requested) :], strict=True))

    def save(self) -> object:
        """Save the state as FmuComponent does; the child process identifies it by a number."""
        self._check_state()
        self._check_running()
        state = State(next(self._numbers), self._time, dict(self._inputs))
        self._pending.append(("save", state.place))
        self._states.add(state)
        return state

    def restore(self, state: object) -> None:
        """Restore a state that `save` returned, with the next step or reading."""
        saved = self._checked(state)
        self._later(("restore", saved.place))
        self._stand(saved.time, saved.inputs)

    def free(self, state: object) -> None:
        """Free a state."""
        saved = self._checked(state)
        self._states.discard(saved)
        self._pending.append(("free", saved.place))

    def finish(self) -> None:
        """Terminate; the process of an FMU built by eightpost is kept for the next `begin`, any other is ended."""
        running, self._running = self._running, False
        self._pending, self._known = [], {}
        self._states.clear()
        if running and self._process.alive:
            with contextlib.suppress(StepError):  # the error that ended the run has been reported already
                self._ask([("finish",)])
            self._pass_on_prints()
            if not self.is_ours:
                self._process.kill()

    def _start(self) -> _Process:
        process = _Process(self._fmu.path.absolute(), self._name, Path(self._folder), self._log.write)
        self._processes[:] = [process]
        return process

    def _later(self, call: _Call) -> None:
        self._check_running()
        self._pending.append(call)
        self._known = {}

    def _do(self, *calls: _Call) -> list[Any]:
        """Make the pending calls, then these."""
        self._check_running()
        pending, self._pending = self._pending, []
        self._known = {}
        return self._ask([*pending, *calls])

    def _ask(self, calls: list[_Call]) -> list[Any]:
        try:
            return self._process.call(calls, self._time_limit)
        except EndedError as ended:
            name, *arguments = calls[min(self._process.calls_begun(), len(calls) - 1)]
            what = _CALLS[name] if name != "step" else "step from {:g} s by {:g} s".format(*arguments)
            printed = self._pass_on_prints()
            why = f"it printed {printed[-1]!r}." if printed else "it printed nothing."
            raise self._failure(f"{ended.how} in: {what}", why, _HUNG if ended.hung else _CRASHED) from None

    def _pass_on_prints(self) -> list[str]:
        printed = self._process.printed()
        for line in printed:
            self._log.write(logging.DEBUG, f"printed: {line}")
        return printed

    def _check_running(self) -> None:
        if not (self._running and self._process.alive):
            raise self._not_begun()

    def _checked(self, state: object) -> State:
        self._check_running()
        if not isinstance(state, State) or state not in self._states:
            raise self._unknown_state()
        return state


class _Process(Child):
    """Child process with one FMU."""

    def __init__(self, path: Path, name: str, folder: Path, log: Callable[[int, str], None]) -> None:
        self._folder, self._log, self._read = folder, log, 0
        shutil.rmtree(folder / "work", ignore_errors=True)  # remove the files of an earlier process
        (folder / "work").mkdir(exist_ok=True)
        (folder / "call").write_bytes(b"\0")
        with (folder / "printed").open("wb") as printed:
            super().__init__(
                "cosim.components.isolated",
                *(str(path), name, str(folder)),
                bare="cosim",
                folder=str(folder),
                starting=_STARTING,
                cwd=folder,
                stdout=printed,
                stderr=subprocess.STDOUT,
            )

    def call(self, calls: Sequence[_Call], seconds: float) -> list[Any]:
        """Make calls in order; return the result of each."""
        outcome, *answer = self.ask(list(calls), seconds, lambda message: self._log(*message))
        if outcome == "done":
            return list(answer[0])
        kind, message, usable = answer
        if not usable:
            self.kill()
        raise _ERRORS.get(kind, StepError)(message)

    def calls_begun(self) -> int:
        """Return the index of the call that was begun last; after a crash, that of the call that crashed."""
        return int.from_bytes((self._folder / "call").read_bytes()[:1], "little")

    def printed(self) -> list[str]:
        """Return the lines printed since the last call; only the last ones if there are many."""
        with (self._folder / "printed").open("rb") as file:
            file.seek(max(self._read, file.seek(0, os.SEEK_END) - _PRINTED))
            text = file.read()
            self._read = file.tell()
        return [line.rstrip() for line in text.decode("utf-8", "replace").splitlines() if line.strip()]


def _release(processes: Sequence[_Process], folder: str, owner: int) -> None:
    """End the process and remove the folder, except in a process that was forked off the owner."""
    for process in processes:
        process.close()
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


# ==== Child process of an isolated component: an FMU and the calls that the parent sends =============================

_LINE_BUFFERED = 1  # glibc's _IOLBF


def serve(channel: str, path: str, name: str, folder: str) -> None:
    """Run an FMU for the parent until the parent closes the channel or ends.

    Args:
        channel: Number of the channel.
        path: FMU file (.fmu).
        name: Name of the component.
        folder: Folder with the unpacked FMU in `fmu`, the working folder `work` and the counter of calls `call`.
    """
    with suppress(Exception):  # works with glibc; elsewhere the last lines before a crash may be lost in the buffer
        library = ctypes.CDLL(None)
        library.setvbuf(ctypes.c_void_p.in_dll(library, "stdout"), None, _LINE_BUFFERED, 0)
    parent = ParentChannel(channel)
    os.chdir(Path(folder, "work"))
    with Path(folder, "call").open("r+b") as counter:
        component = FmuComponent(path, name, folder=Path(folder, "fmu"))
        parent.serve(_Service(parent, component, name, counter).answer)
        component.finish()
        component.close()
    _flush()
    leave(folder)


class _Service:
    """Answers to batches of calls; each saved state has the number that the parent gave it."""

    def __init__(self, parent: ParentChannel, component: FmuComponent, name: str, counter: Any) -> None:
        self._component = component
        self._states: dict[int, object] = {}
        self._counter = mmap.mmap(counter.fileno(), 1)
        logger = logging.getLogger(f"cosim.fmu.{name}")
        logger.setLevel(logging.DEBUG)
        logger.propagate = False
        logger.addHandler(_Forward(parent))

    def answer(self, batch: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
        """Make calls in order; return ("done", results), or ("failed", ...) with the first error."""
        results = []
        for index, (what, *arguments) in enumerate(batch):
            self._counter[0] = min(index, 255)  # the counter keeps this value after a crash
            try:
                results.append(self._call(what, arguments))
            except EightpostError as error:
                return "failed", type(error).__name__, str(error), self._component.usable
        return "done", results

    def _call(self, what: str, arguments: Sequence[Any]) -> Any:
        if what == "save":
            self._states[arguments[0]] = self._component.save()
            return None
        if what in ("restore", "free"):
            number = arguments[0]
            arguments = [self._states[number] if what == "restore" else self._states.pop(number)]
        if what == "begin":
            self._states.clear()
        result = getattr(self._component, what)(*arguments)
        if what == "finish":
            _flush()
        return result


class _Forward(logging.Handler):
    """Log handler that sends messages at once, so that the last messages before a crash arrive."""

    def __init__(self, parent: ParentChannel) -> None:
        super().__init__()
        self._parent = parent

    def emit(self, record: logging.LogRecord) -> None:
        """Send one message."""
        self._parent.notify((record.levelno, record.getMessage()))


def _flush() -> None:
    """Flush the FMU's output from the C library's buffer, if this process shares that library."""
    with suppress(Exception):
        ctypes.CDLL(None).fflush(None)


if __name__ == "__main__":
    serve(*sys.argv[1:])
