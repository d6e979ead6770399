"""Effect of a change at single corners on every measure: two runs of one setup, with and without the change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cosim.components.component import Variable
from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Evaluator, coupling_of
from cosim.study.running.trials import Trials
from cosim.study.running.workers import Workers
from cosim.study.study import Build, Parameters
from cosim.study.table import error_column
from eightpost import units
from eightpost.errors import InputError, StepError

#: Name of the weighted sum of Eq 2.6 among the effects.
OBJECTIVE = "objective"


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect of a change on one measure, in the measure's display unit."""

    measure: str  #: Name of the measure.
    unit: str  #: Display unit.
    before: float  #: Value without the change.
    after: float  #: Value with the change.
    noise: float  #: Estimated coupling error of a single run; NaN if not known.

    @property
    def change(self) -> float:
        """Value with the change less the value without it."""
        return self.after - self.before

    @property
    def relative(self) -> float:
        """Change as a share of the value without it [1]; NaN if that is 0."""
        return self.change / self.before if self.before else float("nan")

    @property
    def is_clear(self) -> bool:
        """Whether the change is larger than the coupling error of a run."""
        return not abs(self.change) <= self.noise


def shock_at(result: StudyResult, corner: str, setup: int | None = None) -> tuple[Build, Mapping[str, Variable]]:
    """Return the build at a corner of a setup (default: the baseline, or else the best), and its FMU's variables.

    Raises:
        InputError: There is no such corner or setup.
    """
    builds = _builds(result, setup)
    if corner not in builds:
        raise InputError(f"there is no corner {corner!r}; the corners are {', '.join(builds)}")
    study = result.study
    index = study.space.find(builds)
    shock = Evaluator(study).system(index).components[corner]
    return study.bank[builds[corner]], shock.variables


def what_if(
    result: StudyResult,
    workers: Workers,
    changes: Mapping[str, Parameters],
    *,
    setup: int | None = None,
    before: Mapping[str, Parameters] | None = None,
) -> tuple[Effect, ...]:
    """Return the effect of other parameters of the shocks at some corners on the objective and every measure.

    Args:
        result: Result of a study; its FMUs and drive files must still exist at their paths.
        workers: Workers that run the two setups.
        changes: Parameters that change, by corner, such as `{"lr": {"clicks.rebound": 13.0}}`.
        setup: Number of the setup; None: the baseline, or else the best setup.
        before: Parameters of the run without the change, where they differ from those of the setup.

    Raises:
        InputError: There is no such corner or setup, or nothing changes.
        StepError: A run failed.
    """
    if not any(changes.values()):
        raise InputError("nothing changes; name a corner and a parameter of its shock")
    builds = {corner: result.study.bank[name] for corner, name in _builds(result, setup).items()}
    for corner in (*changes, *(before or {})):
        if corner not in builds:
            raise InputError(f"there is no corner {corner!r}; the corners are {', '.join(builds)}")
    first = _with(builds, before or {})
    runs = Trials(result.study, workers, coupling_of(result)).run([first, _with(first, changes)])
    if not runs.done.all():
        raise StepError(f"a run failed: {runs.failures[0][1]}")
    return _effects(runs)


def _builds(result: StudyResult, setup: int | None) -> Mapping[str, str]:
    """Return the builds by corner of a setup by its number, of the baseline, or of the best setup."""
    if setup is not None:
        return result.study.space.setup(setup).builds
    if result.study.baseline:
        return result.study.baseline
    ranked = result.ranking()
    if not ranked.size:
        raise InputError("no setup of the study meets its constraints; name one with --setup")
    return result.setup(int(ranked[0])).builds


def _with(builds: Mapping[str, Build], changes: Mapping[str, Parameters]) -> dict[str, Build]:
    """Return builds by corner with other values of some parameters."""
    return {
        corner: replace(build, parameters={**build.parameters, **changes.get(corner, {})})
        for corner, build in builds.items()
    }


def _effects(runs: StudyResult) -> tuple[Effect, ...]:
    found = []
    if runs.objective is not None:
        before, after = runs.objective.tolist()
        found.append(Effect(OBJECTIVE, "", before, after, _objective_noise(runs)))
    for measure in runs.measures:
        noise = runs.shown_difference(measure.name, _noise(runs, measure.name))
        before, after = runs.shown(measure.name).tolist()
        found.append(Effect(measure.name, runs.display(measure.name), before, after, noise))
    return tuple(found)


def _noise(runs: StudyResult, measure: str) -> float:
    """Return the larger coupling error of a measure of both runs [SI]; NaN if it is not known."""
    errors = np.asarray(runs.table[error_column(measure)].to_numpy(zero_copy_only=False), dtype=np.float64)
    return float(np.max(np.abs(errors)))


def _objective_noise(runs: StudyResult) -> float:
    """Return the coupling error of the objective: the weighted sum of its terms' errors."""
    factors = (t.weight * units.conversion(runs.unit(t.measure), t.unit or runs.unit(t.measure))[0]
               for t in runs.study.objective)  # fmt: skip
    noises = (_noise(runs, term.measure) for term in runs.study.objective)
    return float(sum(abs(factor) * noise for factor, noise in zip(factors, noises, strict=True)))
