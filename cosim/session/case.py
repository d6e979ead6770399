"""Case: what a system file or a package says to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cosim.session.automatic import SCHEMES, Automatic
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.scenario import Scenario
from cosim.systems.system import DEFAULT_STEP, System
from eightpost.display import Summarized, Summary
from eightpost.errors import InputError
from eightpost.wiring import Wiring

#: Tolerances are given in percent.
PERCENT = 0.01


@dataclass(frozen=True, repr=False)
class Case(Summarized):
    """Contents of a system file or a package, ready to run."""

    name: str  #: Name of the system.
    system: System  #: Components, bonds, connections, values.
    scenario: Scenario  #: Drive, times and recording.
    algorithm: Algorithm | Automatic = field(default_factory=Automatic)  #: Algorithm of the run; a package states none.
    step: float | None = None  #: Coupling step [s]; None if none is stated.
    fmus: Mapping[str, Path] = field(default_factory=dict)  #: FMU files by component.
    notes: tuple[str, ...] = ()  #: Notes for the reader: names that were changed, values that match nothing.

    def _summary(self) -> Summary:
        step = "" if self.step is None else f", step {1e3 * self.step:g} ms"
        return Summary.of(
            f"System {self.name}",
            *self.system.summary_rows(),
            *self.scenario.summary_rows(),
            ("algorithm", f"{self.algorithm.name}{step}"),
            ("notes", f"{len(self.notes)}; see .notes" if self.notes else ""),
        )

    @property
    def wiring(self) -> Wiring:
        """FMUs and connections, for a package (`builder.ssp`) or an assembled FMU (`builder.assembly`)."""
        step = self.step or DEFAULT_STEP
        return self.system.wiring(self.fmus, name=self.name, step=step, stop=self.scenario.stop)

    def with_coupling(
        self, algorithm: str | None = None, step: float | None = None, tolerance: float | None = None
    ) -> Case:
        """Return the case with another coupling; None keeps that of the file.

        Args:
            algorithm: Name of an algorithm; the step of the file is dropped if the algorithm finds its own.
            step: Coupling step [s].
            tolerance: Tolerated coupling error [%].

        Raises:
            InputError: A tolerance is given, but the algorithm has none.
        """
        chosen, size = self.algorithm, self.step
        if algorithm is not None and algorithm != chosen.name:
            chosen = SCHEMES[algorithm]
            size = None if isinstance(chosen, Automatic) else size
        if tolerance is not None:
            chosen = _with_tolerance(chosen, tolerance)
        return replace(self, algorithm=chosen, step=size if step is None else step)


def _with_tolerance(algorithm: Algorithm | Automatic, percent: float) -> Algorithm | Automatic:
    if isinstance(algorithm, Automatic):
        return replace(algorithm, tolerance=percent)
    if isinstance(algorithm, Adaptive):
        return replace(algorithm, relative=PERCENT * percent)
    raise InputError(f"tolerance: the algorithm {algorithm.name} has no tolerance; use it with default or adaptive")
