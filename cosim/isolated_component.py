"""An FMU as a component in a process of its own: its crash or hang is a failed step, and nothing else fails."""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.fmu_failure import no_state, not_begun, unknown_state
from cosim.fmu_file import FmuFile, remove, temporary_folder
from cosim.fmu_log import ComponentLog
from cosim.functions import FunctionTable
from cosim.isolation.callbacks import StateCallbacks
from cosim.isolation.process import Call, EndedError, Process
from cosim.opened_fmu import OpenedFmu
from eightpost.errors import InputError, StepError

#: How long a call may take [s].
DEFAULT_TIME_LIMIT = 30.0

_CRASHED = (
    "look whether these inputs are in its range, try a smaller coupling step, and tell its maker; it may begin again, "
    "in a new process"
)
_HUNG = (
    "where it is only slow, give it more time (IsolatedComponent(..., time_limit=...)); else as for a crash: inputs in "
    "its range, a smaller coupling step, its maker"
)
_CALLS = {
    "begin": "begin",
    "end_initialization": "leave initialization",
    "set": "set inputs",
    "set_derivatives": "set input derivatives",
    "get": "get outputs",
    "save": "save its state",
    "restore": "restore a state",
    "free": "free a state",
    "finish": "terminate",
}


class IsolatedComponent(OpenedFmu):
    """One instance of an FMU in a child process, with a working folder of its own.

    An FMU that this project did not build gets a new process and an empty folder for each run: whatever it keeps
    elsewhere than in its instance is gone with the old ones.

    Inputs, slopes and saved states go along with the next step, and what was read after the last step comes back with
    it, so a step is one question and one answer. What an input is refused for is told with that step or reading.

    Args:
        path: The .fmu file.
        name: Name of the component.
        time_limit: How long the FMU may take to answer [s]; then it is ended.
        compile_missing: Whether to compile the FMU's sources where it has no binary for this platform.

    Raises:
        FmuError: As FmuComponent.
        InputError: The time limit is not positive.
    """

    def __init__(
        self, path: str | Path, name: str, *, time_limit: float = DEFAULT_TIME_LIMIT, compile_missing: bool = False
    ) -> None:
        if not time_limit > 0.0:
            raise InputError(f"component {name!r}: the time limit must be positive, it is {time_limit!r} s")
        self._time_limit = time_limit
        self._folder = temporary_folder()
        self._processes: list[Process] = []
        # Ends the process and removes the folder: with the component, with the interpreter, or on call.
        self.close = weakref.finalize(self, _release, self._processes, self._folder, os.getpid())
        self._log = ComponentLog(name)
        fmu = FmuFile.unpack(path, Path(self._folder, "fmu"), compile_missing=compile_missing)
        super().__init__(fmu, name, self._log.messages)
        self._numbers = itertools.count()
        self._states: set[_State] = set()
        self._pending: list[Call] = []
        self._asked: dict[tuple[str, ...], None] = {}
        self._known: dict[tuple[str, ...], list[float]] = {}
        self._running = False
        self._process = self._start()

    def functions(self) -> FunctionTable:
        """Return the addresses of callbacks that ask the child, for the loop."""
        return StateCallbacks(self).table()

    def refused(self, what: str, status: int, time: float, inputs: Mapping[str, float]) -> StepError:
        """Return the error for a call that failed without one of its own; arguments as of FmuComponent."""
        self._stand(time, self._inputs | dict(inputs))
        return self._failure(f"failed to {what}", f"it returned {status}.")

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """As FmuComponent; in a new process where the last one ended.

        Raises:
            StepError: The FMU fails to, crashes or hangs.
        """
        self.finish()
        self._log.messages.clear()
        self._asked.clear()
        self._stand(start, {})
        if not self._process.alive:
            self._process = self._start()
        self._running = True
        self._do(("begin", start, stop, dict(parameters)))

    def end_initialization(self) -> None:
        """Leave initialization mode.

        Raises:
            StepError: It does not run, fails to, crashes or hangs.
        """
        self._do(("end_initialization",))

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set real inputs (N,) to values (N,) in its own units, with the next step or reading.

        Raises:
            StepError: It does not run.
        """
        numbers = tuple(map(float, values))
        self._inputs.update(zip(names, numbers, strict=True))
        self._later(("set", tuple(names), numbers))

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set first derivatives (N,) of real inputs (N,), in its own units per second, with the next step.

        Raises:
            StepError: It does not run.
        """
        self._later(("set_derivatives", tuple(names), tuple(map(float, values))))

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the values (N,) of real variables (N,), in its own units.

        Those that were read after the last step are here already.

        Raises:
            StepError: It does not run, refuses, crashes or hangs.
        """
        key = tuple(names)
        self._asked[key] = None
        if key not in self._known:
            (*_, values) = self._do(("get", key))
            self._known[key] = values
        return list(self._known[key])

    def step(self, time: float, step: float) -> None:
        """Do one step from `time` by `step` [s], and read what was read after the last one.

        Raises:
            StepError: It does not run, refuses the step, crashes or hangs.
        """
        self._time = time
        wanted, self._asked = tuple(self._asked), {}
        results = self._do(("step", float(time), float(step)), *(("get", names) for names in wanted))
        self._time = time + step
        self._known = dict(zip(wanted, results[len(results) - len(wanted) :], strict=True))

    def save(self) -> object:
        """As FmuComponent: a number by which the child knows the state.

        Raises:
            StepError: It cannot save its state (`capabilities.state`), or does not run.
        """
        if not self.capabilities.state:
            raise StepError(no_state(self._name, self.source))
        self._check_running()
        state = _State(next(self._numbers), self._time, dict(self._inputs))
        self._pending.append(("save", state.number))
        self._states.add(state)
        return state

    def restore(self, state: object) -> None:
        """Go back to a state that `save` returned, with the next step or reading.

        Raises:
            StepError: It does not run, or the state is not one of this run.
        """
        known = self._checked(state)
        self._later(("restore", known.number))
        self._stand(known.time, known.inputs)

    def free(self, state: object) -> None:
        """Give a state back.

        Raises:
            StepError: It does not run, or the state is not one of this run.
        """
        known = self._checked(state)
        self._states.discard(known)
        self._pending.append(("free", known.number))

    def finish(self) -> None:
        """Terminate; the process of an FMU of ours waits for the next `begin`, any other is ended."""
        running, self._running = self._running, False
        self._forget()
        self._states.clear()
        if running and self._process.alive:
            with contextlib.suppress(StepError):  # whatever ended the run has been told
                self._ask([("finish",)])
            self._pass_on_prints()
            if not self.is_ours:
                self._process.kill()

    def _start(self) -> Process:
        process = Process(self._fmu.path.absolute(), self._name, Path(self._folder), self._log.write)
        self._processes[:] = [process]
        return process

    def _later(self, call: Call) -> None:
        self._check_running()
        self._pending.append(call)
        self._known = {}

    def _do(self, *calls: Call) -> list[Any]:
        """Have what is pending done, then these."""
        self._check_running()
        pending, self._pending = self._pending, []
        self._known = {}
        return self._ask([*pending, *calls])

    def _ask(self, calls: list[Call]) -> list[Any]:
        try:
            return self._process.ask(calls, self._time_limit)
        except EndedError as ended:
            what = _description(calls[min(ended.index, len(calls) - 1)])
            printed = self._pass_on_prints()
            why = f"it printed {printed[-1]!r}." if printed else "it printed nothing."
            raise self._failure(f"{ended.how} in: {what}", why, _HUNG if ended.hung else _CRASHED) from None

    def _pass_on_prints(self) -> list[str]:
        printed = self._process.printed()
        for line in printed:
            self._log.write(logging.DEBUG, f"printed: {line}")
        return printed

    def _forget(self) -> None:
        self._pending, self._known = [], {}

    def _check_running(self) -> None:
        if not (self._running and self._process.alive):
            raise StepError(not_begun(self._name, self.source))

    def _checked(self, state: object) -> _State:
        self._check_running()
        if not isinstance(state, _State) or state not in self._states:
            raise StepError(unknown_state(self._name, self.source))
        return state


class _State:
    """A state that the child holds, and where the run stood."""

    def __init__(self, number: int, time: float, inputs: Mapping[str, float]) -> None:
        self.number, self.time, self.inputs = number, time, inputs


def _release(processes: Sequence[Process], folder: str, owner: int) -> None:
    """End the process and remove the folder, but not in a process forked off the owner."""
    for process in processes:
        process.close()
    if os.getpid() == owner:
        remove(folder)


def _description(call: Call) -> str:
    if call[0] == "step":
        return f"step from {call[1]:g} s by {call[2]:g} s"
    return _CALLS[call[0]]
