"""Rows of the benchmark of shock laws: one for each case and law, with the errors of fit and held-out run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

import numpy as np

from benchmarks.bouc_wen import fit_bouc_wen, predict
from benchmarks.shock_records import BOUC_WEN, Case, configurations, measured
from eightpost.ident import evaluate, fit_shock
from eightpost.ident.shock.law_fit import RecipeName
from eightpost.ident.shock.runs import prepare
from eightpost.rig import DynoTest, demo_damper, measure, random_multisine

Row = dict[str, Any]

#: Keys of a row besides record and law.
FIGURES = ("fit_percent", "validation_percent", "seconds")


@dataclass(frozen=True, slots=True)
class FitErrors:
    """The errors of a law on a case."""

    case: Case  #: Fitted and held-out runs.
    law: str  #: Name of the law.
    fit_rms: float  #: RMS error of the fit [N].
    fit_deviation: float  #: Standard deviation of the fitted force [N].
    rms: float  #: RMS error on the held-out run, including its mean [N].
    offset: float  #: Mean error on the held-out run [N].
    deviation: float  #: Standard deviation of the held-out force [N].
    seconds: float  #: Computing time of the fit [s].
    parameters: Mapping[str, float] = field(default_factory=dict)  #: Parameters of the law in SI units.
    at_bound: frozenset[str] = frozenset()  #: Names of the parameters at a bound of the fit.

    @property
    def error(self) -> float:
        """Evaluated error [N]: `rms`, or the RMS error about its mean if the load cell's zero is unknown."""
        return float(np.sqrt(max(self.rms**2 - self.offset**2, 0.0))) if self.case.about_mean else self.rms

    @property
    def fit_percent(self) -> float:
        """RMS error of the fit in percent of the fitted force's standard deviation."""
        return 100.0 * self.fit_rms / self.fit_deviation

    @property
    def validation_percent(self) -> float:
        """`error` in percent of the held-out force's standard deviation."""
        return 100.0 * self.error / self.deviation

    def row(self) -> Row:
        """Return the row that --json writes."""
        figures = (self.fit_percent, self.validation_percent, self.seconds)
        return {"record": self.case.record, "law": self.law} | dict(zip(FIGURES, figures, strict=True))


@dataclass(frozen=True, slots=True)
class FailedFit:
    """A law that could not be fitted to a case."""

    case: Case  #: Fitted and held-out runs.
    law: str  #: Name of the law.
    reason: str  #: Error message.

    def row(self) -> Row:
        """Return the row that --json writes, without figures."""
        return {"record": self.case.record, "law": self.law} | dict.fromkeys(FIGURES)


Result = FitErrors | FailedFit


@dataclass(frozen=True, slots=True)
class Bench:
    """The program of the benchmark."""

    configurations: tuple[int, ...]  #: Configuration numbers of Table 3.1.
    laws: tuple[str, ...]  #: Names of the laws; `bouc-wen` is fitted to measured records only.
    quick: bool  #: Whether to use shorter records and one pair of phase draws.
    recipe: RecipeName = "joint"  #: Recipe of the fits.
    processes: int = 2  #: Number of parallel processes.
    measured: tuple[int, ...] | None = None  #: Indices of the measured cases; None for all.

    @property
    def fitted(self) -> tuple[str, ...]:
        """Names of the laws that the recipe can fit."""
        return tuple(law for law in self.laws if self.recipe != "boggs" or law not in ("hysteresis", BOUC_WEN))


def results(bench: Bench) -> Iterator[Result]:
    """Fit and validate all cases; yield results in the order of the cases."""
    jobs = [("configuration", number) for number in bench.configurations]
    places = range(len(list(measured(quick=bench.quick)))) if bench.measured is None else bench.measured
    jobs += [("measured", number) for number in places]
    if min(bench.processes, len(jobs)) < 2:
        _warm_up(bench)
        for job in jobs:
            yield from _run(bench, job)
        return
    with ProcessPoolExecutor(
        bench.processes, mp_context=get_context("spawn"), initializer=_warm_up, initargs=(bench,)
    ) as pool:
        for found in pool.map(_run, [bench] * len(jobs), jobs):
            yield from found


def _run(bench: Bench, job: tuple[str, int]) -> list[Result]:
    """Return the results of a configuration or of one measured case."""
    kind, number = job
    if kind == "configuration":
        cases = list(configurations([number], quick=bench.quick))
    else:
        cases = [list(measured(quick=bench.quick))[number]]
    return [attempt(case, law, bench.recipe) for case in cases for law in case.laws if law in bench.fitted]


def _warm_up(bench: Bench) -> None:
    """Compile everything in one thread, so that times do not include compilation."""
    test = DynoTest(measure(demo_damper("A"), random_multisine(1, duration=2.0)))
    for law in bench.fitted:
        if law != BOUC_WEN:
            fit_shock(test, law, recipe=bench.recipe)


def attempt(case: Case, law: str, recipe: RecipeName) -> Result:
    """Return the errors of a law on a case, or why it could not be fitted."""
    try:
        return _bouc_wen(case) if law == BOUC_WEN else _ours(case, law, recipe)
    except ValueError as error:  # raised by laws and fits that reject the data
        return FailedFit(case, law, str(error))


def _ours(case: Case, law: str, recipe: RecipeName) -> FitErrors:
    fit = fit_shock(case.fitted, law, recipe=recipe, segment=case.segment)
    held = evaluate(fit.shock, case.held_out, segment=case.held_out_segment)
    parameters = {parameter.name: parameter.value for parameter in fit.parameters}
    errors = (fit.rms, fit.deviation, held.rms, held.offset, held.deviation)
    at_bound = frozenset(parameter.name for parameter in fit.parameters if parameter.at_bound)
    return FitErrors(case, law, *errors, fit.seconds, parameters, at_bound)


def _bouc_wen(case: Case) -> FitErrors:
    fit = fit_bouc_wen(case.fitted, segment=case.segment)
    prepared = prepare(case.held_out, segment=case.held_out_segment)
    predicted = predict(fit.law, prepared)
    error = prepared.measured - predicted
    rms, offset = float(np.sqrt(np.mean(error**2))), float(np.mean(error))
    names = ("damping", "stiffness", "hysteresis", "reach", "share", "exponent")
    parameters = {name: float(getattr(fit.law, name)) for name in names}
    errors = (fit.rms, fit.deviation, rms, offset, prepared.deviation)
    return FitErrors(case, BOUC_WEN, *errors, fit.seconds, parameters)
