"""Errors for a loop that ended early: a component that refused a call, or a coupling that diverged."""

from __future__ import annotations

from cosim.engine.plan import DISCARD, DIVERGED, STEP
from cosim.functions import Callbacks, FunctionTable, Native
from cosim.session.running import Running
from cosim.session.setup import Setup
from eightpost.errors import DivergedError, StepError, TerminatedError

#: Descriptions of the loop's calls, by their numbers.
_CALLS = ("set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state")

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
    return DivergedError(
        f"the coupling diverged: {setup.layout.signals[signal]} is {running.memory.ahead[signal]:g} after {time:g} s; "
        f"use a smaller coupling step{_OTHERS.get(setup.algorithm.name, '')} (docs/coupling.md)"
    )


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
