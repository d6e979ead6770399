"""Setup of a run: everything resolved and checked before the first component begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.algorithm import HELD_INPUTS, Accuracy, Adaptive, Algorithm
from cosim.component import Capabilities
from cosim.coupling import Coupling
from cosim.discrete import DiscreteExchange
from cosim.limits import LimitWatch
from cosim.planning import Layout, lay_out
from cosim.recorder import Flags, real_names, recorded_names, recorded_steps
from cosim.scenario import Scenario
from cosim.session.checks import check_repeats, check_variable_step
from cosim.session.times import ROUNDING, Times, coupling_times
from cosim.system import System


@dataclass(frozen=True)
class Setup:
    """A run before it begins.

    Args:
        system: Components and connections.
        scenario: Drive, duration and recording.
        algorithm: Algorithm of the run.
        step: Coupling step [s]; for an adaptive run the first step to try.
        names: Recorded variables, as `component.variable`.
        limits: Signals that are watched at every step.
        coupling: Sources of every input.
        layout: Numbering of everything in the loop's arrays.
        times: Communication points (K+1,) [s]; for an adaptive run those that may be recorded.
        recorded: 1 for each communication point that is recorded (K+1,).
        discrete: Exchange of Integer, Boolean and enumeration variables, which the loop does not handle.
    """

    system: System
    scenario: Scenario
    algorithm: Algorithm
    step: float
    names: tuple[str, ...]
    limits: LimitWatch
    coupling: Coupling
    layout: Layout
    times: Times
    recorded: Flags
    discrete: DiscreteExchange

    @classmethod
    def of(cls, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> Setup:
        """Return the setup with everything resolved and checked; `step` in s.

        Raises:
            WiringError: System, scenario and algorithm do not fit together.
            InputError: The coupling step does not fit.
        """
        names = recorded_names(system, scenario)
        limits = LimitWatch(system)
        coupling = Coupling(system, scenario, every_step=limits.names, recorded=real_names(system, names))
        layout = lay_out(coupling, algorithm.order(coupling))
        own = scenario.record_step if isinstance(algorithm, Adaptive) else None
        grid = step if own is None else own
        times = coupling_times(scenario.stop, grid)
        recorded = recorded_steps(scenario, grid, times.size - 1)
        check_variable_step(system, algorithm, times, step)
        check_repeats(system, algorithm)
        discrete = DiscreteExchange.of(system, scenario, names)
        return cls(system, scenario, algorithm, step, names, limits, coupling, layout, times, recorded, discrete)

    def accuracy_of(self, target: str) -> Accuracy:
        """Return the accuracy of the values given to an input `component.variable`.

        A component that holds its inputs lowers the order of its own inputs only.
        """
        component = self.system.components[target.partition(".")[0]]
        return self.algorithm.accuracy if component.capabilities.interpolates_inputs else HELD_INPUTS

    @property
    def following(self) -> frozenset[str]:
        """Components that are stepped from each of the drive's points to the next: driven ones that accept any step.

        The set is empty if a step is no longer than the drive's intervals and all driven components are coupled: a
        straight line over a step with the drive's mean is then accurate to the order of the coupling.
        """
        feeds = self.coupling.feeds
        driven = {name for name, into in feeds.items() if any(feed.drive is not None for feed in into)}
        if self._is_finely_stepped and all(any(feed.terms for feed in feeds[name]) for name in driven):
            return frozenset()
        return frozenset(name for name in driven if _can_follow(self.system.components[name].capabilities))

    @property
    def _is_finely_stepped(self) -> bool:
        drive = self.scenario.drive
        intervals = np.diff(drive.series.time) if drive is not None else np.zeros(0)
        return self.step <= float(np.min(intervals, initial=np.inf)) * (1.0 + ROUNDING)


def _can_follow(capabilities: Capabilities) -> bool:
    """Return whether a component gains accuracy by being stepped from point to point of the drive.

    One that holds its inputs does not: its error would depend on the drive's interval and not on the step, so that runs
    at two steps would agree on a wrong result.
    """
    return capabilities.variable_step and capabilities.interpolates_inputs
