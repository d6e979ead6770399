"""Coupling algorithms: frozen strategy objects with one interface, passed to `cosim.run`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple, Protocol

from cosim.engine.plan import EXTRAPOLATED, GAUSS_SEIDEL, HELD, IMPLICIT, INTERPOLATED, JACOBI, PARABOLIC, Mode
from cosim.systems.coupling import Coupling
from eightpost.errors import InputError, WiringError, check_number


class Accuracy(NamedTuple):
    """Accuracy of a scheme for components that ramp their inputs."""

    order: int  #: Order of the error in the coupling step [1].
    #: Error of a coupled value in the mean over a step, as a share of its error at the end of the step [1].
    share: float


#: Coupling values over a step whose end values are not known yet, with the accuracy that they give explicit schemes:
#: Adams-Bashforth formulas of two and three points.
VALUES: Mapping[str, tuple[int, Accuracy]] = {
    "held": (HELD, Accuracy(1, 0.5)),
    "interpolated": (INTERPOLATED, Accuracy(1, 1.0)),
    "extrapolated": (EXTRAPOLATED, Accuracy(2, 5.0 / 12.0)),
    "parabolic": (PARABOLIC, Accuracy(3, 3.0 / 8.0)),
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
        return VALUES[self.values][1]

    def mode(self, settling: float) -> Mode:
        """Return the loop's settings for a step; limits are watched after `settling` [s]."""
        return Mode(self._sweep, VALUES[self.values][0], 0.0, 0, settling, 1)


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


_SCHEMES: tuple[Algorithm | Automatic, ...] = (Automatic(), Jacobi(), GaussSeidel(), Implicit(), Adaptive())
#: Algorithms by the names that the command line and system files use, with their default settings.
SCHEMES: Mapping[str, Algorithm | Automatic] = {scheme.name: scheme for scheme in _SCHEMES}


def default_scheme(name: str = "gauss-seidel") -> GaussSeidel | Implicit:
    """Return a scheme of the default by its name, with the coupling values that the default uses."""
    return Implicit() if name == Implicit().name else GaussSeidel(values="parabolic")
