"""Why the loop gave up: a component that refused a call, or a coupling that diverged."""

from __future__ import annotations

from cosim.engine.plan import DISCARD, DIVERGED, STEP
from cosim.functions import Callbacks, FunctionTable, Native
from cosim.session.running import Running
from cosim.session.setup import Setup
from eightpost.errors import DivergedError, StepError, TerminatedError

#: By the loop's numbers of calls.
_CALLS = ("set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state")

#: What else may be stable where a scheme is not.
_OTHERS = {"jacobi": ", gauss-seidel, or implicit", "gauss-seidel": ", or implicit"}


def failure(setup: Setup, running: Running, end: int, time: float) -> BaseException:
    """Return the error for a loop that ended so: a component's own where it raised one.

    Args:
        setup: What was run.
        running: As the loop left it.
        end: Why it ended, of cosim.engine.plan.
        time: At which it did [s].
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
    """Return the name of the component that ended the simulation; arguments as of `failure`.

    Raises:
        StepError: The loop ended for another reason, or before response measures begin.
    """
    error = failure(setup, running, end, time)
    if not isinstance(error, TerminatedError) or time <= setup.scenario.settling:
        raise error
    return setup.layout.parts[int(running.memory.failure[1])]


def terminated_at(setup: Setup, running: Running, time: float, step: float) -> str:
    """Return the name of the component that wants no more steps, of which the loop saw that it discards them all.

    An adaptive run takes its components back to `time` [s] before it gives up, and what they said of their end is then
    gone: the smallest `step` [s] is asked for once more.
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
        f"take a smaller coupling step{_OTHERS.get(setup.algorithm.name, '')} (docs/coupling.md)"
    )


def _raised(table: FunctionTable) -> BaseException | None:
    """What a Python component raised in a callback."""
    keep = table.keep
    return keep[0].error if isinstance(keep, tuple) and isinstance(keep[0], Callbacks) else None


def _inputs(setup: Setup, running: Running, part: int) -> dict[str, float]:
    """The values that a part was given last, in its own units."""
    rows = running.plan.parts.inputs
    feeds = setup.coupling.feeds[setup.layout.parts[part]]
    moving = [feed.target for feed in feeds if feed.terms or feed.drive is not None]
    return dict(zip(moving, running.memory.value[rows[part] : rows[part + 1]].tolist(), strict=True))
