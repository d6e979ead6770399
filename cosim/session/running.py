"""State of a run: components in progress, and errors that name the component that fails."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

from cosim.components.fmu_component import FmuComponent
from cosim.components.functions import Callbacks, FunctionTable, Native, free_states, function_table
from cosim.components.watch import Surroundings, loop_words, watching
from cosim.engine.compiled import Bind
from cosim.engine.march import Tape
from cosim.engine.plan import DISCARD, DIVERGED, JACOBI, STEP, Memory, Mode, Plan, memory
from cosim.session.equilibrium import Equilibrium, solve_equilibrium
from cosim.session.planning import make_plan
from cosim.session.recorder import blank_tape, real_names
from cosim.session.setup import Setup
from eightpost.errors import DivergedError, StepError, TerminatedError
from eightpost.progress import Progress

# ---- Guard of a run -------------------------------------------------------------------------------------------------

#: Number of steps of the compiled loop between checks of shared state.
CHUNK = 1000


def guarded(setup: Setup) -> dict[str, FmuComponent]:
    """Return the components of a run that are checked."""
    parts = setup.system.components.items()
    return {name: part for name, part in parts if isinstance(part, FmuComponent) and part.is_guarded}


def watched(setup: Setup) -> AbstractContextManager[None]:
    """Return a context that watches the run if it has components to check."""
    if not guarded(setup):
        return nullcontext()
    return watching([f"{name!r} ({setup.system.components[name].source})" for name in setup.layout.parts])


def undoing(setup: Setup, progress: Progress) -> Progress:
    """Return `progress`, extended to undo changes that FMUs made while the loop ran, and to record them as notes.

    FMUs that this project built are suspected only if there are no others.
    """
    parts, before = guarded(setup), Surroundings.now()
    if not parts:
        return progress
    parts = {name: part for name, part in parts.items() if not part.is_ours} or parts

    def check(done: float, total: float) -> None:
        for changed in before.restore():
            for name, part in parts.items():
                others = [f"{other!r}" for other in parts if other != name]
                part.blame(f"{changed} while stepping" + (f", or {' or '.join(others)} did" if others else ""))
        progress(done, total)

    return check


# ---- State of a run while its components step -----------------------------------------------------------------------


#: Maximum number of solutions of the equilibrium start, which is repeated if a discrete value has changed.
_ROUNDS = 10


@dataclass(frozen=True)
class Running:
    """Components that have begun, in the form that the loop uses."""

    plan: Plan  #: Arrays that do not change.
    memory: Memory  #: Arrays that the run changes.
    tape: Tape  #: Recorded values.
    tables: Mapping[str, FunctionTable]  #: Functions by component.

    def stop(self) -> None:
        """Make the loop stop before its next step."""
        self.memory.stop.fill(1)

    def free_states(self, setup: Setup) -> None:
        """Free the states that the loop saved."""
        free_states([self.tables[name] for name in setup.layout.parts], self.memory.states, self.memory.calls)


@dataclass(frozen=True)
class Marching:
    """The loop and the parameters of its calls."""

    bind: Bind  #: Function that takes the loop's named tuples and returns the loop.
    chunk: int  #: Number of steps per call.
    mode: Mode  #: Settings of the scheme for a step.
    progress: Progress  #: Callback that receives the completed share and 1, after each call of the loop.


@dataclass(frozen=True)
class Ending:
    """Ending of the loop."""

    why: int  #: Reason: DONE, STOPPED or STUCK of cosim.engine.plan.
    time: float  #: Time that was reached [s].
    least: float  #: Smallest step [s].
    largest: float  #: Largest step [s].
    began: float  #: Value of the clock (time.perf_counter) before the first step [s].
    ended_by: str = ""  #: Component that ended the simulation before the stop time; empty if none did.


def begin(setup: Setup) -> None:
    """Begin every component, which is then in initialization.

    Raises:
        StepError: A component failed.
    """
    setup.discrete.begin()
    for name, component in setup.system.components.items():
        component.begin(0.0, setup.scenario.stop, setup.system.start_values(name))


def equilibrium_start(setup: Setup) -> Equilibrium:
    """Find the state in which inputs and outputs agree; discrete values, which may jump, are exchanged in between.

    Raises:
        StepError: A component failed.
    """
    setup.discrete.exchange(0.0)
    for _ in range(_ROUNDS):
        equilibrium = solve_equilibrium(setup.coupling, setup.layout.parts)
        if not setup.discrete.exchange(0.0):
            return equilibrium
    return replace(equilibrium, converged=False)


def prepare(setup: Setup) -> Running:
    """Leave initialization; return the loop's arrays for components that are at the equilibrium start.

    Raises:
        StepError: A component failed.
    """
    for name in setup.layout.parts:
        setup.system.components[name].end_initialization()
        setup.coupling.now.update(setup.coupling.read(name))
    tables = {name: function_table(component) for name, component in setup.system.components.items()}
    plan = make_plan(
        setup.system,
        setup.coupling,
        setup.layout,
        tables,
        watched=setup.limits.watched,
        following=setup.following,
        recorded=real_names(setup.system, setup.names),
        sequential=setup.algorithm.mode(0.0).kind != JACOBI,
    )
    m = memory(plan)
    if (words := loop_words()) is not None:
        m = m._replace(calls=words[0], clock=words[1])
    m.now[:] = m.ahead[:] = m.past[:] = m.older[:] = [setup.coupling.now[name] for name in setup.layout.signals]
    rows = int(setup.recorded.sum()) + 1
    return Running(plan, m, blank_tape(setup.layout, real_names(setup.system, setup.names), rows), tables)


# ---- Errors for a loop that ended early -----------------------------------------------------------------------------

#: Size of an exchanged signal in its SI unit from which a discarded step is a divergence of the coupling.
_FAR = 1e7

#: Descriptions of the loop's calls, by their numbers.
_CALLS = (
    "set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state",
    "give directional derivatives",
)  # fmt: skip

#: Schemes that may be stable if a scheme diverged.
_OTHERS = {"jacobi": ", gauss-seidel, or implicit", "gauss-seidel": ", or implicit"}


def failure(setup: Setup, running: Running, end: int, time: float) -> BaseException:
    """Return the error for the loop's ending; if a component raised an exception, that one.

    Args:
        setup: Setup of the run.
        running: State in which the loop left the run.
        end: Reason why it ended, a constant of cosim.engine.plan.
        time: Time at which it ended [s].
    """
    if end == DIVERGED:
        return _divergence(setup, running, time)
    status, part, call, _ = (int(number) for number in running.memory.failure)
    name, what = setup.layout.parts[part], _CALLS[call]
    if (raised := _raised(running.tables[name])) is not None:
        return raised
    component = setup.system.components[name]
    if (status, call) == (DISCARD, STEP) and (far := _far_signal(setup, running)):
        return _diverged(setup, *far, time)
    if isinstance(component, Native):
        return component.refused(what, status, time, _inputs(setup, running, part))
    return StepError(f"component {name!r} ({component.source}) failed to {what} at {time:g} s")


def ended_or_failed(setup: Setup, running: Running, end: int, time: float) -> str:
    """Return the name of the component that ended the simulation; for arguments see `failure`.

    Raises:
        StepError: The loop ended for another reason, or before the settling time.
    """
    error = failure(setup, running, end, time)
    if not isinstance(error, TerminatedError) or time <= setup.scenario.settling:
        raise error
    return setup.layout.parts[int(running.memory.failure[1])]


def terminated_at(setup: Setup, running: Running, time: float, step: float) -> str:
    """Return the name of the component that ended the simulation, if the last step was discarded; else an empty string.

    An adaptive run restores its components to `time` [s] before it gives up, which clears their status. Therefore the
    smallest `step` [s] is tried once more.
    """
    status, part, call, _ = (int(number) for number in running.memory.failure)
    if (status, call) != (DISCARD, STEP) or time <= setup.scenario.settling:
        return ""
    name = setup.layout.parts[part]
    try:
        setup.system.components[name].step(time, step)
    except TerminatedError:
        return name
    except StepError:
        return ""
    return ""


def _divergence(setup: Setup, running: Running, time: float) -> DivergedError:
    signal = int(running.memory.failure[1])
    return _diverged(setup, setup.layout.signals[signal], float(running.memory.ahead[signal]), time)


def _diverged(setup: Setup, signal: str, value: float, time: float) -> DivergedError:
    return DivergedError(
        f"the coupling diverged: {signal} is {value:g} after {time:g} s; "
        f"use a smaller coupling step{_OTHERS.get(setup.algorithm.name, '')} (docs/explanation/coupling.md)"
    )


def _far_signal(setup: Setup, running: Running) -> tuple[str, float] | None:
    """Return the largest exchanged signal before the step and its value; None if all are of a sensible size.

    An FMU whose forces grow with powers of its motion (the springs at the ports of a vehicle) can refuse a step of a
    diverging coupling before any signal is as large as the loop's own limit.
    """
    values = dict(zip(setup.layout.signals, running.memory.now.tolist(), strict=True))
    worst = max(values, key=lambda name: abs(values[name]), default=None)
    return None if worst is None or abs(values[worst]) < _FAR else (worst, values[worst])


def _raised(table: FunctionTable) -> BaseException | None:
    """Return the exception that a Python component raised in a callback."""
    keep = table.keep
    return keep[0].error if isinstance(keep, tuple) and isinstance(keep[0], Callbacks) else None


def _inputs(setup: Setup, running: Running, part: int) -> dict[str, float]:
    """Return the last values given to a part, in its own units."""
    rows = running.plan.parts.inputs
    feeds = setup.coupling.feeds[setup.layout.parts[part]]
    moving = [feed.target for feed in feeds if feed.terms or feed.drive is not None]
    return dict(zip(moving, running.memory.value[rows[part] : rows[part + 1]].tolist(), strict=True))
