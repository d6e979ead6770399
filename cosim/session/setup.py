"""Setup of a run: components in their order, checks of their abilities and of the scenario, limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from cosim.components.component import Capabilities
from cosim.session.discrete import DiscreteExchange
from cosim.session.planning import Layout, Limit, lay_out
from cosim.session.recorder import Flags, real_names, recorded_names, recorded_steps
from cosim.session.step_times import ROUNDING, Times, coupling_times
from cosim.systems.algorithm import HELD_INPUTS, Accuracy, Adaptive, Algorithm
from cosim.systems.coupling import Coupling
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.errors import WiringError

# ---- Limits checked at every step -----------------------------------------------------------------------------------


#: Settings beyond the measured ones that count [intervals between them]: any, and far.
_BEYOND, _FAR = 1e-9, 1.0


class _Shares(TypedDict):
    """Shares of time beyond limits, by the names of the fields of a result."""

    share_beyond_fit: dict[str, float]
    share_beyond_settings: dict[str, float]
    share_far_beyond_settings: dict[str, float]
    share_untested_settings: dict[str, float]
    share_tire_off: dict[str, float | None]


class _LimitWatch:
    """Signals that are watched at every step after settling, and the share of time beyond their limits.

    The names are those of docs/reference/ports.md: `beyond_fit`, `beyond_settings`, `untested_settings`, and outputs
    ending in `tire_force`.
    """

    def __init__(self, system: System) -> None:
        # Each shock of an assembly has these variables.
        self._fitted = _limits(system, "beyond_fit", 0.5)
        self._beyond = _limits(system, "beyond_settings", _BEYOND)
        self._far = _limits(system, "beyond_settings", _FAR)
        self._untested = _limits(system, "untested_settings", 0.5)
        self._tires = {
            Limit(f"{name}.{v.name}", -1.0, 0.0): _static_load(system, name, v.name) != 0.0
            for name, component in system.components.items()
            for v in component.variables.values()
            if v.causality == "output" and v.name.endswith("tire_force")
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables to read after every step."""
        return tuple(dict.fromkeys(limit.signal for limit in self.watched))

    @property
    def watched(self) -> tuple[Limit, ...]:
        """The limits, in the order of the times."""
        return (*self._fitted, *self._beyond, *self._far, *self._untested, *self._tires)

    def shares(self, times: Sequence[float]) -> _Shares:
        """Return the shares of time beyond the limits.

        Args:
            times: Time beyond each limit, in the order of `watched`, followed by the total time [s].
        """
        share = {limit: _share(time, times[-1]) for limit, time in zip(self.watched, times, strict=False)}

        def of_shocks(limits: Sequence[Limit]) -> dict[str, float]:
            return {limit.signal.rpartition(".")[0]: share[limit] for limit in limits}

        return {
            "share_beyond_fit": of_shocks(self._fitted),
            "share_beyond_settings": of_shocks(self._beyond),
            "share_far_beyond_settings": of_shocks(self._far),
            "share_untested_settings": of_shocks(self._untested),
            "share_tire_off": {
                tire.signal: share[tire] if is_known else None for tire, is_known in self._tires.items()
            },
        }


def _limits(system: System, variable: str, limit: float) -> tuple[Limit, ...]:
    """Return an upper limit of each variable of this name, in components and in the parts of assemblies."""
    return tuple(
        Limit(f"{name}.{known}", 1.0, limit)
        for name, component in system.components.items()
        for known in component.variables
        if known.rpartition(".")[2] == variable
    )


def _share(time: float, total: float) -> float:
    return time / total if total else 0.0


def _static_load(system: System, component: str, output: str) -> float:
    parameter = output.replace("tire_force", "static_tire_force")
    known = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, known.start if known else 0.0)
    return float(value or 0.0)


# ---- Checks, before a run, that the components have the abilities that an algorithm needs ---------------------------


def _check_variable_step(system: System, algorithm: Algorithm, times: Times, step: float) -> None:
    """Refuse steps of several sizes, with `times` (K+1,) [s], for a component that accepts only one size."""
    if not isinstance(algorithm, Adaptive) and abs(times[-1] - times[-2] - step) <= 1e-9 * step:
        return
    for name, component in system.components.items():
        if not component.capabilities.variable_step:
            raise WiringError(
                f"{name} accepts steps of one size only, and the stop time is not a whole number of coupling steps of "
                f"{step} s; change one of them"
                if not isinstance(algorithm, Adaptive)
                else f"{name} accepts steps of one size only: adaptive cannot step it"
            )


def _check_repeats(system: System, algorithm: Algorithm) -> None:
    """Refuse an algorithm that repeats steps for a component that cannot save its state."""
    if not algorithm.repeats:
        return
    for name, component in system.components.items():
        if not component.capabilities.state:
            raise WiringError(
                f"{algorithm.name} repeats steps, and {name} ({component.source}) cannot save and restore its state "
                "(canGetAndSetFMUstate); use gauss-seidel"
            )


# ---- Setup of a run -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """A run before it begins."""

    system: System  #: Components and connections.
    scenario: Scenario  #: Drive, duration and recording.
    algorithm: Algorithm  #: Algorithm of the run.
    step: float  #: Coupling step [s]; for an adaptive run the first step to try.
    names: tuple[str, ...]  #: Recorded variables, as `component.variable`.
    limits: _LimitWatch  #: Signals that are watched at every step.
    coupling: Coupling  #: Sources of every input.
    layout: Layout  #: Numbering of everything in the loop's arrays.
    times: Times  #: Communication points (K+1,) [s]; for an adaptive run those that may be recorded.
    recorded: Flags  #: 1 for each communication point that is recorded (K+1,).
    #: Exchange of Integer, Boolean and enumeration variables, which the loop does not handle.
    discrete: DiscreteExchange

    @classmethod
    def of(cls, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> Setup:
        """Return the setup with everything resolved and checked; `step` in s.

        Raises:
            WiringError: System, scenario and algorithm do not fit together.
            InputError: The coupling step does not fit.
        """
        names = recorded_names(system, scenario)
        limits = _LimitWatch(system)
        coupling = Coupling(system, scenario, every_step=limits.names, recorded=real_names(system, names))
        layout = lay_out(coupling, algorithm.order(coupling))
        own = scenario.record_step if isinstance(algorithm, Adaptive) else None
        grid = step if own is None else own
        times = coupling_times(scenario.stop, grid)
        recorded = recorded_steps(scenario, grid, times.size - 1)
        _check_variable_step(system, algorithm, times, step)
        _check_repeats(system, algorithm)
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
