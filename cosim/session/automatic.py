"""Default algorithm: the scheme and the step are chosen so that the tolerance is met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil

from cosim.results.error_estimate import Comparison, compare, stated_error
from cosim.results.result import Result
from cosim.session.given_step import DenseRuns, run_at_step
from cosim.systems.algorithm import ALGORITHMS, Algorithm, GaussSeidel, Implicit
from cosim.systems.scenario import Scenario
from cosim.systems.system import System
from eightpost.errors import DivergedError, InputError, check_number
from eightpost.progress import Progress, continued

#: Largest first coupling step [s]: twice the step that suits race cars and their shocks (docs/explanation/coupling.md).
FIRST_STEP = 2e-3

#: Number of runs that diverged or had too large local errors after which Implicit replaces Gauss-Seidel.
_FAILED_RUNS = 2


@dataclass(frozen=True, slots=True)
class Automatic:
    """Gauss-Seidel, or Implicit if that is not stable, at a step for which successive runs agree.

    The step is halved from run to run. The differences between the runs give the error of the last one per channel
    (`Result.stated_error`; cosim.results.error_estimate). The tolerance is met if the largest stated error is within it
    and the local errors of all bonds are small in the last two runs. The last run is the result.
    """

    #: Coupling error to aim at, of velocities and forces of bonds and of tire forces, in percent of each signal's scale
    #: (cosim.results.error_estimate.scales).
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


def _can_repeat_steps(system: System) -> bool:
    """Return whether every component can save and restore its state."""
    return all(c.capabilities.state for c in system.components.values())


def run_default_at_step(
    system: System,
    scenario: Scenario,
    request: Automatic,
    step: float,
    *,
    engine: str,
    progress: Progress | None,
    compared: bool,
) -> Result:
    """Run the default's scheme at a given step: Gauss-Seidel, or Implicit where that diverges.

    Raises:
        DivergedError: The coupling diverged.
        StepError: A component failed.
    """
    scheme, progress = default_scheme(), progress and continued(progress)
    try:
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    except DivergedError:
        if not _can_repeat_steps(system):
            raise
        scheme = default_scheme("implicit")
        result = run_at_step(system, scenario, scheme, step, engine=engine, progress=progress, compared=compared)
    return replace(result, algorithm=request.name, scheme=scheme.name)


class Refinement:
    """Runs of one system at steps that are halved from one run to the next.

    Args:
        system: Components and connections.
        scenario: Drive, duration and recording.
        request: Tolerance and smallest step.
        engine: Engine of the loop; see `cosim.run`.
        progress: Callback that receives the completed and the total number of coupling steps of all runs.
    """

    def __init__(
        self,
        system: System,
        scenario: Scenario,
        request: Automatic,
        engine: str,
        progress: Progress | None,
    ) -> None:
        self._system, self._request = system, request
        first = min(FIRST_STEP, scenario.stop)
        self._record_step = scenario.record_step or first
        self._parts = max(1, ceil(self._record_step / first * (1.0 - 1e-12)))
        self._dense = DenseRuns(
            system,
            scenario,
            record_step=self._record_step,
            engine=engine,
            progress=progress,
            planned=(1.0 + 2.0) * scenario.stop / self._step,
        )
        self._scheme: GaussSeidel | Implicit = default_scheme()
        self._held = system.coupled_with_held
        self._runs: list[Result] = []
        self._comparisons: list[Comparison] = []
        self._failed_runs = 0
        self._tried: list[str] = []

    @property
    def _step(self) -> float:
        return self._record_step / self._parts

    def result(self) -> Result:
        """Halve the step until the tolerance is met or the smallest step is reached; return the last run.

        Raises:
            DivergedError: The coupling diverged at every step.
            StepError: A component failed.
        """
        while True:
            failure: DivergedError | None = None
            try:
                self._add(self._dense.run(self._scheme, self._step))
            except DivergedError as error:
                failure = error
                self._forget()
                self._failed_runs += 1
                self._tried.append(f"{self._step * 1e3:g} ms diverged")
            if self._failed_runs >= _FAILED_RUNS and self._takes_implicit():
                continue
            if self._is_met() or (self._is_smallest() and self._comparisons):
                return self._final()
            if self._is_smallest() and failure is not None:
                raise failure
            self._parts *= 2

    def _add(self, run: Result) -> None:
        """Add a run, which is compared with the one before."""
        if self._runs:
            self._comparisons.append(compare(self._runs[-1], run))
            run = replace(run, stated_error=stated_error(self._comparisons, self._held))
        self._runs = [run]
        self._failed_runs += not run.is_clean
        self._tried.append(f"{self._step * 1e3:g} ms {self._shown_error}")

    def _forget(self) -> None:
        self._runs, self._comparisons = [], []

    def _takes_implicit(self) -> bool:
        """Replace Gauss-Seidel at the same step if all components can repeat steps; return whether it was replaced."""
        if isinstance(self._scheme, Implicit) or not _can_repeat_steps(self._system):
            return False
        self._scheme = default_scheme("implicit")
        self._tried.append("gauss-seidel is not stable enough, implicit")
        self._forget()
        return True

    @property
    def _worst(self) -> float | None:
        return self._runs[-1].coupling_error if self._runs else None

    @property
    def _shown_error(self) -> str:
        local = "" if self._runs[-1].is_clean else ", not settled"
        return f"{'not compared' if self._worst is None else f'{self._worst:.2g} %'}{local}"

    def _is_met(self) -> bool:
        return self._worst is not None and self._comparisons[-1].reliable and self._worst <= self._request.tolerance

    def _is_smallest(self) -> bool:
        return 0.5 * self._step < self._request.least * (1.0 - 1e-9)

    def _final(self) -> Result:
        """Return the last run, with notes on the runs and on whether the tolerance was met."""
        run, worst = self._runs[-1], self._worst
        values = "" if isinstance(self._scheme, Implicit) else f" with {self._scheme.values} values"
        notes: tuple[str, ...] = (
            f"the default used {self._scheme.name}{values} at {run.step * 1e3:g} ms; coupling error stated by "
            f"comparing runs: {', '.join(self._tried)}",
        )
        if not self._is_met():
            notes += (
                f"the stated coupling error of {worst:.2g} % does not meet the tolerance of "
                f"{self._request.tolerance:g} %, and steps below {self._request.least * 1e3:g} ms were not tried: "
                "allow a smaller step, or a larger tolerance",
            )
        final = self._dense.final(run)
        return replace(
            final,
            algorithm=self._request.name,
            scheme=self._scheme.name,
            tolerance=self._request.tolerance,
            notes=notes + final.notes,
        )
