"""Setup of a run: times, checks of the scenario, discrete variables, recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.algorithm import HELD_INPUTS, Accuracy, Adaptive, Algorithm
from cosim.component import DISCRETE, Capabilities, Component, Variable
from cosim.conversion import Conversion, convert_between, to_si
from cosim.coupling import Coupling, targets_of
from cosim.engine.march import Tape
from cosim.planning import Layout, lay_out
from cosim.system import Scenario, System
from eightpost.errors import InputError, StepError, WiringError
from eightpost.signals import Drivefile, TimeSeries

# ---- Times at which steps of a run end [s]; times that differ by rounding only are treated as equal -----------------

Times = NDArray[np.float64]

#: Times that differ by less than this share of the run are treated as equal.
ROUNDING = 1e-9


def coupling_times(stop: float, step: float) -> Times:
    """Return the communication points (K+1,) [s]: whole multiples of the step, which do not drift, and the stop time.

    Args:
        stop: Duration of the run [s].
        step: Coupling step [s].

    Raises:
        InputError: The step is not positive, or longer than the run.
    """
    if not (np.isfinite(step) and 0.0 < step <= stop):
        raise InputError(f"the coupling step must be positive and at most the run ({stop} s), not {step!r} s")
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: Times = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def step_sizes(times: Times, step: float) -> Times:
    """Return the steps between communication points (K,) [s]: `step` to the bit, except a shorter last one.

    Differences of times contain rounding errors that change from step to step. Components that cache values for a step
    size, such as exponentials, would compute them again in every step.

    Args:
        times: Communication points (K+1,) [s].
        step: Coupling step [s].
    """
    steps: Times = np.full(times.size - 1, step)
    rest = times[-1] - times[-2]
    if abs(rest - step) > ROUNDING * step:
        steps[-1] = rest
    return steps


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
    kept: Times = times[np.append(np.diff(times) > ROUNDING * times[-1], True)]
    return kept


def among(times: Times, chosen: Times, stop: float) -> NDArray[np.bool_]:
    """Return whether each time (T,) [s] equals one of the chosen ones (R,) [s], except for rounding.

    Args:
        times: Times to check.
        chosen: Chosen times, in order.
        stop: Duration of the run [s].
    """
    place = np.searchsorted(chosen, times)
    after = np.abs(times - chosen[np.clip(place, 0, chosen.size - 1)])
    before = np.abs(times - chosen[np.clip(place - 1, 0, chosen.size - 1)])
    found: NDArray[np.bool_] = np.minimum(after, before) < ROUNDING * stop
    return found


# ---- Limits checked at every step -----------------------------------------------------------------------------------


class LimitWatch:
    """Signals that are watched at every step after settling, and the share of time beyond their limits.

    The names are those of docs/ports.md: `beyond_fit`, and outputs ending in `tire_force`.
    """

    def __init__(self, system: System) -> None:
        self._flags = tuple(
            f"{name}.{variable}"
            for name, component in system.components.items()
            for variable in component.variables
            if variable.rpartition(".")[2] == "beyond_fit"  # each shock of an assembly has one
        )
        self._tires = {
            f"{name}.{v.name}": _static_load(system, name, v.name) != 0.0
            for name, component in system.components.items()
            for v in component.variables.values()
            if v.causality == "output" and v.name.endswith("tire_force")
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables to read after every step."""
        return (*self._flags, *self._tires)

    @property
    def watched(self) -> tuple[tuple[str, bool], ...]:
        """The same names, each with whether it counts above one half (true) or below zero (false)."""
        return (*((name, True) for name in self._flags), *((name, False) for name in self._tires))

    def beyond_fit(self, times: Sequence[float]) -> dict[str, float]:
        """Return the share of time, per shock, in which its damper velocity was outside its fitted range.

        Args:
            times: Time beyond each limit, in the order of `watched`, followed by the total time [s].
        """
        return {
            name.rpartition(".")[0]: _share(time, times[-1]) for name, time in zip(self._flags, times, strict=False)
        }

    def tire_off(self, times: Sequence[float]) -> dict[str, float | None]:
        """Return the share of time below zero load per tire force; None if no static load is given."""
        rows = zip(self._tires.items(), times[len(self._flags) :], strict=False)
        return {name: _share(time, times[-1]) if known else None for (name, known), time in rows}


def _share(time: float, total: float) -> float:
    return time / total if total else 0.0


def _static_load(system: System, component: str, output: str) -> float:
    parameter = output.replace("tire_force", "static_tire_force")
    known = system.components[component].variables.get(parameter)
    value = system.parameters.get(component, {}).get(parameter, known.start if known else 0.0)
    return float(value or 0.0)


# ---- Checks, before a run, that the components have the abilities that an algorithm needs ---------------------------


def check_variable_step(system: System, algorithm: Algorithm, times: Times, step: float) -> None:
    """Refuse steps of several sizes for a component that accepts only one size.

    Args:
        system: System with its components.
        algorithm: Algorithm of the run.
        times: Communication points (K+1,) [s].
        step: Coupling step [s].

    Raises:
        WiringError: The message names the component.
    """
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


def check_repeats(system: System, algorithm: Algorithm) -> None:
    """Refuse an algorithm that repeats steps for a component that cannot save its state.

    Raises:
        WiringError: The message names the component.
    """
    if not algorithm.repeats:
        return
    for name, component in system.components.items():
        if not component.capabilities.state:
            raise WiringError(
                f"{algorithm.name} repeats steps, and {name} ({component.source}) cannot save and restore its state "
                "(canGetAndSetFMUstate); use gauss-seidel"
            )


# ---- Integer, Boolean and enumeration variables ---------------------------------------------------------------------

#: Maximum number of solutions of the equilibrium start, which is repeated if a discrete value has changed.
_ROUNDS = 10


@dataclass(frozen=True, slots=True)
class _Link:
    """Output that sets an input: `input = factor * output + offset`, rounded if the input is not Real."""

    source: str
    target: Variable
    factor: float
    offset: float

    def __call__(self, value: float) -> float:
        return as_type(self.target.type, self.factor * value + self.offset)


@dataclass
class DiscreteExchange:
    """Discrete variables of a system, and their current values.

    Args:
        components: All components by name.
        links: Link of each connected input, named `component.variable`.
        driven: Channel of the drive and type of each driven discrete input.
        names: Discrete variables to record.
        drive: Drive of the scenario.
        drive_start: Time in the drive at which the run starts [s].
    """

    components: Mapping[str, Component]
    links: Mapping[str, _Link]
    driven: Mapping[str, tuple[int, str]]
    names: tuple[str, ...]
    drive: Drivefile | None = None
    drive_start: float = 0.0
    rows: list[list[float]] = field(default_factory=list)
    _set: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, scenario: Scenario, names: Iterable[str]) -> DiscreteExchange:
        """Collect the discrete variables that a system couples, drives and records."""
        driven = {
            target: (index, system.input(target).type)
            for target, index in targets_of(system, scenario).items()
            if system.input(target).type in DISCRETE
        }
        recorded = tuple(name for name in names if system.output(name).type in DISCRETE)
        return cls(system.components, _links(system), driven, recorded, scenario.drive, scenario.drive_start)

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

    def settle(self, solve: Callable[[], None]) -> bool:
        """Call `solve` for the equilibrium start until no discrete value changes; return whether that was reached."""
        self.exchange(0.0)
        for _ in range(_ROUNDS):
            solve()
            if not self.exchange(0.0):
                return True
        return False

    def exchange(self, time: float) -> bool:
        """Set every input whose source has changed at `time` [s]; return whether there was one."""
        if not self.is_coupled:
            return False
        known = self._read(link.source for link in self.links.values())
        current = {target: link(known[link.source]) for target, link in self.links.items()} | self._driven_at(time)
        changed = {target: value for target, value in current.items() if self._set.get(target) != value}
        for name, inputs in _by_component(changed).items():
            self.components[name].set(inputs, [changed[f"{name}.{variable}"] for variable in inputs])
        self._set |= changed
        return bool(changed)

    def record(self, rows: int) -> None:
        """Record a row of discrete values if the loop has recorded more rows (`rows`) than this object."""
        if self.names and rows > len(self.rows):
            known = self._read(self.names)
            self.rows.append([known[name] for name in self.names])

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
        return {target: as_type(kind, float(series.values[k, place])) for target, (k, kind) in self.driven.items()}


def as_type(kind: str, value: float) -> float:
    """Return a number converted to a variable's type: a Boolean is true unless 0, integers are rounded."""
    if kind == "Boolean":
        return float(value != 0.0)
    return value if kind == "Real" else float(round(value))


def _links(system: System) -> dict[str, _Link]:
    links = {}
    for connection in system.discrete_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        unit = convert_between(source.unit, target.unit, f"{connection.source} -> {connection.target}")
        factor, offset = connection.gain * unit.factor, connection.gain * unit.offset + connection.offset
        links[connection.target] = _Link(connection.source, target, factor, offset)
    return links


def _by_component(names: Iterable[str]) -> dict[str, list[str]]:
    variables: dict[str, list[str]] = {}
    for name in names:
        component, _, variable = name.partition(".")
        variables.setdefault(component, []).append(variable)
    return variables


# ---- Recording of a run ---------------------------------------------------------------------------------------------

Flags = NDArray[np.int64]

_NUMBERS = ("Real", *DISCRETE)


def recorded_names(system: System, scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the recorded variables: those of the scenario, else every output that is a number.

    Raises:
        WiringError: A name is unknown or its values are not numbers.
    """
    names = tuple(dict.fromkeys(scenario.record)) or _every_output(system)
    for name in names:
        if system.output(name).type not in _NUMBERS:
            raise WiringError(f"{name} is a {system.output(name).type} and cannot be recorded; record numbers")
    return names


def real_names(system: System, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that the loop records; discrete variables are recorded outside the loop."""
    return tuple(name for name in names if system.output(name).type == "Real")


def recorded_steps(scenario: Scenario, step: float, count: int) -> Flags:
    """Return 1 for each of the communication points 0 to `count` that is recorded: the first, the last, and every n-th.

    Raises:
        InputError: The record step is not a whole number of coupling steps.
    """
    flags = np.zeros(count + 1, np.int64)
    flags[:: _stride(scenario, step)] = 1
    flags[-1] = 1
    return flags


def blank_tape(layout: Layout, names: tuple[str, ...], rows: int) -> Tape:
    """Return a tape with space for `rows` communication points."""
    places = {name: k for k, name in enumerate((*layout.signals, *layout.extras))}
    columns = np.array([places[name] for name in names], dtype=np.uint32)
    return Tape(np.zeros((rows, len(names))), np.zeros(rows), columns, np.zeros(1, np.int64))


def recorded_series(
    system: System, names: tuple[str, ...], tape: Tape, discrete: Sequence[Sequence[float]] = ()
) -> TimeSeries:
    """Return the contents of a tape and the rows of discrete variables, in SI."""
    count = int(tape.position[0])
    values, units = _values(system, names, tape.rows[:count], discrete), []
    for row, name in zip(values, names, strict=True):
        conversion, unit = to_si(system.output(name))
        units.append(unit)
        if conversion != Conversion():
            row[:] = conversion.factor * row + conversion.offset
        if not np.isfinite(row).all():
            raise StepError(_not_a_number(name, tape.times[int(np.argmin(np.isfinite(row)))]))
    values.setflags(write=False)  # no other references exist, so no copy is needed
    return TimeSeries(tape.times[:count], values, names, tuple(units))


def _values(
    system: System, names: tuple[str, ...], real: NDArray[np.float64], discrete: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    """Return one row per name (M, R) from the rows per time of both kinds."""
    is_real = np.array([system.output(name).type == "Real" for name in names], dtype=bool)
    if is_real.all():
        return np.ascontiguousarray(real.T)
    values = np.empty((len(names), real.shape[0]))
    values[is_real] = real.T
    values[~is_real] = np.array(discrete, dtype=np.float64).reshape(real.shape[0], -1).T
    return values


def _not_a_number(name: str, time: float) -> str:
    return (
        f"{name} is not a number from {time:g} s on: check the inputs and the log of its component, or remove it from "
        "the record list ([scenario] record)"
    )


def _every_output(system: System) -> tuple[str, ...]:
    return tuple(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.causality == "output" and v.type in _NUMBERS
    )


def _stride(scenario: Scenario, step: float) -> int:
    if scenario.record_step is None:
        return 1
    stride = round(scenario.record_step / step)
    if stride < 1 or abs(stride * step - scenario.record_step) > 1e-9 * scenario.record_step:
        raise InputError(
            f"record_step {scenario.record_step} s is not a whole number of coupling steps of {step} s; change one"
        )
    return stride


# ---- Setup of a run -------------------------------------------------------------------------------------------------


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
