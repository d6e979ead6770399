"""Scenario of a run, the resolved connections of its system, and the coupling algorithms for `cosim.run`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from math import isfinite
from pathlib import Path
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from cosim.components.component import Component, Conversion, convert_between, named_unit
from cosim.engine.plan import EXTRAPOLATED, GAUSS_SEIDEL, HELD, IMPLICIT, INTERPOLATED, JACOBI, PARABOLIC, Mode
from cosim.systems.system import System
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError, WiringError, check_number
from eightpost.signals import Drivefile

# ---- Scenario: length, drive, recorded signals ----------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class Scenario(Summarized):
    """A run of a system.

    Raises:
        InputError: A time is not positive and finite, or the drive does not cover the run.
    """

    stop: float  #: Duration [s].
    drive: Drivefile | None = None  #: Signals for the inputs that no component feeds.
    #: Input that each channel of `drive` feeds: `{"lf.road": "car.lf.road"}`. Empty: every channel feeds the only
    #: component input of that name.
    targets: Mapping[str, str] = field(default_factory=dict)
    record: tuple[str, ...] = ()  #: Variables to record, as `component.variable`; empty: every output.
    #: Time between recorded samples [s], a whole number of coupling steps; None: every step.
    record_step: float | None = None
    settling: float = 0.0  #: Time at the start that is excluded from response measures [s].
    drive_start: float = 0.0  #: Time in the drive at which the run starts [s]; the drive must cover the whole run.

    def __post_init__(self) -> None:
        self._check_types()
        if not (isfinite(self.stop) and self.stop > 0.0):
            raise InputError(f"scenario: stop must be a positive time, not {self.stop!r} s")
        if self.record_step is not None and not (isfinite(self.record_step) and self.record_step > 0.0):
            raise InputError(f"scenario: record_step must be a positive time, not {self.record_step!r} s")
        self._check_cover()
        if not 0.0 <= self.settling < self.stop:
            raise InputError(
                f"scenario: settling must be shorter than the run ({self.stop} s), not {self.settling!r} s"
            )

    def _check_types(self) -> None:
        for name in ("stop", "record_step", "settling", "drive_start"):
            if isinstance(value := getattr(self, name), str):
                raise InputError(f"scenario: {name} is {value!r}; give a number of seconds")
        if self.drive is not None and not isinstance(self.drive, Drivefile):
            what = f"Drivefile.read({str(self.drive)!r})" if isinstance(self.drive, str | Path) else "a Drivefile"
            raise InputError(f"scenario: drive is a {type(self.drive).__name__}; give {what}")
        if isinstance(self.record, str):
            raise InputError(f"scenario: record is a text; give a list of names: [{self.record!r}]")

    def _summary(self) -> Summary:
        return Summary.of("Scenario", *self.summary_rows())

    def summary_rows(self) -> tuple[tuple[str, str], ...]:
        """Return duration, drive and recorded variables as rows of a summary."""
        every = "every step" if self.record_step is None else f"every {1e3 * self.record_step:g} ms"
        return (
            ("duration", f"{self.stop:g} s"),
            ("drive", "none" if self.drive is None else f"{some(self.drive.names)} from {self.drive_start:g} s"),
            ("record", f"{some(self.record) or 'every output'}, {every}"),
            ("settling", f"{self.settling:g} s" if self.settling else ""),
        )

    def _check_cover(self) -> None:
        if self.drive is None:
            return
        first, last = float(self.drive.series.time[0]), float(self.drive.series.time[-1])
        begin, end = self.drive_start, self.drive_start + self.stop
        slack = 1e-9 * max(abs(last), 1.0)
        if first > begin + slack or last < end - slack:
            raise InputError(
                f"scenario: the run takes {begin:g} to {end:g} s of the drive file, it holds {first:g} to {last:g} s: "
                "change stop or drive_start"
            )


# ---- Sources of every component's inputs, and their values at the start ---------------------------------------------


@dataclass(frozen=True, slots=True)
class Term:
    """Contribution of one output to an input: `gain * conversion(output)`."""

    source: str
    gain: float
    conversion: Conversion

    @property
    def part(self) -> str:
        """Component of the output."""
        return self.source.partition(".")[0]


@dataclass(frozen=True, slots=True)
class Feed:
    """All sources of one input: the terms of connections, a channel of the drive, a constant."""

    target: str
    terms: tuple[Term, ...]
    drive: int | None
    drive_conversion: Conversion
    constant: float

    @property
    def is_moving(self) -> bool:
        """Whether the input changes during a run."""
        return bool(self.terms) or self.drive is not None

    def value(self, outputs: Mapping[str, float], drive: Sequence[float]) -> float:
        """Return the input for values of the outputs (0 if not known yet) and of the drive's channels."""
        value = self.constant
        for term in self.terms:
            value += term.gain * term.conversion(outputs.get(term.source, 0.0))
        if self.drive is not None:
            value += self.drive_conversion(drive[self.drive])
        return float(value)


class Coupling:
    """Sources of every input, and the current values of all connections, `now`, until the first step."""

    def __init__(
        self, system: System, scenario: Scenario, *, every_step: Sequence[str] = (), recorded: Sequence[str] = ()
    ) -> None:
        """Resolve every connection.

        Args:
            system: Components and connections.
            scenario: Scenario with the drive.
            every_step: Variables to read after every step besides the connected ones, as `component.variable`.
            recorded: Variables to read at recorded points.

        Raises:
            WiringError: A drive channel has no input, an input has no source or two sources, or units do not fit.
        """
        self._first_drive: list[float] = []
        if scenario.drive:
            self._first_drive = scenario.drive.sample(np.array([scenario.drive_start]))[:, 0].tolist()
        self.components: Mapping[str, Component] = system.components
        self.feeds = _feeds(system, scenario)
        connected = {term.source for feeds in self.feeds.values() for feed in feeds for term in feed.terms}
        sources = connected | set(every_step)
        self._connected = connected
        self.outputs = {name: _names_of(name, sources) for name in self.components}
        self.recorded = {name: _names_of(name, set(recorded) - sources) for name in self.components}
        self.now: dict[str, float] = {}

    def feed_start(self, name: str) -> None:
        """Set a component's inputs to their values at the start, from the known outputs (0 if not known yet)."""
        if feeds := self.feeds[name]:
            values = [feed.value(self.now, self._first_drive) for feed in feeds]
            self.components[name].set([feed.target for feed in feeds], values)

    def read(self, name: str) -> dict[str, float]:
        """Return a component's connected outputs, and its other variables read in every step, by full name."""
        names = self.outputs[name]
        if not names:
            return {}
        return dict(zip((f"{name}.{n}" for n in names), self.components[name].get(names), strict=True))

    def order(self) -> tuple[tuple[str, ...], bool]:
        """Return the components sorted by their direct dependencies, and whether there is no dependency loop."""
        follows: dict[str, set[str]] = {name: set() for name in self.components}
        for name, feeds in self.feeds.items():
            direct = self.direct_inputs(name)
            follows[name] = {term.part for feed in feeds if feed.target in direct for term in feed.terms} - {name}
        try:
            return tuple(TopologicalSorter(follows).static_order()), True
        except CycleError:
            return tuple(self.components), False

    @property
    def has_loop(self) -> bool:
        """Whether components form a loop of connections."""
        takes = {name: {t.part for f in feeds for t in f.terms} - {name} for name, feeds in self.feeds.items()}
        try:
            TopologicalSorter(takes).prepare()
        except CycleError:
            return True
        return False

    def direct_inputs(self, name: str) -> frozenset[str]:
        """Return the inputs that connected outputs follow without delay; if no output is connected, use all outputs."""
        variables = self.components[name].variables
        outputs = [v for v in variables.values() if f"{name}.{v.name}" in self._connected] or list(variables.values())
        return frozenset().union(*(v.direct for v in outputs)) if outputs else frozenset()

    def held_inputs(self) -> frozenset[str]:
        """Return the inputs that change over a step but are held, because their component cannot ramp them."""
        return frozenset(
            f"{name}.{feed.target}"
            for name, feeds in self.feeds.items()
            if not self.components[name].capabilities.interpolates_inputs
            for feed in feeds
            if feed.is_moving
        )


def _names_of(component: str, full_names: set[str]) -> tuple[str, ...]:
    prefix = f"{component}."
    return tuple(sorted(name.removeprefix(prefix) for name in full_names if name.startswith(prefix)))


def _feeds(system: System, scenario: Scenario) -> dict[str, tuple[Feed, ...]]:
    terms: dict[str, list[Term]] = {}
    for connection in system.real_connections:
        source, target = system.output(connection.source), system.input(connection.target)
        conversion = convert_between(source.unit, target.unit, str(connection))
        # A term applies the gain last, so an offset that is added after the gain is divided by the gain here.
        offset = conversion.offset + connection.offset / connection.gain
        term = Term(connection.source, connection.gain, Conversion(conversion.factor, offset))
        terms.setdefault(connection.target, []).append(term)
    driven = _driven(system, scenario)
    _check_drive(system, terms, driven)
    feeds: dict[str, tuple[Feed, ...]] = {}
    elsewhere = {connection.target for connection in system.discrete_connections}
    for name, component in system.components.items():
        inputs = [
            v
            for v in component.variables.values()
            if v.causality == "input" and v.type == "Real" and f"{name}.{v.name}" not in elsewhere
        ]
        feeds[name] = tuple(_feed(f"{name}.{v.name}", terms, driven, system.constants) for v in inputs)
    return feeds


def _feed(
    target: str,
    terms: Mapping[str, list[Term]],
    driven: Mapping[str, tuple[int, Conversion]],
    constants: Mapping[str, float],
) -> Feed:
    if target not in terms and target not in driven and target not in constants:
        raise WiringError(
            f"{target} is an input without a source: connect it, give the drive file a channel for it, or give it a "
            "constant value (constants in Python, [components.NAME.inputs] in the file)"
        )
    channel, conversion = driven.get(target, (None, Conversion()))
    short = target.partition(".")[2]
    return Feed(short, tuple(terms.get(target, ())), channel, conversion, constants.get(target, 0.0))


def _driven(system: System, scenario: Scenario) -> dict[str, tuple[int, Conversion]]:
    """Return, for each driven input, the channel of the drive and the conversion from its SI unit."""
    if scenario.drive is None:
        return {}
    driven = {}
    for target, index in targets_of(system, scenario).items():
        channel, source = scenario.drive.names[index], named_unit(scenario.drive.units[index])
        unit = system.input(target).unit
        driven[target] = (index, convert_between(source, unit, f"drive file {channel} -> {target}"))
    return driven


def targets_of(system: System, scenario: Scenario) -> dict[str, int]:
    """Return the index of the drive's channel for each input that it feeds.

    Raises:
        WiringError: A channel does not exist or does not match exactly one input, or two channels feed one input.
    """
    if scenario.drive is None:
        return {}
    targets = scenario.targets or {name: _only_input(system, name) for name in scenario.drive.names}
    found: dict[str, int] = {}
    for channel, target in targets.items():
        if channel not in scenario.drive.names:
            raise WiringError(f"the drive file has no channel {channel!r}; it has {', '.join(scenario.drive.names)}")
        if target in found:
            raise WiringError(f"two channels of the drive file feed {target}; keep one")
        found[target] = scenario.drive.names.index(channel)
    return found


def _only_input(system: System, channel: str) -> str:
    homes = [
        f"{name}.{channel}"
        for name, component in system.components.items()
        if (variable := component.variables.get(channel)) is not None and variable.causality == "input"
    ]
    if len(homes) != 1:
        found = " and ".join(homes) or "no input"
        raise WiringError(
            f"drive file channel {channel!r} matches {found}; name its input in the targets of [scenario] or "
            f'[[drive]], "{channel}" = "COMPONENT.INPUT"; in Python, Scenario(targets=...)'
        )
    return homes[0]


def _check_drive(system: System, terms: Mapping[str, object], driven: Mapping[str, object]) -> None:
    discrete = {connection.target for connection in system.discrete_connections}
    for target in driven:
        if target in discrete or ((target in terms or target in system.constants) and target not in system.sums):
            raise WiringError(
                f'{target} has two sources (the drive file and another); remove one, or add "{target}" to sums'
            )


# ==== Coupling algorithms: frozen strategy objects with one interface ================================================


#: Coupling values over a step whose end values are not known yet.
VALUES: Mapping[str, int] = {
    "held": HELD,
    "interpolated": INTERPOLATED,
    "extrapolated": EXTRAPOLATED,
    "parabolic": PARABOLIC,
}


class Accuracy(NamedTuple):
    """Accuracy of a scheme for components that ramp their inputs."""

    order: int  #: Order of the error in the coupling step [1].
    #: Error of a coupled value in the mean over a step, as a share of its error at the end of the step [1].
    share: float


#: Accuracy of explicit schemes by their coupling values: Adams-Bashforth formulas of two and three points.
_ACCURACY = {
    "held": Accuracy(1, 0.5),
    "interpolated": Accuracy(1, 1.0),
    "extrapolated": Accuracy(2, 5.0 / 12.0),
    "parabolic": Accuracy(3, 3.0 / 8.0),
}

#: Accuracy for a component that holds its inputs over a step.
HELD_INPUTS = Accuracy(1, 0.5)


class Algorithm(Protocol):
    """Scheme that steps the components from one communication point to the next."""

    @property
    def name(self) -> str:
        """Name on the command line."""

    #: Whether steps are repeated, so that every component must save and restore its state.
    repeats: ClassVar[bool]

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy for components that ramp their inputs."""

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the order in which the components are stepped.

        Raises:
            WiringError: The algorithm's own sequence does not name every component once.
        """

    def mode(self, settling: float) -> Mode:
        """Return the loop's settings for a step; limits are watched after `settling` [s]."""


def _step_advice(scheme: object, value: object) -> str:
    """Return what to write if a number, which can only be meant as the coupling step, was given to a scheme."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return ""
    return f"; for a coupling step of {value!r} s write run(..., algorithm={type(scheme).__name__}(), step={value!r})"


class _Explicit:
    """Base of schemes that make each step once and predict coupling values that are not known yet."""

    __slots__ = ()

    repeats: ClassVar[bool] = False
    values: str
    _sweep: ClassVar[int]

    def __post_init__(self) -> None:
        if self.values not in VALUES:
            raise InputError(
                f"coupling values must be one of {', '.join(VALUES)}, not {self.values!r}"
                f"{_step_advice(self, self.values)}"
            )

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy of the coupling values."""
        return _ACCURACY[self.values]

    def mode(self, settling: float) -> Mode:
        """Return the loop's settings for a step; limits are watched after `settling` [s]."""
        return Mode(self._sweep, VALUES[self.values], 0.0, 0, settling, 1)


class _Sequenced:
    """Base of schemes that step the components one after the other."""

    __slots__ = ()

    sequence: tuple[str, ...]

    def _check_sequence(self) -> None:
        """Raise InputError if the sequence is not one of names; a step given in its place is named."""
        value: object = self.sequence
        if isinstance(value, (tuple, list)) and all(isinstance(name, str) for name in value):
            return
        raise InputError(
            f"sequence must be a tuple of component names such as ('car', 'lf'), not {value!r}"
            f"{_step_advice(self, value)}"
        )

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the given sequence, or the one that follows from the dependencies."""
        if not self.sequence:
            return coupling.order()[0]
        if sorted(self.sequence) != sorted(coupling.components):
            raise WiringError(
                f"the sequence {', '.join(self.sequence)} must name every component once: "
                f"{', '.join(coupling.components)}"
            )
        return self.sequence


@dataclass(frozen=True, slots=True)
class Jacobi(_Explicit):
    """Jacobi scheme: every component steps with the values known at the start of the step.

    With held values this is the scheme of most tools. With full damping in the shocks it needs small steps
    (docs/explanation/coupling.md).

    Raises:
        InputError: `values` is not one of these.
    """

    #: Coupling values over a step: `held` at the value at its start; `interpolated` from the last step's start to this
    #: one's, continuous and a step late; `extrapolated` with the last step's slope; `parabolic` with the slope and its
    #: change.
    values: str = "held"  # type: ignore[override]
    name: str = "jacobi"
    _sweep: ClassVar[int] = JACOBI

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the components in the system's order; the result does not depend on it."""
        return tuple(coupling.components)


@dataclass(frozen=True, slots=True)
class GaussSeidel(_Explicit, _Sequenced):
    """Gauss-Seidel scheme: each component steps with the newest outputs of those that have stepped before it.

    Raises:
        InputError: `values` is not one of these, or `sequence` is no tuple of names.
    """

    #: Order of the components. If empty, it follows from the declared dependencies: a component whose outputs follow an
    #: input without delay comes after the one that feeds it (vehicle first, then its shocks).
    sequence: tuple[str, ...] = ()  # type: ignore[override]
    #: Coupling values of components that have not stepped: `extrapolated` with the last step's slope, `parabolic` with
    #: the slope and its change (third order, with a smaller stability limit), `interpolated` (a step late), or `held`.
    #: With `held`, known values are held too, at the newest value.
    values: str = "extrapolated"  # type: ignore[override]
    name: str = "gauss-seidel"
    _sweep: ClassVar[int] = GAUSS_SEIDEL

    def __post_init__(self) -> None:
        self._check_sequence()
        _Explicit.__post_init__(self)


@dataclass(frozen=True, slots=True)
class Implicit(_Sequenced):
    """Implicit scheme: every step is repeated until the assumed coupling values equal the computed ones.

    It is stable at steps and stiffnesses where explicit schemes are not. Coupled values are then known at both ends of
    a step, and their mean is that of a parabola that also passes through the start of the last step. Every component
    must save and restore its state.

    Raises:
        InputError: The tolerance is not between 0 and 1, the number of iterations is less than 1, or `sequence` is no
            tuple of names.
    """

    #: Order of the components; see GaussSeidel.
    sequence: tuple[str, ...] = ()  # type: ignore[override]
    #: Largest disagreement [1], relative to the largest value of the signal so far; up to a hundred times that if
    #: iterations stall, since a component's output may jump slightly.
    tolerance: float = 1e-5
    #: Maximum number of iterations of a step before its Jacobian is computed again, and after that before the step is
    #: given up.
    iterations: int = 15
    name: str = "implicit"
    repeats: ClassVar[bool] = True

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy of the Adams-Moulton formula of three points, compared with the Adams-Bashforth prediction."""
        return Accuracy(3, 1.0 / 24.0)

    def __post_init__(self) -> None:
        self._check_sequence()
        check_number("implicit: tolerance", self.tolerance, "1")
        check_number("implicit: iterations", self.iterations)
        if not (0.0 < self.tolerance < 1.0 and self.iterations >= 1):
            raise InputError(
                f"implicit: tolerance must lie between 0 and 1 and iterations be at least 1, not {self.tolerance!r} "
                f"and {self.iterations!r}"
            )

    def mode(self, settling: float) -> Mode:
        """Return the loop's settings for a step; limits are watched after `settling` [s]."""
        return Mode(IMPLICIT, EXTRAPOLATED, self.tolerance, self.iterations, settling, 0)


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Adaptive coupling step: each step is made once whole and once in halves, which must agree.

    A proportional-integral controller sets the step. Steps end at recorded times, at points of the drive file and
    at the stop time. Every component must save and restore its state and accept steps of any size.

    Raises:
        InputError: `scheme` is no scheme with a fixed step, `relative` or `least` is not positive, or `least` is above
            `largest`.
    """

    scheme: GaussSeidel | Jacobi | Implicit = field(default_factory=GaussSeidel)  #: Scheme of each step.
    relative: float = 1e-4  #: Allowed local error [1], relative to the largest value so far of each coupled signal.
    #: Additional allowed local error per signal (`component.variable`), in its own unit; by default 1e-5 m/s, 1e-6 m,
    #: 0.01 N.
    absolute: Mapping[str, float] = field(default_factory=dict)
    least: float = 1e-7  #: Smallest step [s]; if the error is still too large with it, the run ends and reports this.
    largest: float = 0.02  #: Largest step [s].
    name: str = "adaptive"
    repeats: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not isinstance(self.scheme, GaussSeidel | Jacobi | Implicit):
            raise InputError(
                f"adaptive: scheme must be GaussSeidel(), Jacobi() or Implicit(), not {self.scheme!r}"
                f"{_step_advice(self, self.scheme)}"
            )
        for name, unit in (("relative", "1"), ("least", "s"), ("largest", "s")):
            check_number(f"adaptive: {name}", getattr(self, name), unit)
        if not (self.relative > 0.0 and 0.0 < self.least <= self.largest):
            raise InputError(
                f"adaptive: relative must be positive and least at most largest, not {self.relative!r}, {self.least!r} "
                f"s and {self.largest!r} s"
            )

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy of the scheme."""
        return self.scheme.accuracy

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the scheme's order of components."""
        return self.scheme.order(coupling)

    def mode(self, settling: float) -> Mode:
        """Return the loop's settings for a step; limits are watched after `settling` [s]."""
        return self.scheme.mode(settling)._replace(final=0)


#: Algorithms by name, with their default settings.
ALGORITHMS: dict[str, Algorithm] = {
    "jacobi": Jacobi(),
    "gauss-seidel": GaussSeidel(),
    "implicit": Implicit(),
    "adaptive": Adaptive(),
}


# ---- The default -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Automatic:
    """Gauss-Seidel, or Implicit if that is not stable, at a step for which successive runs agree.

    The step is halved from run to run. The differences between the runs give the error of the last one per channel
    (`Result.stated_error`; cosim.session.result). The tolerance is met if the largest stated error is within it
    and the local errors of all bonds are small in the last two runs. The last run is the result.
    """

    #: Coupling error to aim at, of velocities and forces of bonds and of tire forces, in percent of each signal's scale
    #: (cosim.session.result.scales).
    tolerance: float = 0.2
    least: float = 1e-5  #: Smallest coupling step to try [s].
    name: str = "default"

    def __post_init__(self) -> None:
        check_number("tolerance", self.tolerance, "%")
        check_number("least", self.least, "s")
        if not (self.tolerance > 0.0 and self.least > 0.0):
            raise InputError(
                f"tolerance and least step must be positive, not {self.tolerance!r} % and {self.least!r} s"
            )


#: Algorithms by the names that the command line and system files use.
SCHEMES: Mapping[str, Algorithm | Automatic] = {"default": Automatic(), **ALGORITHMS}


def default_scheme(name: str = "gauss-seidel") -> GaussSeidel | Implicit:
    """Return a scheme of the default by its name, with the coupling values that the default uses."""
    return Implicit() if name == Implicit().name else GaussSeidel(values="parabolic")
