"""State of a run while its components step: the loop's arrays, the recording, and the function addresses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from cosim.engine.compiled import Bind
from cosim.engine.march import Tape
from cosim.engine.plan import Memory, Mode, Plan, memory
from cosim.equilibrium import Equilibrium, solve_equilibrium
from cosim.functions import FunctionTable, free_states, function_table
from cosim.planning import make_plan
from cosim.recorder import blank_tape, real_names
from cosim.session.setup import Setup
from cosim.watch import loop_words


@dataclass(frozen=True)
class Running:
    """Components that have begun, in the form that the loop uses.

    Args:
        plan: Arrays that do not change.
        memory: Arrays that the run changes.
        tape: Recorded values.
        tables: Functions by component.
    """

    plan: Plan
    memory: Memory
    tape: Tape
    tables: Mapping[str, FunctionTable]

    def stop(self) -> None:
        """Make the loop stop before its next step."""
        self.memory.stop.fill(1)

    def free_states(self, setup: Setup) -> None:
        """Free the states that the loop saved."""
        free_states([self.tables[name] for name in setup.layout.parts], self.memory.states)


@dataclass(frozen=True)
class Marching:
    """The loop and the parameters of its calls.

    Args:
        bind: Function that takes the loop's named tuples and returns the loop.
        chunk: Number of steps per call.
        mode: Settings of the scheme for a step.
        progress: Callback that receives the completed share, 0 to 1, after each call of the loop.
    """

    bind: Bind
    chunk: int
    mode: Mode
    progress: Callable[[float], None]


@dataclass(frozen=True)
class Ending:
    """Ending of the loop.

    Args:
        why: Reason: DONE, STOPPED or STUCK of cosim.engine.plan.
        time: Time that was reached [s].
        least: Smallest step [s].
        largest: Largest step [s].
        began: Value of the clock (time.perf_counter) before the first step [s].
        ended_by: Component that ended the simulation before the stop time; empty if none did.
    """

    why: int
    time: float
    least: float
    largest: float
    began: float
    ended_by: str = ""


def begin(setup: Setup) -> Equilibrium:
    """Begin every component, find the equilibrium start and leave initialization.

    Raises:
        StepError: A component failed.
    """
    coupling, components = setup.coupling, setup.system.components
    setup.discrete.begin()
    for name, component in components.items():
        component.begin(0.0, setup.scenario.stop, setup.system.start_values(name))
    equilibrium = _equilibrium_start(setup)
    for name in setup.layout.parts:
        components[name].end_initialization()
        coupling.now.update(coupling.read(name))
    return equilibrium


def _equilibrium_start(setup: Setup) -> Equilibrium:
    """Find the state in which inputs and outputs agree; discrete values, which may jump, are exchanged in between."""
    solutions: list[Equilibrium] = []
    agrees = setup.discrete.settle(lambda: solutions.append(solve_equilibrium(setup.coupling, setup.layout.parts)))
    return replace(solutions[-1], converged=solutions[-1].converged and agrees)


def prepare(setup: Setup) -> Running:
    """Return the loop's arrays for components that are at the equilibrium start."""
    tables = {name: function_table(component) for name, component in setup.system.components.items()}
    plan = make_plan(
        setup.system,
        setup.coupling,
        setup.layout,
        tables,
        watched=setup.limits.watched,
        following=setup.following,
    )
    m = memory(plan)
    if (words := loop_words()) is not None:
        words.fill(0)
        m = m._replace(failure=words)
    m.now[:] = m.ahead[:] = m.past[:] = m.older[:] = [setup.coupling.now[name] for name in setup.layout.signals]
    rows = int(setup.recorded.sum()) + 1
    return Running(plan, m, blank_tape(setup.layout, real_names(setup.system, setup.names), rows), tables)
