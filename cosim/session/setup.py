"""Setup of a run: everything resolved, numbered and checked before it begins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import DISCRETE, Component, convert_between
from cosim.engine.plan import Mode
from cosim.systems.algorithm import HELD_INPUTS, Accuracy, Adaptive, Algorithm
from cosim.systems.coupling import Coupling, Scenario, targets_of
from cosim.systems.system import System
from eightpost.array_types import Integers
from eightpost.errors import InputError, WiringError
from eightpost.signals import Drivefile

# ==== Times at which steps end [s]; times that differ by rounding only are treated as equal ==========================

Times = NDArray[np.float64]

#: Largest number of coupling steps of a run: their times take 0.8 GB.
MOST_STEPS = 1e8

#: Times that differ by less than this share of the run are treated as equal.
ROUNDING = 1e-9


def coupling_times(stop: float, step: float) -> Times:
    """Return the communication points (K+1,) [s]: whole multiples of the step, which do not drift, and the stop time.

    Raises:
        InputError: The step is not positive, longer than the run, or so short that the steps do not fit into memory.
    """
    if not (np.isfinite(step) and 0.0 < step <= stop):
        raise InputError(f"the coupling step must be positive and at most the run ({stop} s), not {step!r} s")
    if stop / step > MOST_STEPS:
        raise InputError(
            f"a run of {stop:g} s in steps of {step:g} s has {stop / step:.3g} steps, at most {MOST_STEPS:g}; use "
            "larger steps or a shorter run"
        )
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: Times = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def step_sizes(times: Times, step: float) -> Times:
    """Return the steps between communication points (K,) [s]: `step` to the bit, except a shorter last one.

    Differences of times contain rounding errors that change from step to step. Components that cache values for a step
    size, such as exponentials, would compute them again in every step.
    """
    steps: Times = np.full(times.size - 1, step)
    rest = times[-1] - times[-2]
    if abs(rest - step) > ROUNDING * step:
        steps[-1] = rest
    return steps


#: Number of steps after which the sum of the steps is a communication point to the bit.
_SUMMED = 32


def summed_steps(times: Times, step: float) -> tuple[Times, Times]:
    """Return communication points (K+1,) [s] and the steps between them (K,) [s]: a point is the sum of the steps.

    An FMU may compare the point that it is given with the sum of its steps, to the bit. The steps are `step` to the
    bit except every 32nd, which leads to a point of `times` again, and the last one, which ends at the stop time.
    """
    points, steps, count = times.copy(), np.full(times.size - 1, step), times.size - 1
    for k in range(1, _SUMMED):
        points[k::_SUMMED] = points[k - 1 : count : _SUMMED] + step
    points[-1] = times[-1]
    for last in (slice(_SUMMED, None, _SUMMED), slice(count, None)):
        steps[np.arange(times.size)[last] - 1] = points[last] - points[np.arange(times.size)[last] - 1]
    return points, steps


def joined(times: Times, others: Times) -> Times:
    """Return all times in order; of times that differ by rounding only, those of the first array, to the bit.

    Args:
        times: Times in order (T,) [s], from the run's start to its end.
        others: Times within them (N,) [s].
    """
    place = np.searchsorted(times, others)
    near = np.minimum(np.abs(others - times[np.maximum(place - 1, 0)]), np.abs(others - times[place]))
    new = others[near > ROUNDING * times[-1]]
    return np.union1d(times, new) if new.size else times


def merged(times: Times) -> Times:
    """Return times (T,) [s] sorted, without repetitions that differ by rounding only."""
    times = np.sort(times)
    distinct: Times = times[np.append(np.diff(times) > ROUNDING * times[-1], True)]
    return distinct


def among(times: Times, chosen: Times, stop: float) -> NDArray[np.bool_]:
    """Return whether each time (T,) [s] equals one of the chosen ones (R,) in order [s], except for rounding."""
    place = np.searchsorted(chosen, times)
    after = np.abs(times - chosen[np.clip(place, 0, chosen.size - 1)])
    before = np.abs(times - chosen[np.clip(place - 1, 0, chosen.size - 1)])
    equal: NDArray[np.bool_] = np.minimum(after, before) < ROUNDING * stop
    return equal


def _recorded_steps(scenario: Scenario, step: float, count: int) -> Integers:
    """Return 1 for each communication point from 0 to `count` that is recorded: first, last, and every n-th."""
    every, stride = scenario.record_step, 1
    if every is not None:
        stride = round(every / step)
        if stride < 1 or abs(stride * step - every) > 1e-9 * every:
            raise InputError(f"record_step {every} s is not a whole number of coupling steps of {step} s; change one")
    flags = np.zeros(count + 1, np.int64)
    flags[::stride] = 1
    flags[-1] = 1
    return flags


# ==== Recorded variables =============================================================================================

_NUMBERS = ("Real", *DISCRETE)


def recorded_names(system: System, scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the recorded variables: those of the scenario, else every output that is a number.

    Raises:
        WiringError: A name is unknown or its values are not numbers.
    """
    names = tuple(dict.fromkeys(scenario.record)) or tuple(
        name for name, v in system.variables() if v.causality == "output" and v.type in _NUMBERS
    )
    for name in names:
        if system.output(name).type not in _NUMBERS:
            raise WiringError(f"{name} is a {system.output(name).type} and cannot be recorded; record numbers")
    return names


# ==== Integer, Boolean and enumeration variables in coupling, drive and recording ====================================


class _Link(NamedTuple):
    """Output that sets an input: `input = factor * output + offset`, rounded if the input is not Real."""

    source: str
    kind: str
    factor: float
    offset: float


@dataclass
class _DiscreteExchange:
    """Discrete variables of a system, and their current values."""

    components: Mapping[str, Component]  #: All components by name.
    links: Mapping[str, _Link]  #: Link of each connected input, named `component.variable`.
    driven: Mapping[str, tuple[int, str]]  #: Channel of the drive and type of each driven discrete input.
    names: tuple[str, ...]  #: Discrete variables to record.
    drive: Drivefile | None = None  #: Drive of the scenario.
    drive_start: float = 0.0  #: Time in the drive at which the run starts [s].
    rows: list[list[float]] = field(default_factory=list)
    _set: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, scenario: Scenario, names: Iterable[str]) -> _DiscreteExchange:
        """Collect the discrete variables that a system couples, drives and records."""
        driven = {
            target: (index, system.input(target).type)
            for target, index in targets_of(system, scenario).items()
            if system.input(target).type in DISCRETE
        }
        recorded = tuple(name for name in names if system.output(name).type in DISCRETE)
        links = {}
        for connection in system.discrete_connections:
            source, target = system.output(connection.source), system.input(connection.target)
            unit = convert_between(source.unit, target.unit, str(connection))
            factor, offset = connection.gain * unit.factor, connection.gain * unit.offset + connection.offset
            links[connection.target] = _Link(connection.source, target.type, factor, offset)
        return cls(system.components, links, driven, recorded, scenario.drive, scenario.drive_start)

    @property
    def is_coupled(self) -> bool:
        """Whether inputs must be set before each step."""
        return bool(self.links or self.driven)

    @property
    def is_needed(self) -> bool:
        """Whether there is anything to do between steps."""
        return self.is_coupled or bool(self.names)

    def begin(self) -> None:
        """Forget the last run."""
        self.rows.clear()
        self._set.clear()

    def exchange(self, time: float) -> bool:
        """Set every input whose source has changed at `time` [s]; return whether there was one."""
        if not self.is_coupled:
            return False
        outputs = self._read(link.source for link in self.links.values())
        current = {
            target: _as_type(kind, factor * outputs[source] + offset)
            for target, (source, kind, factor, offset) in self.links.items()
        }
        current |= self._driven_at(time)
        changed = {target: value for target, value in current.items() if self._set.get(target) != value}
        for name, inputs in _by_component(changed).items():
            self.components[name].set(inputs, [changed[f"{name}.{variable}"] for variable in inputs])
        self._set |= changed
        return bool(changed)

    def record(self, rows: int) -> None:
        """Record a row of discrete values if the loop has recorded more rows (`rows`) than this object."""
        if self.names and rows > len(self.rows):
            values = self._read(self.names)
            self.rows.append([values[name] for name in self.names])

    def _read(self, names: Iterable[str]) -> dict[str, float]:
        return {
            f"{name}.{variable}": value
            for name, variables in _by_component(dict.fromkeys(names)).items()
            for variable, value in zip(variables, self.components[name].get(variables), strict=True)
        }

    def _driven_at(self, time: float) -> dict[str, float]:
        """Return the inputs that the drive sets, at its latest sample; discrete values are not interpolated."""
        if self.drive is None or not self.driven:
            return {}
        series = self.drive.series
        at = time + self.drive_start
        place = max(0, int(np.searchsorted(series.time, at + 1e-9 * max(abs(at), 1e-3), "right")) - 1)
        return {target: _as_type(kind, float(series.values[k, place])) for target, (k, kind) in self.driven.items()}


def _as_type(kind: str, value: float) -> float:
    """Return a number converted to a variable's type: a Boolean is true unless 0, integers are rounded."""
    if kind == "Boolean":
        return float(value != 0.0)
    return value if kind == "Real" else float(round(value))


def _by_component(names: Iterable[str]) -> dict[str, list[str]]:
    variables: dict[str, list[str]] = {}
    for name in names:
        component, _, variable = name.partition(".")
        variables.setdefault(component, []).append(variable)
    return variables


# ==== Limits checked at every step ===================================================================================

#: Settings beyond the measured ones that count [intervals between them]: any, and far.
_BEYOND, _FAR = 1e-9, 1.0


class Limit(NamedTuple):
    """Limit of a signal: it is exceeded where `sign` (1 or -1) times the signal is above `limit`."""

    signal: str
    sign: float
    limit: float


class _LimitWatch:
    """Signals that are watched at every step after settling, and the share of time beyond their limits.

    The names are those of docs/reference/ports.md: `beyond_fit`, `beyond_settings`, `untested_settings`, and outputs
    ending in `tire_force`. Each shock of an assembly has these variables.
    """

    def __init__(self, system: System) -> None:
        self._of_shocks = {  # by the field of a result
            "share_beyond_fit": _limits(system, "beyond_fit", 0.5),
            "share_beyond_settings": _limits(system, "beyond_settings", _BEYOND),
            "share_far_beyond_settings": _limits(system, "beyond_settings", _FAR),
            "share_untested_settings": _limits(system, "untested_settings", 0.5),
        }
        self._tires = {Limit(name, -1.0, 0.0): _static_load(system, name) != 0.0 for name in system.tire_forces}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables to read after every step."""
        return tuple(dict.fromkeys(limit.signal for limit in self.watched))

    @property
    def watched(self) -> tuple[Limit, ...]:
        """The limits, in the order of the times."""
        return (*chain.from_iterable(self._of_shocks.values()), *self._tires)

    def shares(self, times: Sequence[float]) -> dict[str, Any]:
        """Return the shares of time beyond the limits, by the fields of a result."""
        total = times[-1]
        share = {limit: time / total if total else 0.0 for limit, time in zip(self.watched, times, strict=False)}
        shocks = {
            field: {limit.signal.rpartition(".")[0]: share[limit] for limit in limits}
            for field, limits in self._of_shocks.items()
        }
        tires = {tire.signal: share[tire] if has_load else None for tire, has_load in self._tires.items()}
        return {**shocks, "share_tire_off": tires}


def _limits(system: System, variable: str, limit: float) -> tuple[Limit, ...]:
    """Return an upper limit of each variable of this name, in components and in the parts of assemblies."""
    return tuple(Limit(name, 1.0, limit) for name, _ in system.variables() if name.rpartition(".")[2] == variable)


def _static_load(system: System, tire_force: str) -> float:
    component, _, output = tire_force.partition(".")
    parameter = output.replace("tire_force", "static_tire_force")
    variable = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, variable.start if variable else 0.0)
    return float(value or 0.0)


# ==== Numbering ======================================================================================================


@dataclass(frozen=True)
class Layout:
    """Numbering of everything in the loop's arrays: parts, signals and extras by name, terms by (source, target)."""

    #: Names of the components in the order of stepping, with the components of each connected group together.
    parts: tuple[str, ...]
    #: Variables read after every step, as `component.variable`; those of one part are adjacent.
    signals: tuple[str, ...]
    extras: tuple[str, ...]  #: Variables read at recorded points only, in the same form.
    terms: Mapping[tuple[str, str], int]  #: Number of each connection's term, by source and target.
    #: Sizes of the levels of each group of connected parts; parts of a level take nothing from each other.
    levels: tuple[tuple[int, ...], ...]

    @property
    def groups(self) -> tuple[int, ...]:
        """Number of parts of each group."""
        return tuple(sum(counts) for counts in self.levels)


def _lay_out(coupling: Coupling, order: Sequence[str]) -> Layout:
    """Return the numbering of everything; `order` is the order of stepping."""
    takes = {name: {term.part for feed in coupling.feeds[name] for term in feed.terms} for name in order}
    groups = list(connected(order, takes))
    parts = tuple(name for group in groups for name in group)
    feeds = [(name, feed) for name in parts for feed in coupling.feeds[name]]
    pairs = [(term.source, f"{name}.{feed.target}") for name, feed in feeds for term in feed.terms]
    return Layout(
        parts=parts,
        signals=tuple(f"{name}.{v}" for name in parts for v in coupling.outputs[name]),
        extras=tuple(f"{name}.{v}" for name in parts for v in coupling.recorded[name]),
        terms={pair: k for k, pair in enumerate(pairs)},
        levels=tuple(_levels(group, takes) for group in groups),
    )


def connected(order: Sequence[str], links: Mapping[str, Iterable[str]]) -> Iterator[list[str]]:
    """Yield groups of parts that are connected, directly or through others, each in the given order.

    Args:
        order: Names of all parts.
        links: Parts that each part is linked with; either end of a link may name it.
    """
    neighbours: dict[str, set[str]] = {name: set() for name in order}
    for name in order:
        for other in links[name]:
            neighbours[name].add(other)
            neighbours[other].add(name)
    placed = set[str]()
    for first in order:
        group, waiting = set[str](), [first]
        while waiting:
            if (name := waiting.pop()) not in placed:
                placed.add(name)
                group.add(name)
                waiting += neighbours[name]
        if group:
            yield [name for name in order if name in group]


def _levels(group: Sequence[str], takes: Mapping[str, set[str]]) -> tuple[int, ...]:
    """Return the sizes of consecutive levels of parts, in which no part takes anything from another."""
    levels: list[set[str]] = [set()]
    for name in group:
        if takes[name] & levels[-1]:
            levels.append(set())
        levels[-1].add(name)
    return tuple(map(len, levels))


# ==== Setup ==========================================================================================================


@dataclass(frozen=True)
class RunSetup:
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
    recorded: Integers  #: 1 for each communication point that is recorded (K+1,).
    #: Exchange of Integer, Boolean and enumeration variables, which the loop does not handle.
    discrete: _DiscreteExchange

    @classmethod
    def of(cls, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> RunSetup:
        """Return the setup with everything resolved and checked; `step` in s.

        Raises:
            WiringError: System, scenario and algorithm do not fit together.
            InputError: The coupling step does not fit.
        """
        names = recorded_names(system, scenario)
        reals = tuple(name for name in names if system.output(name).type == "Real")
        limits = _LimitWatch(system)
        coupling = Coupling(system, scenario, every_step=limits.names, recorded=reals)
        layout = _lay_out(coupling, algorithm.order(coupling))
        grid = scenario.record_step or step if isinstance(algorithm, Adaptive) else step
        times = coupling_times(scenario.stop, grid)
        recorded = _recorded_steps(scenario, grid, times.size - 1)
        _check_abilities(system, algorithm, times, step)
        discrete = _DiscreteExchange.of(system, scenario, names)
        return cls(system, scenario, algorithm, step, names, limits, coupling, layout, times, recorded, discrete)

    @cached_property
    def reals(self) -> tuple[str, ...]:
        """Names of the variables that the loop records; discrete variables are recorded outside the loop."""
        return tuple(name for name in self.names if self.system.output(name).type == "Real")

    @property
    def mode(self) -> Mode:
        """Settings of the scheme for a step of the loop."""
        return self.algorithm.mode(self.scenario.settling)

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
        drive = self.scenario.drive
        intervals = np.diff(drive.series.time) if drive is not None else np.zeros(0)
        is_fine = self.step <= float(np.min(intervals, initial=np.inf)) * (1.0 + ROUNDING)
        if is_fine and all(any(feed.terms for feed in feeds[name]) for name in driven):
            return frozenset()
        # The error of a component that holds its inputs would depend on the drive's interval and not on the step, so
        # that runs at two steps would agree on a wrong result.
        can = {name: self.system.components[name].capabilities for name in driven}
        return frozenset(name for name, c in can.items() if c.variable_step and c.interpolates_inputs)


def _check_abilities(system: System, algorithm: Algorithm, times: Times, step: float) -> None:
    """Refuse repeated steps, and steps of several sizes, `times` (K+1,) [s], if a component cannot make them."""
    if adaptive := isinstance(algorithm, Adaptive):
        why = ": adaptive cannot step it"
    else:
        why = f", and the stop time is not a whole number of coupling steps of {step} s; change one of them"
    is_even = not adaptive and abs(times[-1] - times[-2] - step) <= 1e-9 * step
    for name, component in system.components.items():
        if not component.capabilities.variable_step and not is_even:
            raise WiringError(f"{name} accepts steps of one size only{why}")
    for name, component in system.components.items():
        if algorithm.repeats and not component.capabilities.state:
            raise WiringError(
                f"{algorithm.name} repeats steps, and {name} ({component.source}) cannot save and restore its state "
                "(canGetAndSetFMUstate); use gauss-seidel"
            )
