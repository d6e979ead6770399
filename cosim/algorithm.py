"""Coupling algorithms: frozen strategies; changing the method never changes the call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Protocol

from cosim.coupling import Coupling
from cosim.engine.plan import EXTRAPOLATED, GAUSS_SEIDEL, HELD, IMPLICIT, INTERPOLATED, JACOBI, PARABOLIC, Mode
from eightpost.errors import InputError, WiringError

#: What coupling values do over a step where their end is not known yet.
VALUES: Mapping[str, int] = {
    "held": HELD,
    "interpolated": INTERPOLATED,
    "extrapolated": EXTRAPOLATED,
    "parabolic": PARABOLIC,
}


class Accuracy(NamedTuple):
    """What is known of a scheme's error where components ramp their inputs.

    Args:
        order: Of the error in the coupling step [1].
        share: How much of what a coupled value missed at the end of a step it missed in the mean over the step [1].
    """

    order: int
    share: float


#: Of explicit schemes, by their coupling values: Adams and Bashforth's formulas of two and three points.
_ACCURACY = {
    "held": Accuracy(1, 0.5),
    "interpolated": Accuracy(1, 1.0),
    "extrapolated": Accuracy(2, 5.0 / 12.0),
    "parabolic": Accuracy(3, 3.0 / 8.0),
}

#: Adams and Moulton's formula of three points, against Adams and Bashforth's guess.
_ACCURACY_OF_IMPLICIT = Accuracy(3, 1.0 / 24.0)

#: Where a component holds its inputs over a step.
HELD_INPUTS = Accuracy(1, 0.5)


class Algorithm(Protocol):
    """How the components are stepped from one coupling point to the next."""

    @property
    def name(self) -> str:
        """As the command line writes it."""

    @property
    def repeats(self) -> bool:
        """Whether it repeats steps, so that every component must save and restore its state."""

    @property
    def accuracy(self) -> Accuracy:
        """What is known of its error where components ramp their inputs."""

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the order in which it steps the components.

        Raises:
            WiringError: It has an order of its own that does not name every component once.
        """

    def mode(self, settling: float) -> Mode:
        """Return how the loop makes a step; limits are watched after `settling` [s]."""


class _Explicit:
    """Makes each step once, with coupling values that are guessed where they are not known yet."""

    __slots__ = ()

    values: str
    _sweep: ClassVar[int]

    def __post_init__(self) -> None:
        if self.values not in VALUES:
            raise InputError(f"coupling values are {', '.join(VALUES)}, not {self.values!r}")

    @property
    def repeats(self) -> bool:
        """Steps are made once."""
        return False

    @property
    def accuracy(self) -> Accuracy:
        """By its coupling values."""
        return _ACCURACY[self.values]

    def mode(self, settling: float) -> Mode:
        """Return how the loop makes a step; limits are watched after `settling` [s]."""
        return Mode(self._sweep, VALUES[self.values], 0.0, 0, settling, 1)


class _Sequenced:
    """Steps the components one after the other, in an order that matters."""

    __slots__ = ()

    sequence: tuple[str, ...]

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the given sequence, or the one that the dependencies ask for.

        Raises:
            WiringError: The sequence does not name every component once.
        """
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
    """Every component steps with what is known at the start of the step.

    The exchange that most tools do, with held values. At full damping in the shocks it needs small steps
    (docs/coupling.md).

    Args:
        values: What coupling values do over a step: `held` at the start's; `interpolated` from the last step's start to
            this one's, continuous and a step late; `extrapolated` with the last step's slope; `parabolic` with that and
            its change.

    Raises:
        InputError: There are no such values.
    """

    values: str = "held"
    name: str = "jacobi"
    _sweep: ClassVar[int] = JACOBI

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Any order gives the same."""
        return tuple(coupling.components)


@dataclass(frozen=True, slots=True)
class GaussSeidel(_Explicit, _Sequenced):
    """Each component steps with the newest outputs of those before it: they are known at both ends of the step.

    Args:
        sequence: The components in order; empty: from the declared dependencies, a component whose outputs follow
            an input without delay after the one that feeds it (the vehicle first, then its shocks).
        values: What the outputs of components do that have not stepped: `extrapolated` with the last step's slope,
            `parabolic` with that and its change (third order, at a smaller limit of stability), `interpolated` (a step
            late), or `held`; with `held`, known ones are held too, at their newest.

    Raises:
        InputError: There are no such values.
    """

    sequence: tuple[str, ...] = ()
    values: str = "extrapolated"
    name: str = "gauss-seidel"
    _sweep: ClassVar[int] = GAUSS_SEIDEL


@dataclass(frozen=True, slots=True)
class Implicit(_Sequenced):
    """Every step is repeated until what the components assumed of each other is what they give.

    Stable at steps and stiffnesses where explicit exchanges are not. Coupled values are then known at both ends of a
    step, and follow in the mean a parabola through the start of the last one. Every component must save and restore its
    state.

    Args:
        sequence: As for GaussSeidel.
        tolerance: Largest disagreement [1], relative to the largest value of the signal so far; up to a hundred times
            that where iterations stop to help, since a component's answer may jump by a little.
        iterations: Most iterations of a step before its Jacobian is made anew, and after that before it is given up.

    Raises:
        InputError: The tolerance does not lie between 0 and 1, or there is to be no iteration.
    """

    sequence: tuple[str, ...] = ()
    tolerance: float = 1e-5
    iterations: int = 15
    name: str = "implicit"

    def __post_init__(self) -> None:
        if not (0.0 < self.tolerance < 1.0 and self.iterations >= 1):
            raise InputError(
                f"implicit: tolerance must lie between 0 and 1 and iterations be at least 1, not {self.tolerance!r} "
                f"and {self.iterations!r}"
            )

    @property
    def repeats(self) -> bool:
        """Steps are repeated from a saved state."""
        return True

    @property
    def accuracy(self) -> Accuracy:
        """Third order."""
        return _ACCURACY_OF_IMPLICIT

    def mode(self, settling: float) -> Mode:
        """Return how the loop makes a step; limits are watched after `settling` [s]."""
        return Mode(IMPLICIT, EXTRAPOLATED, self.tolerance, self.iterations, settling, 0)


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Chooses the coupling step: each is made once whole and once in halves, which must agree.

    The step follows a proportional-integral controller; it lands on recorded times, on the drivefile's own points and
    on the stop. Every component must save and restore its state and take steps of any size.

    Args:
        scheme: How each step is made.
        relative: Local error that is allowed [1], relative to the largest value so far of each coupled signal.
        absolute: Local error that is allowed besides, per signal (`component.variable`), in its own unit; by default
            1e-5 m/s, 1e-6 m, 0.01 N.
        least: Smallest step [s]; where it does not do, the run ends and says so.
        largest: Largest step [s].

    Raises:
        InputError: `relative` or `least` is not positive, or `least` is above `largest`.
    """

    scheme: GaussSeidel | Jacobi | Implicit = field(default_factory=GaussSeidel)
    relative: float = 1e-4
    absolute: Mapping[str, float] = field(default_factory=dict)
    least: float = 1e-7
    largest: float = 0.02
    name: str = "adaptive"

    def __post_init__(self) -> None:
        if not (self.relative > 0.0 and 0.0 < self.least <= self.largest):
            raise InputError(
                f"adaptive: relative must be positive and least at most largest, not {self.relative!r}, {self.least!r} "
                f"s and {self.largest!r} s"
            )

    @property
    def repeats(self) -> bool:
        """Every step is made twice."""
        return True

    @property
    def accuracy(self) -> Accuracy:
        """The scheme's."""
        return self.scheme.accuracy

    def order(self, coupling: Coupling) -> tuple[str, ...]:
        """Return the scheme's order."""
        return self.scheme.order(coupling)

    def mode(self, settling: float) -> Mode:
        """Return how the loop makes a step; limits are watched after `settling` [s]."""
        return self.scheme.mode(settling)._replace(final=0)


#: By name, with the settings that they have unless told otherwise.
ALGORITHMS: dict[str, Algorithm] = {
    "jacobi": Jacobi(),
    "gauss-seidel": GaussSeidel(),
    "implicit": Implicit(),
    "adaptive": Adaptive(),
}
