"""The default: a scheme that suits what the components can do, at a step that meets the tolerance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import ceil

from cosim.algorithm import ALGORITHMS, Algorithm, GaussSeidel, Implicit
from cosim.difference import difference, error_of_finer
from cosim.result import Result
from cosim.scenario import Scenario
from cosim.session import Session
from cosim.system import System
from eightpost.errors import InputError, StepError

#: Coupling step to begin with [s]: twice what suits race cars and their shocks (docs/coupling.md).
FIRST_STEP = 2e-3

#: Steps are chosen for this share of the tolerance: an estimate is no bound.
_AIM = 0.8

#: At least so many of a run's steps lie in a step of the run that it is compared with, and at most.
_FINER, _FINEST = 2, 16

#: Explicit exchange is given up where it still diverges at this share of the first step.
_COARSEST = 8


@dataclass(frozen=True, slots=True)
class Automatic:
    """Gauss-Seidel, or implicit where that is not stable, at a step for which runs at two steps agree.

    A run at a coarse step is compared with one at a finer step: their difference says how large the error of the finer
    one is (Richardson), and so which step would do. The last run is the result, with that error stated per channel
    (`Result.stated_error`). Components that hold their inputs make the exchange one of first order: then the comparison
    is made once, and only stated.

    Args:
        tolerance: Error of velocities and forces of bonds and of tire forces that is aimed at, in percent of each
            signal's standard deviation.
        least: No smaller coupling step is tried [s].
    """

    tolerance: float = 0.2
    least: float = 1e-5
    name: str = "default"

    def __post_init__(self) -> None:
        if not (self.tolerance > 0.0 and self.least > 0.0):
            raise InputError(
                f"tolerance and least step must be positive, not {self.tolerance!r} % and {self.least!r} s"
            )


#: By the names that the command line and system files use.
SCHEMES: Mapping[str, Algorithm | Automatic] = {"default": Automatic(), **ALGORITHMS}


def taken_by(system: System, scheme: str) -> GaussSeidel | Implicit:
    """Return what the default takes for a system: implicit, or gauss-seidel with values that suit its components.

    Where components hold their inputs over a step there is nothing that a slope could do.
    """
    if scheme == Implicit().name:
        return Implicit()
    return GaussSeidel(values="parabolic" if system.ramps else "held")


def run_automatic(
    system: System, scenario: Scenario, wish: Automatic, engine: str, progress: Callable[[float], None] | None
) -> Result:
    """Run at smaller and smaller steps until the error is within the tolerance; return the last run, its error stated.

    Raises:
        StepError: A component failed, or no scheme was stable.
    """
    search = _Search(system, scenario, wish, engine, progress)
    try:
        return search.run(taken_by(system, "gauss-seidel"))
    except _UnstableError as unstable:
        if not all(c.capabilities.state for c in system.components.values()):
            raise StepError(f"{unstable}; implicit would need components that save their state") from unstable
    search.tried.append("gauss-seidel is not stable")
    return search.run(taken_by(system, "implicit"))


class _UnstableError(StepError):
    """No step down to the least one gave a stable run."""


class _Search:
    """Runs of one system at smaller and smaller steps."""

    def __init__(
        self, system: System, scenario: Scenario, wish: Automatic, engine: str, progress: Callable[[float], None] | None
    ) -> None:
        self._system, self._wish, self._engine, self._progress = system, wish, engine, progress
        first = min(FIRST_STEP, scenario.stop)
        self._record = scenario.record_step or first
        self._scenario = replace(scenario, record_step=self._record)
        self._ramped = system.ramps
        self._decisive = system.decisive
        self._parts = max(1, ceil(self._record / first * (1.0 - 1e-12)))
        self.tried: list[str] = []
        self._seconds = self._stepping = 0.0

    def run(self, scheme: GaussSeidel | Implicit) -> Result:
        """Return the run that meets the tolerance, or the one at the least step or of the only comparison."""
        coarse, parts = self._first(scheme)
        while True:
            fine = self._at(scheme, parts)
            ratio = coarse.step / fine.step
            stated = error_of_finer(difference(coarse, fine), ratio, self._order(scheme))
            worst = self._worst(stated)
            self.tried.append(f"{fine.step * 1e3:g} ms {worst:.2g} %")
            fine = replace(fine, stated_error=stated)
            finer = self._finer(scheme, parts, worst / _AIM)
            if worst <= self._wish.tolerance or not self._ramped or self._record / finer < self._wish.least:
                return self._told(fine, scheme, worst)
            coarse, parts = fine, finer

    def _first(self, scheme: GaussSeidel | Implicit) -> tuple[Result, int]:
        """The first stable run, and how many steps of the next one lie in a recorded one."""
        parts = self._parts
        while True:
            try:
                coarse = self._at(scheme, parts)
            except StepError as error:
                if "diverged" not in str(error):
                    raise
                self.tried.append(f"{self._record / parts * 1e3:g} ms diverged")
                parts *= _FINER
                given_up = isinstance(scheme, GaussSeidel) and parts > _COARSEST * self._parts
                if given_up or self._record / parts < self._wish.least:
                    raise _UnstableError(str(error)) from error
                continue
            # The error of the bonds alone, step by step, is of the size of that of the run.
            guess = max((c.percent for c in coarse.coupled.values()), default=0.0)
            finer = self._finer(scheme, parts, guess) if self._ramped else 2 * parts
            return coarse, max(parts + 1, min(finer, int(self._record / self._wish.least)))

    def _order(self, scheme: GaussSeidel | Implicit) -> int:
        return scheme.accuracy.order if self._ramped else 1

    def _finer(self, scheme: GaussSeidel | Implicit, parts: int, error: float) -> int:
        """How many steps a recorded one is to have, by the scheme's order, where `parts` leave an error [%]."""
        more = (error / self._wish.tolerance) ** (1.0 / self._order(scheme))
        needed = ceil(parts * more) if more < _FINEST else _FINEST * parts
        return min(max(needed, parts + ceil(parts / 2)), _FINEST * parts)

    def _at(self, scheme: GaussSeidel | Implicit, parts: int) -> Result:
        session = Session(self._system, self._scenario, scheme, self._record / parts)
        result = session.run(self._engine, self._progress)
        self._seconds += result.seconds
        self._stepping += result.stepping_seconds
        return result

    def _worst(self, stated: Mapping[str, float]) -> float:
        """The largest error among the signals that decide; among all where none of them is recorded."""
        chosen = [value for name, value in stated.items() if name in self._decisive] or list(stated.values())
        return max(chosen, default=0.0)

    def _told(self, result: Result, scheme: GaussSeidel | Implicit, worst: float) -> Result:
        """The result with how it was found, and whether the tolerance was met."""
        values = "" if isinstance(scheme, Implicit) else f" with {scheme.values} values"
        notes: tuple[str, ...] = (
            f"the default took {scheme.name}{values} at {result.step * 1e3:g} ms; coupling error by "
            f"comparing runs: {', '.join(self.tried)}",
        )
        if worst > self._wish.tolerance:
            notes += (
                f"the coupling error of {worst:.2g} % is above the tolerance of {self._wish.tolerance:g} %: use FMUs "
                "that interpolate inputs, or give a smaller step",
            )
        return replace(
            result,
            algorithm=self._wish.name,
            scheme=scheme.name,
            notes=notes + result.notes,
            seconds=self._seconds,
            stepping_seconds=self._stepping,
            tolerance=self._wish.tolerance,
        )
